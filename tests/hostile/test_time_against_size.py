"""Every reader of files: its time grows with the size of a file made to be slow, up to the largest that it takes.

`GROWING` has contents that made parsers slow: many small values, long numbers, depth, one name again and again. Each
is tried every day at a small share of its reader's largest size, and in the nightly run at the largest. Read or
refused: within 2 s of the processor and 600 MB. `-s` prints the curves.
"""

import contextlib
import io
import json
import resource
import time
import zipfile

import pytest
from victims import ENV, KINDS

from creative_nao import arrays, storage
from creative_nao.agents import callbacks, tuning
from creative_nao.demonstrations import take
from creative_nao.errors import CreativeNaoError
from creative_nao.evaluation import suites
from creative_nao.exchange import choregraphe, formats, robot_program
from creative_nao.explorer import favourites

LONGEST_S = 2.0
MOST_MB = 600
SHARES = (1 / 512, 1 / 16, 1)


def repeated(unit, before=b"", after=b""):
    """Return a maker of content: `unit` as often as it fits into a size, between a beginning and an end."""
    return lambda size: before + unit * max(1, (size - len(before) - len(after)) // len(unit)) + after


def numbered(form, between, before="", after=""):
    """Return a maker of content with different numbers in `form`."""

    def make(size):
        width = len(form.format(9_999_999)) + len(between)
        count = max(1, (size - len(before) - len(after)) // width)
        parts = (form.format(number) for number in range(1_000_000, 1_000_000 + count))
        return (before + between.join(parts) + after).encode()

    return make


def tensors(header):
    """Return a maker of a safetensors file of which the header is made by `header`, a maker."""

    def make(size):
        content = header(size)
        return len(content).to_bytes(8, "little") + content

    return make


def many_members(size):
    one = b"PK\1\2" + bytes(20) + (1).to_bytes(4, "little") + bytes(0) + b"\1\0" + bytes(16) + b"a"
    table = one * (size // len(one))
    end = b"PK\5\6" + bytes(4) + b"\xff\xff\xff\xff" + len(table).to_bytes(4, "little") + bytes(6)
    return table + end


def zeros(name):
    """Return a maker of an archive with one array of so many zeros, which are packed to nearly nothing."""

    def make(size):
        content = io.BytesIO()
        table = f"{{'descr': '|u1', 'fortran_order': False, 'shape': ({size - 1_000},), }}".ljust(117).encode() + b"\n"
        with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive, archive.open(name, "w") as stream:
            stream.write(b"\x93NUMPY\1\0" + len(table).to_bytes(2, "little") + table)
            for _ in range(0, size - 1_000, 1_000_000):
                stream.write(bytes(min(1_000_000, size - 1_000)))
        return content.getvalue()

    return make


JSON = {
    "lists": repeated(b"[],", b'{"rows":[', b"[]]}"),
    "objects": repeated(b"{},", b'{"rows":[', b"{}]}"),
    "objects of one field": repeated(b'{"a":1},', b'{"rows":[', b"{}]}"),
    "nested lists": repeated(b"[[[[[[]]]]]],", b'{"rows":[', b"[]]}"),
    "whole numbers": repeated(b"1,", b'{"rows":[', b"1]}"),
    "numbers": repeated(b"1.5,", b'{"rows":[', b"1]}"),
    "long numbers": repeated(b"1.2345678901234567,", b'{"rows":[', b"1]}"),
    "texts": repeated(b'"",', b'{"rows":[', b'""]}'),
    "names": numbered('"a{}":1', ",", "{", "}"),
    "one name": repeated(b'"a":1,', b"{", b'"a":1}'),
    "digits": repeated(b"1", b'{"rows":', b"}"),
    "decimals": repeated(b"1", b'{"rows":0.', b"}"),
    "an exponent": repeated(b"0", b'{"rows":1e', b"}"),
    "depth": repeated(b"["),
    "one text": repeated(b"x", b'{"rows":"', b'"}'),
    "escapes": repeated(rb"\u00e4", b'{"rows":"', b'"}'),
    "spaces": repeated(b" ", b"{", b"}"),
    "zeros": repeated(b"\0"),
}
YAML = {
    "base 60": repeated(b":1", b"a: 1"),
    "base 60, decimals": repeated(b":1", b"a: 1", b".5"),
    "base 60, a list": repeated(b"1:1,", b"a: [", b"1]"),
    "digits": repeated(b"1", b"a: "),
    "digits, tagged": repeated(b"1", b"a: !!int "),
    "decimals": repeated(b"1", b"a: 1."),
    "underscores": repeated(b"_1", b"a: 1"),
    "flow lists": repeated(b"[", b"a: "),
    "a flow list": repeated(b"1,", b"a: [", b"1]"),
    "flow keys": repeated(b"? ", b"a: {"),
    "questions": repeated(b"? "),
    "dashes": repeated(b"- "),
    "names": numbered("a{}: 1", "\n"),
    "aliases": repeated(b"*a,", b"b: &a 1\nc: [", b"1]"),
    "anchors": numbered("- &a{} 1", "\n"),
    "merges": repeated(b"- {<<: *a}\n", b"- &a {b: 1}\n"),
    "quotes": repeated(b'"', b"a: "),
    "a folded text": repeated(b" x\n", b"a: >\n"),
    "comments": repeated(b"#\n"),
    "spaces": repeated(b" "),
    "tags": repeated(b"!a ", b"a: "),
    "documents": repeated(b"---\n"),
}
TOML = {
    "memories": numbered('"{}"', ",", f'agents=["random"]\nenvs=["{ENV}"]\nmemories=[', "]\n"),
    "one memory": repeated(b'"a",', f'agents=["random"]\nenvs=["{ENV}"]\nmemories=['.encode(), b"]\n"),
    "parts of the bank": repeated(b'"train",', f'agents=["random"]\nenvs=["{ENV}"]\nmemories=['.encode(), b"]\n"),
    "agents": numbered('"a{}"', ",", f'envs=["{ENV}"]\nagents=[', "]\n"),
    "environments": numbered('"a{}"', ",", 'agents=["random"]\nenvs=[', "]\n"),
    "seeds": numbered("{}", ",", f'agents=["random"]\nenvs=["{ENV}"]\n[taught]\nseeds=[', "]\n"),
    "dotted names": repeated(b"a.", b"", b"b=1\n"),
    "quoted dotted names": repeated(rb'"\"".', b"", b"b=1\n"),
    "parted dotted names": repeated('"\N{LINE SEPARATOR}".'.encode(), b"", b"b=1\n"),
    "dotted names behind a quote": repeated(b"a.", b"x={k='''a'b\"''', ", b'b=1, z="y"}\n'),
    "lines of dotted names": numbered("a." * 497 + "b{}=1", "\n"),
    "dotted tables": repeated(b"a.", b"[", b"a]\n"),
    "many dotted names": numbered("a.b{}=1", "\n"),
    "tables": numbered("[a.b{}]", "\n"),
    "arrays of tables": repeated(b"[[a]]\n"),
    "nested lists": repeated(b"[", b"a="),
    "inline tables": numbered("b{}={{}}", ",", "a={", "}"),
    "digits": repeated(b"1", b"a="),
    "underscores": repeated(b"_1", b"a=1"),
    "names": numbered("a{}=1", "\n"),
    "a text": repeated(b"x", b'a="', b'"'),
    "quotes": repeated(b'"', b"a="),
    "comments": repeated(b"#\n"),
}
TABLE = {
    "commas": repeated(b","),
    "lines": repeated(b"\n", b"time_s,RElbowYaw,pb_1,pb_2,n_decisions\n"),
    "rows": numbered("{},0.1,0.1,0.1,1", "\n", "time_s,RElbowYaw,pb_1,pb_2,n_decisions\n"),
    "columns": numbered("a{}", ",", "time_s,RElbowYaw,pb_1,pb_2,n_decisions,"),
    "digits": repeated(b"1", b"time_s,RElbowYaw,pb_1,pb_2,n_decisions\n0,"),
    "quotes": repeated(b'"', b"time_s,RElbowYaw,pb_1,pb_2,n_decisions\n0,"),
    "surplus cells": repeated(b",", b"time_s,RElbowYaw,pb_1,pb_2,n_decisions\n0,0"),
    "letters": repeated(b"x"),
    "returns": repeated(b"\r", b"time_s,RElbowYaw\n"),
}
TENSORS = {
    "entries": tensors(numbered('"a{}":{{"dtype":"F32","shape":[0],"data_offsets":[0,0]}}', ",", "{", "}")),
    "wrong entries": tensors(numbered('"a{}":1', ",", "{", "}")),
    "shapes": tensors(repeated(b"1,", b'{"a":{"dtype":"F32","data_offsets":[0,4],"shape":[', b"1]}}")),
    "a header of lists": tensors(repeated(b"[],", b'{"__metadata__":{"creative_nao":"[', b'[]]"}}')),
    "digests": tensors(
        numbered(
            r"\"a{}\":\"\"", ",", r'{"__metadata__":{"creative_nao":"{\"sha256\":\"x\",\"arrays_sha256\":{', r'}}"}}'
        )
    ),
    "names": tensors(numbered(r"\"a{}\":1", ",", r'{"__metadata__":{"creative_nao":"{\"kind\":\"memory\",', r'}"}}')),
}
PYTHON = {
    "braces in a text": repeated(b"{a}", b"names = f'", b"'\n"),
    "brackets": repeated(b"(", b"names = "),
    "a list": repeated(b"1,", b"names = [", b"]\n"),
    "a sum": repeated(b"1+", b"names = ", b"1\n"),
    "signs": repeated(b"-", b"names = ", b"1\n"),
    "digits": repeated(b"1", b"names = "),
    "names": numbered("a{} = []", "\n"),
    "appended": repeated(b"names.append(1)\n", b"names = list()\n"),
    "copies": repeated(b"a = a + a\n", b"a = [1, 1]\n"),
    "quotes": repeated(b"'", b"names = "),
    "backslashes": repeated(b"\\\n", b"names = "),
    "indents": repeated(b"if 1:\n "),
    "semicolons": repeated(b";"),
    "attributes": repeated(b".a", b"names = a"),
    "comparisons": repeated(b"<1", b"names = 1"),
    "comments": repeated(b"#\n"),
    "escapes": repeated(rb"\N{DIGIT ONE}", b"names = '", b"'"),
}
XML = {
    "elements": repeated(b"<a/>", b"<ChoregrapheProject>", b"</ChoregrapheProject>"),
    "depth": repeated(b"<a>"),
    "timelines": repeated(b'<Timeline fps="25"/>', b"<ChoregrapheProject>", b"</ChoregrapheProject>"),
    "keys": repeated(
        b'<Key frame="1" value="1"/>',
        b'<a><Timeline fps="25"><ActuatorList><ActuatorCurve actuator="RElbowYaw" unit="0">',
        b"</ActuatorCurve></ActuatorList></Timeline></a>",
    ),
    "attributes": numbered('a{}="1"', " ", "<a ", "/>"),
    "one attribute": repeated(b"x", b'<a b="', b'"/>'),
    "text": repeated(b"x", b"<a>", b"</a>"),
    "entities": repeated(b"&lt;", b"<a>", b"</a>"),
    "own entities": repeated(b"&a;", b'<!DOCTYPE a [<!ENTITY a "x">]><a>', b"</a>"),
    "comments": repeated(b"<!---->", b"<a>", b"</a>"),
    "sections": repeated(b"<![CDATA[x]]>", b"<a>", b"</a>"),
    "spaces": repeated(b" ", b"<a ", b"/>"),
    "namespaces": numbered('xmlns:a{}="x"', " ", "<a ", "/>"),
}
SITE = b"\nEnd Site\n{\nOFFSET 0 1 0\n}\n}\nMOTION\nFrames: 100\nFrame Time: 0.01\n"
ROOT = b"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation" + SITE
BVH = {
    "joints": repeated(b"JOINT a {", b"HIERARCHY\nROOT a {\n"),
    "names": numbered("JOINT a{}\n{{\n", "", "HIERARCHY\nROOT a\n{{\n"),
    "frames": repeated(b"0 0 0\n", ROOT),
    "one frame": repeated(b"0 ", ROOT),
    "words": repeated(b"a ", b"HIERARCHY\n"),
    "braces": repeated(b"{", b"HIERARCHY\nROOT a\n"),
    "digits": repeated(b"1", b"HIERARCHY\nROOT a\n{\nOFFSET "),
    "lines": repeated(b"\n", b"HIERARCHY\n"),
}
JOURNAL = {
    "operations": repeated(b'{"op_code":5}\n'),
    "trials": repeated(
        b'{"op_code":4,"worker_id":"x","study_id":0,"datetime_start":"2026-01-01T00:00:00.000000"}\n',
        b'{"op_code":0,"worker_id":"x","study_name":"tuning","directions":[2]}\n',
    ),
    "one line": repeated(b" ", b'{"op_code":5', b"}\n"),
}
ARCHIVE = {
    "a table of contents": many_members,
    "zeros": zeros("header.npy"),
    "letters": repeated(b"PK\3\4"),
}
GROWING = {
    "session": (JSON, favourites.MAX_FILE_BYTES),
    "results": (JSON, storage.MAX_TEXT_BYTES),
    "record": (JSON, storage.MAX_TEXT_BYTES),
    "published": (JSON, storage.MAX_TEXT_BYTES),
    "job": (JSON, storage.MAX_TEXT_BYTES),
    "job_result": (JSON, storage.MAX_TEXT_BYTES),
    "taught": (JSON, storage.MAX_TEXT_BYTES),
    "motion_json": (JSON, formats.MAX_FILE_BYTES),
    "motion_ros_json": (JSON, formats.MAX_FILE_BYTES),
    "yaml": (YAML, storage.MAX_YAML_BYTES),
    "motion_ros": (YAML, formats.MAX_FILE_BYTES),
    "toml": (TOML, suites.MAX_FILE_BYTES),
    "csv": (TABLE, formats.MAX_FILE_BYTES),
    "motion_csv": (TABLE, formats.MAX_FILE_BYTES),
    "motion_webots": (TABLE, formats.MAX_FILE_BYTES),
    "episodes": (TABLE, storage.MAX_TEXT_BYTES),
    "training_log": (TABLE, callbacks.MAX_LOG_BYTES),
    "motion_py": (PYTHON, robot_program.MAX_PYTHON_BYTES),
    **dict.fromkeys(
        ("memory", "checkpoint", "bundle", "zoo_bundle", "state", "agent_checkpoint", "truth", "body_sense"),
        (TENSORS, arrays.MAX_HEADER_BYTES),
    ),
    **dict.fromkeys(("map", "physical", "unfinished"), (ARCHIVE, arrays.MAX_UNPACKED_BYTES)),
    "motion_npz": (ARCHIVE, formats.MAX_FILE_BYTES),
    "motion_states": (YAML, formats.MAX_FILE_BYTES),
    "motion_program": (PYTHON, robot_program.MAX_PYTHON_BYTES),
    **dict.fromkeys(("motion_timeline", "motion_postures"), (XML, choregraphe.MAX_XML_BYTES)),
    "take_csv": (TABLE, take.MAX_TAKE_BYTES),
    "take_bvh": (BVH, take.MAX_TAKE_BYTES),
}
"""What is made for each kind of file, and its largest size."""


def cost(load, path, content):
    path.write_bytes(content)
    del content
    before, start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    with contextlib.suppress(CreativeNaoError):
        load(path)
    seconds = time.process_time() - start
    return seconds, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1000


def test_every_kind_grows():
    assert set(GROWING) == set(KINDS)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [SHARES[0], *(pytest.param(one, marks=pytest.mark.slow) for one in SHARES[1:])])
def test_reading_takes_two_seconds_at_most(kind, share, victims, tmp_path, attempt):
    makers, largest = GROWING[kind]
    size = int(share * largest)
    attempt("every reader", f"content made to be slow, of 1/{1 / share:.0f} of the largest size that it takes",
            "read or refused within 2 s and 600 MB", len(makers))  # fmt: skip
    slow = []
    for name, make in makers.items():
        seconds, megabytes = cost(victims[kind].load, tmp_path / victims[kind].path.name, make(size))
        print(f"{kind:16} {name:28} {size / 1e6:8.2f} MB {seconds:6.2f} s {megabytes:6.0f} MB")  # noqa: T201
        if seconds > LONGEST_S or megabytes > MOST_MB:  # once more: other work slows the processor, too
            seconds = min(seconds, cost(victims[kind].load, tmp_path / victims[kind].path.name, make(size))[0])
        if seconds > LONGEST_S or megabytes > MOST_MB:
            slow.append((name, seconds, megabytes))
    assert slow == []


@pytest.mark.parametrize("share", [SHARES[0], pytest.param(1, marks=pytest.mark.slow)])
def test_a_journal_takes_two_seconds_at_most(share, tmp_path):
    plan = tuning.TuningPlan("ppo", ENV, n_trials=1, n_timesteps=64)

    def load(path):
        start = tuning.read_hyperparameters("ppo", ENV)
        tuning._open_study(tuning.load_extra("optuna", "tune", plan.algorithm), path, start)

    for make in JOURNAL.values():
        path = tmp_path / "study.journal"
        path.unlink(missing_ok=True)
        assert cost(load, path, make(int(share * tuning.MAX_JOURNAL_BYTES)))[0] < LONGEST_S


def test_the_clock_notices_what_is_slow(tmp_path):
    def load(path):
        content = json.loads(path.read_bytes())
        return [content.count(one) for one in content]

    make = numbered("{}", ",", "[", "]")
    assert cost(load, tmp_path / "a", make(40_000))[0] > 20 * cost(load, tmp_path / "a", make(4_000))[0]
