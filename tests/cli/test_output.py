"""What is printed: any encoding, text of files as text, and a word when code is compiled."""

import io
import os
import subprocess
import sys
import time

import numpy as np
import pytest
from numba.core import event

from creative_nao import load_memory
from creative_nao.cli import main
from creative_nao.cli.evaluate import _lines as verify_lines
from creative_nao.cli.evaluate import _table as verify_table
from creative_nao.cli.terminal import Display, Terminal, print_result
from creative_nao.demonstrations import save_trajectory
from creative_nao.errors import CreativeNaoError, printable
from creative_nao.evaluation.verification import Check, Verification
from creative_nao.runtime import announce_compilation

HOSTILE = "\x1b]0;owned\x07\x1b[2J\r\u202egnp.exe \x9b31m[bold][/x]:smile: \u2028end"
SEEN = "\\x1b]0;owned\\x07\\x1b[2J\\r\\u202egnp.exe \\x9b31m[bold][/x]:smile: \\u2028end"


@pytest.fixture
def strict(monkeypatch):
    """Put a terminal of an encoding in the place of stdout and stderr; return what was written so far."""

    def put(encoding):
        streams = [io.TextIOWrapper(io.BytesIO(), encoding=encoding, errors="strict") for _ in range(2)]
        for name, stream in zip(("stdout", "stderr"), streams, strict=True):
            monkeypatch.setattr(sys, name, stream)

        def written():
            for stream in streams:
                stream.flush()
            return [stream.buffer.getvalue().decode(encoding) for stream in streams]

        return written

    return put


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252", "cp437", "shift_jis", "utf-8"])
def test_a_name_that_the_terminal_does_not_have_is_written_escaped(encoding, strict, tmp_path, monkeypatch, attempt):
    attempt("output", f"names of files with other letters on a terminal of {encoding}", "printed escaped, exit code 0")
    monkeypatch.chdir(tmp_path)
    name = "œuvre-Ž-動き.csv"
    save_trajectory(name, load_memory("half/0").demonstrations.trajectories[0], dt_s=0.15)
    written = strict(encoding)
    assert main(["score", name]) == 0
    assert main(["score", "œuvre-Ž-動き-2.csv"]) == 2
    assert main(["export", "--from", name, "--out", "œuvre-Ž.motion"]) == 0
    assert os.path.exists("œuvre-Ž.motion")
    shown = name.encode(encoding, "backslashreplace").decode(encoding)
    out, err = written()
    assert out.startswith(f"{shown}: learned")
    assert shown.removesuffix(".csv") in err


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_tables_and_progress_are_shown_on_any_terminal(encoding, strict):
    written = strict(encoding)
    assert main(["memories"]) == 0
    check = Check("œ-agent", "CreativeNao/BoxingMental-v0", "動き", 0, 1.0, 1.0, True)
    Terminal(width=140).print(verify_table(Verification((check,), (), ()), "results.json"))
    with Display({"œ": 3, "動き": 4}) as display:
        display.show("œ", 2, "動き")
    assert "agent" in written()[0]


def test_text_of_a_file_is_text_on_the_terminal(capsys, tmp_path, monkeypatch, attempt):
    attempt("terminal", "commands, marks of direction and markup in names", "escaped")
    monkeypatch.chdir(tmp_path)
    check = Check(HOSTILE, HOSTILE, HOSTILE, 0, 1.0, 1.0, True)
    verification = Verification((check,), (HOSTILE,), (HOSTILE,))
    Terminal(width=600).print(verify_table(verification, HOSTILE))
    Terminal(width=600).print(f"report: {HOSTILE}", soft_wrap=True)
    print_result({}, verify_lines(verification, HOSTILE), as_json=False)
    with Display({HOSTILE: 3, f"{HOSTILE} again": 3}) as display:
        display.console.print(HOSTILE)
        display.show(HOSTILE, 1, HOSTILE)
    assert main([HOSTILE]) == 2
    assert main(["score", HOSTILE]) == 2
    folder = tmp_path / HOSTILE.replace("/", "")
    folder.mkdir()
    assert main(["evaluate", "verify", str(folder)]) == 2
    assert main(["map", "half/0", "--out", str(folder)]) == 2
    told = capsys.readouterr()
    for text in (told.out, told.err):
        assert printable(text, keep="\n") == text
        assert "owned" in text
    assert told.out.count(SEEN) >= 5


@pytest.mark.parametrize("text", ["plain", "œ 動き", HOSTILE, "\ud800", "a\nb\tc\x00"])
def test_messages_and_lines_hold_nothing_that_cannot_be_seen(text):
    assert printable(text).isprintable()
    assert str(CreativeNaoError(text)).isprintable()
    assert (printable(text) == text) == text.isprintable()


def test_compilation_that_takes_long_says_so_once_within_a_second(caplog):
    announce_compilation()
    begun = time.time()
    for _ in range(2):
        with event.trigger_event("numba:compile", data={}):
            time.sleep(0.8)
    told = [record.created for record in caplog.records if "compiles code" in record.message]
    assert len(told) <= 2, "once each, this listener and that of the kernels"
    assert min(told) < begun + 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    "code",
    [
        "from creative_nao.cli import main; main(['score', 'a.csv'])",
        "import gymnasium, creative_nao; e = gymnasium.make('CreativeNao/Boxing-v0'); e.reset(); e.step([0.1, 0.2])",
        "import creative_nao as cn; cn.load_memory('half/0').generate([[0, 0]])",
    ],
)
def test_the_first_compilation_on_a_machine_says_so_within_a_second(code, tmp_path):
    save_trajectory(tmp_path / "a.csv", load_memory("half/0").demonstrations.trajectories[0], dt_s=0.15)
    began = "import numba.core.event as e, time, sys\n"
    began += "class L(e.Listener):\n    def on_start(s, _):\n        print(time.time(), 'began', file=sys.stderr)\n"
    began += "    on_end = lambda *_: None\ne.register('numba:compile', L())\n"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    with subprocess.Popen(
        [sys.executable, "-u", "-c", began + code], env=environment, cwd=tmp_path, stderr=subprocess.PIPE, text=True
    ) as process:
        begun_s = None
        for line in process.stderr:
            if begun_s is None and "began" in line:
                begun_s = float(line.split()[0])
            if "can take a minute" in line:
                assert time.time() - begun_s < 1.5  # with what a loaded machine takes to switch
                process.kill()
                return
    pytest.fail("nothing was said")


def test_a_compiler_that_is_switched_off_is_one_line(tmp_path, attempt):
    attempt("settings of numba", "NUMBA_DISABLE_JIT=1", "one line")
    save_trajectory(tmp_path / "a.csv", np.zeros((5, 8)) + load_memory("half/0").demonstrations.trajectories[0][:5])
    done = subprocess.run(
        [sys.executable, "-m", "creative_nao", "score", "a.csv"], cwd=tmp_path, capture_output=True, text=True,
        check=False, env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == (
        "creative-nao: NUMBA_DISABLE_JIT is set, but movements are computed by compiled code only; unset it\n"
    )
