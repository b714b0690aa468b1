"""A tab that goes takes with it what the server kept for it, however it goes."""

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest
from visiting import Server, free_port

WATCHED = Path(__file__).with_name("watched.py")


class WatchedServer(Server):
    """A server that tells what it holds, and waits five seconds for a tab that went quiet."""

    pipe = subprocess.PIPE

    def command(self, folder, words, memories):
        return [sys.executable, str(WATCHED), str(self.port), str(folder), "5.0"]

    def tells(self):
        self.process.stdin.write(b"?\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def stop(self):
        super().stop()
        self.process.stdin.close()
        self.process.stdout.close()

    def becomes(self, seconds=60, **wanted):
        deadline = time.monotonic() + seconds
        while not wanted.items() <= (found := self.tells()).items():
            assert time.monotonic() < deadline, (found, wanted)
            time.sleep(0.3)
        return found


@pytest.fixture
def watched(tmp_path):
    running = WatchedServer(tmp_path, free_port())
    yield running
    running.stop()


@pytest.fixture
def playwright_error(playwright_run):
    from playwright.sync_api import Error

    return Error


@pytest.mark.slow
def test_closed_and_crashed_tabs_leave_nothing(watched, visit, playwright_error):
    closed, crashed, staying = visit(watched.url), visit(watched.url), visit(watched.url)
    for tab in (closed, crashed, staying):
        tab.click_map(0.3, 0.3)
        tab.says("PB -0.4")
    assert watched.tells()["kept"] >= 3
    closed.page.close()
    with pytest.raises(playwright_error, match="crash"):
        crashed.page.goto("chrome://crash", timeout=20_000)
    found = watched.becomes(kept=1, alive=1)
    assert found["born"] >= 3
    staying.click_map(0.7, 0.7)
    staying.says("PB 0.4")
    staying.page.close()
    watched.becomes(kept=0, alive=0)


@pytest.mark.slow
def test_a_silent_tab_is_given_up(watched, visit):
    tab = visit(watched.url)
    tab.context.set_offline(True)  # no farewell reaches the server
    watched.becomes(kept=0, alive=0)
