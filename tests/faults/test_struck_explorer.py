"""The explorer's server under the same faults: it goes on serving or ends in order, and starts again where it was."""

import signal
import socket
import time
import urllib.request

import pytest
from striking import FAULTS, SIGNALS, TWO, case_name, check_code, draw, end, last_line, start
from struck_commands import RUN_FOLDER, explorer
from whole_files import contents, remains

from creative_nao.explorer.favourites import Favourite, Session

N_TOUCHES = 6
"""Making the folder of the kept map and writing it: two folders, two openings, a renaming, a removal."""


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def answers(port):
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=5) as answer:
            return answer.status == 200
    except OSError:
        return False


def wait_for(condition, process, seconds=240):
    """Wait until a condition holds or the process has ended; tell whether the condition held."""
    deadline = time.monotonic() + seconds
    while process.poll() is None and time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.1)
    return False


def serve_and_stop(port, folder, name):
    """Start undisturbed, wait for the page and the kept map, and stop as Ctrl-C does."""
    started = start(explorer(port), folder, name=name)
    out = folder / RUN_FOLDER
    assert wait_for(lambda: answers(port) and list(out.glob("cache/maps/[!.]*.npz")), started[0])
    started[0].send_signal(signal.SIGINT)
    return end(started)


@pytest.mark.slow
@pytest.mark.parametrize("fault", [pytest.param(fault, id=case_name("explore", fault, 0)) for fault in FAULTS])
def test_a_struck_explorer_serves_on_or_ends_in_order(fault, tmp_path, tried):
    port, out = free_port(), tmp_path / RUN_FOLDER
    Session(out / "session.json").add(Favourite("a" * 24, ((0.5, 0.5),), "mine"))
    kept = (out / "session.json").read_bytes()
    moment, _ = draw("explore", fault, 0, N_TOUCHES)
    tried |= {"command": "explore", "fault": fault, "touch": moment, "of": N_TOUCHES, "delay_s": 0.0}
    started = start(explorer(port), tmp_path, fault=fault, moment=moment)

    if fault in SIGNALS:
        struck = end(started)
        check_code(fault, struck.code)
        told = struck
    else:
        assert wait_for(lambda: answers(port) and (fault == TWO or started[2].exists()), started[0])
        told = end(start(explorer(port), tmp_path, name="second")) if fault == TWO else None
        assert answers(port)
        started[0].send_signal(signal.SIGINT)
        struck = end(started)
        assert struck.code == 0
        assert last_line(struck.said) == ""
    said = "" if told is None else last_line(told.said).replace(str(port), "PORT")
    tried |= {"exit_code": struck.code if told is None else told.code, "said": said}
    assert bool(said) == (tried["exit_code"] in (2, 130))
    if fault == TWO:
        assert tried["exit_code"] == 2
    if fault not in ("kill -9", "read-only folder", "folder removed"):
        assert remains(out) == []
    if fault != "folder removed":
        assert (out / "session.json").read_bytes() == kept

    again = serve_and_stop(port, tmp_path, "again")
    assert again.code == 0
    assert last_line(again.said) == ""
    assert remains(out) == []
    contents(out)
    if fault != "folder removed":
        assert (out / "session.json").read_bytes() == kept
