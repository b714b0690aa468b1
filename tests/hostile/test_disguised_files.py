"""Files made to harm: nothing in them runs, fills the memory or is written elsewhere, and each is named."""

import io
import json
import os
import pickle
import resource
import zipfile

import numpy as np
import pytest
from victims import ARCHIVES, JSONS, KINDS, TENSORS, TEXTS

from creative_nao.errors import FileFormatError, NotFoundError

MEMBERS = ["../header.npy", "/tmp/header.npy", "a\\..\\header.npy", "C:header.npy", "header", ""]
FIRST_ARRAY = {"map": "distance", "physical": "distance", "unfinished": "distance", "motion_npz": "angles"}


class Bomb:
    """Leaves a file behind when it is unpickled."""

    def __init__(self, trace):
        self.trace = trace

    def __reduce__(self):
        return os.mkdir, (str(self.trace),)


def refuse(victim, path, match=None, error=FileFormatError):
    if victim.lenient:
        assert victim.load(path) is None
        return
    with pytest.raises(error, match=match) as caught:
        victim.load(path)
    assert path.name in str(caught.value) or str(path.with_name(victim.path.name)) in str(caught.value)
    assert len(str(caught.value)) < 1_000


def beside(victim, tmp_path, content=b""):
    path = tmp_path / f"evil-{victim.path.name}"
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_a_pickle_in_disguise_is_not_run(kind, victims, tmp_path, attempt):
    attempt("files of every kind", "a pickle in disguise", "refused by the name of the file; nothing runs")
    trace = tmp_path / "ran"
    path = beside(victims[kind], tmp_path, pickle.dumps(Bomb(trace)))
    refuse(victims[kind], path)
    assert not trace.exists()

    pickle.loads(path.read_bytes())
    assert trace.exists(), "the bomb is live"


@pytest.mark.parametrize("kind", ARCHIVES)
def test_a_pickle_inside_an_archive_is_not_run(kind, victims, tmp_path):
    trace = tmp_path / "ran"
    content = io.BytesIO()
    with np.load(victims[kind].path) as good:
        np.savez(content, **{**good, FIRST_ARRAY[kind]: np.array([Bomb(trace)] * 4, dtype=object)})
    refuse(victims[kind], beside(victims[kind], tmp_path, content.getvalue()), f"`{FIRST_ARRAY[kind]}` holds object")
    assert not trace.exists()


def test_yaml_tags_make_no_objects(victims, tmp_path):
    trace = tmp_path / "ran"
    text = f"CreativeNao/BoxingMental-v0: !!python/object/apply:os.mkdir ['{trace}']\n"
    refuse(victims["yaml"], beside(victims["yaml"], tmp_path, text.encode()), "not YAML")
    assert not trace.exists()


@pytest.mark.parametrize(("first", "more"), [("[x, x]", "[{}]"), ("{{a: 1, b: 2}}", "{{<<: [{}]}}"), ("[*a0]", "[{}]")])
def test_yaml_aliases_that_multiply_are_refused(first, more, victims, tmp_path):
    lines = [f"a0: &a0 {first.format()}"]
    lines += [f"a{n}: &a{n} {more.format(', '.join([f'*a{n - 1}'] * 10))}" for n in range(1, 12)]
    lines += ["CreativeNao/BoxingMental-v0: *a11"]
    refuse(victims["yaml"], beside(victims["yaml"], tmp_path, "\n".join(lines).encode()), "unfold to more than 20000")


@pytest.mark.parametrize("kind", KINDS)
def test_ten_gigabytes_of_zeros_are_refused_unread(kind, victims, tmp_path):
    path = beside(victims[kind], tmp_path)
    os.truncate(path, 10_000_000_000)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    refuse(victims[kind], path, "10000000000")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000, "kilobytes"


@pytest.mark.parametrize("kind", ["map", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ARCHIVES[1:])])
@pytest.mark.parametrize("told", [3_000_000_000, 1_000])
def test_an_archive_that_unpacks_to_gigabytes_is_refused_before(kind, told, victims, tmp_path):
    """Also where the table of contents tells a smaller size than there is."""
    content, size = io.BytesIO(), 100_000_000
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("header.npy", "w") as stream:
        for _ in range(100):
            stream.write(bytes(size // 100))
    packed = content.getvalue().replace(size.to_bytes(4, "little"), told.to_bytes(4, "little"))
    path = beside(victims[kind], tmp_path, packed)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    refuse(victims[kind], path, f"announces 1 and {told}" if told > size else "not a .*, or a torn one")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000, "kilobytes"


@pytest.mark.parametrize("kind", ARCHIVES)
@pytest.mark.parametrize("name", MEMBERS)
def test_a_member_with_a_path_for_a_name_is_refused(kind, name, victims, tmp_path):
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr(zipfile.ZipInfo(name), b"x")
    path = beside(victims[kind], tmp_path, content.getvalue())
    refuse(victims[kind], path, "expected arrays as plain names")
    assert [one.name for one in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("kind", TENSORS)
@pytest.mark.parametrize("length", [2**60, 2**64 - 1, 1_000_001])
def test_a_header_of_exabytes_is_refused(kind, length, victims, tmp_path):
    path = beside(victims[kind], tmp_path, length.to_bytes(8, "little") + b"{}")
    refuse(victims[kind], path, f"announce a header of {length} bytes")


@pytest.mark.parametrize("kind", ARCHIVES)
def test_an_array_of_exabytes_is_refused(kind, victims, tmp_path):
    table = b"{'descr': '|u1', 'fortran_order': False, 'shape': (1152921504606846976,), }\n"
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr("header.npy", b"\x93NUMPY\x01\x00" + len(table).to_bytes(2, "little") + table + b"abcd")
    path = beside(victims[kind], tmp_path, content.getvalue())
    refuse(victims[kind], path, r"`header` has 4 bytes, which do not fit uint8 of shape \(1152921504606846976,\)")


@pytest.mark.parametrize("kind", KINDS)
def test_links_folders_pipes_and_devices(kind, victims, tmp_path):
    victim, folder = victims[kind], tmp_path / "folder"
    folder.mkdir()
    link = folder / victim.path.name
    link.symlink_to(victim.path)
    assert victim.load(link) is not None
    if kind in ("session", "taught", "training_log"):
        return  # what is not there is begun, or is no part of the set
    for name, make in {
        "nowhere": lambda path: path.symlink_to(tmp_path / "none"),
        "itself": lambda path: path.symlink_to(path),
        "device": lambda path: path.symlink_to("/dev/zero"),
        "pipe": os.mkfifo,
        "place": os.mkdir,
    }.items():
        path = tmp_path / f"{name}.{victim.path.suffix}"
        make(path)
        refuse(victim, path, error=NotFoundError)


@pytest.mark.parametrize("kind", TEXTS)
@pytest.mark.parametrize("encoding", ["utf-16", "utf-32", "latin-1"])
def test_text_that_is_not_utf_8_is_named(kind, encoding, victims, tmp_path):
    text = victims[kind].path.read_text(encoding="utf-8") + ("\u00e4" if encoding == "latin-1" else "")
    refuse(victims[kind], beside(victims[kind], tmp_path, text.encode(encoding)), "UTF-8")


@pytest.mark.parametrize("kind", TEXTS)
def test_a_byte_order_mark_and_windows_line_ends_are_read(kind, victims, tmp_path):
    content = victims[kind].path.read_bytes().replace(b"\n", b"\r\n")
    assert victims[kind].load(beside(victims[kind], tmp_path, b"\xef\xbb\xbf" + content)) is not None


@pytest.mark.parametrize("kind", JSONS)
@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("[" * 100_000, "nested too deeply|maximum nesting depth"),
        ('{"a": NaN}', "it holds nan"),
        ('{"a": -Infinity}', "it holds -inf"),
        ('{"a": 1e999}', "it holds inf"),
        ('{"a": ' + "9" * 5_000 + "}", "not JSON"),
        ('{"a": ' + "9" * 41 + "}", "it holds a whole number of more than 40 digits"),
        ('{"a": {"b": 1, "c": 2, "b": 3}}', "it says `b` twice"),
        ('{"a": ' + "[" * 65 + "]" * 65 + "}", "nested too deeply"),
        ("null", None),
        ("[]", None),
        ('"text"', None),
    ],
)
def test_json_that_is_none_of_ours_is_named(kind, text, match, victims, tmp_path):
    refuse(victims[kind], beside(victims[kind], tmp_path, text.encode()), match)


def test_deep_toml_and_yaml_are_named(victims, tmp_path):
    refuse(victims["toml"], beside(victims["toml"], tmp_path, b"a = " + b"[" * 50_000), "nested too deeply")
    refuse(victims["yaml"], beside(victims["yaml"], tmp_path, b"a: " + b"[" * 5_000), "not YAML")


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("time_s;RElbowYaw\n0,0;0,1,2\n0,1;0,2\n", "line 2: `RElbowYaw` is `0,1,2`, expected a number"),
        ("time_s,RElbowYaw\n0,0,0,1\n0,1,0,2\n", "perhaps a comma is the decimal mark"),
        ('time_s,RElbowYaw\n0,"0,1"\n0.1,"0,2"\n', "a decimal comma"),
        ("time_s,RElbowYaw\n0,nan\n0.1,0\n", "line 2: `RElbowYaw` is `nan`, expected a finite number"),
        ("time_s,RElbowYaw\n0,0\n1e400,0\n", "line 3: `time_s` is `1e400`, expected a finite number"),
        ("time_s,RElbowYaw\n0,0\n0.1,\x00\n", "RElbowYaw"),
        ("time_s,RElbowYaw\n0,0\n0.1," + "9" * 200_000 + "\n", "line"),
        ('time_s,RElbowYaw\n0,"' + "0\n" * 100_000, "line"),
    ],
)
def test_a_spreadsheet_is_told_what_it_did(text, match, victims, tmp_path):
    refuse(victims["csv"], beside(victims["csv"], tmp_path, text.encode()), match)


def test_a_record_whose_parts_are_of_another_kind_is_named(victims, tmp_path):
    for part in ("settings", "versions", "memories"):
        content = {"settings": {}, "versions": {}, "command": "", "memories": {}, part: [1]}
        refuse(victims["record"], beside(victims["record"], tmp_path, json.dumps(content).encode()), f"`{part}` should")
