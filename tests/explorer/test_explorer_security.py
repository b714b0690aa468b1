"""What strangers try on the explorer: other sites' pages, other users of the machine, files made to hang a reader."""

import asyncio
import os
import stat
import subprocess
import sys
import threading
import time

import pytest

from creative_nao import storage
from creative_nao.errors import FileFormatError
from creative_nao.explorer.favourites import Favourite, Session, default_path
from creative_nao.explorer.gate import MAX_BODY_BYTES, Gate
from creative_nao.explorer.recordings import read_upload

posix = pytest.mark.skipif(os.name != "posix", reason="locks and modes of POSIX")


async def inner(scope, receive, send):
    while (await receive()).get("more_body"):
        pass
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"in"})


def ask(headers, host="127.0.0.1", allowed=(), kind="http", chunks=(b"",)):
    """Return the status, or the code that closes a socket, and the headers that an attacker gets."""
    said, left = [], list(chunks)

    async def receive():
        body = left.pop(0)
        return {"type": "http.request", "body": body, "more_body": bool(left)}

    async def send(message):
        said.append(message)

    async def scene():
        pairs = [(key.encode(), value.encode()) for key, value in headers.items()]
        await Gate(inner, host, allowed)({"type": kind, "path": "/", "headers": pairs}, receive, send)

    with_loop = asyncio.new_event_loop()
    thread = threading.Thread(target=lambda: with_loop.run_until_complete(scene()))
    thread.start()
    thread.join()
    with_loop.close()
    return said[0].get("status", said[0].get("code")), dict(said[0].get("headers", ()))


OWN = "127.0.0.1:8765"
LINK = {"sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}
FRAME = {"sec-fetch-mode": "navigate", "sec-fetch-dest": "iframe"}


@pytest.mark.parametrize(
    ("headers", "host", "allowed", "status"),
    [
        ({"host": OWN}, "127.0.0.1", (), 200),
        ({"host": "localhost:8765", "origin": "http://localhost:8765"}, "127.0.0.1", (), 200),
        ({"host": "[::1]:8765"}, "127.0.0.1", (), 200),
        ({"host": "evil.example"}, "127.0.0.1", (), 403),
        ({"host": "evil.example"}, "0.0.0.0", (), 403),
        ({"host": "evil.example"}, "127.0.0.2", (), 403),
        ({"host": "127.0.0.1.evil.example"}, "0.0.0.0", (), 403),
        ({"host": "evil.example@127.0.0.1"}, "127.0.0.1", (), 403),
        ({"host": "[::1"}, "127.0.0.1", (), 403),
        ({}, "127.0.0.1", (), 403),
        ({"host": "192.168.7.4:8765"}, "0.0.0.0", (), 200),
        ({"host": "192.168.7.4:8765"}, "127.0.0.1", (), 403),
        ({"host": "robot.lan:8765"}, "0.0.0.0", ("robot.lan",), 200),
        ({"host": "robot.lan:8765", "origin": "http://evil.example"}, "0.0.0.0", ("robot.lan",), 403),
        ({"host": "127.0.0.2:8765", "origin": "http://evil.example"}, "127.0.0.2", (), 403),
        ({"host": OWN, "origin": "http://127.0.0.1:9999"}, "127.0.0.1", (), 403),
        ({"host": OWN, "origin": "null"}, "127.0.0.1", (), 403),
        ({"host": OWN, "sec-fetch-site": "cross-site"}, "127.0.0.1", (), 403),
        ({"host": OWN, "sec-fetch-site": "same-site"}, "127.0.0.1", (), 403),
        ({"host": OWN, "sec-fetch-site": "cross-site", **FRAME}, "127.0.0.1", (), 403),
        ({"host": OWN, "sec-fetch-site": "cross-site", **LINK}, "127.0.0.1", (), 200),
        ({"host": OWN, "sec-fetch-site": "cross-site", **LINK, "origin": "null"}, "127.0.0.1", (), 403),
        ({"host": OWN, "sec-fetch-site": "same-origin"}, "127.0.0.1", (), 200),
    ],
)  # fmt: skip
def test_who_is_answered(headers, host, allowed, status, attempt):
    attempt("the explorer's server", "requests with other hosts, origins and sites", "403 but for our own", n=2)
    got, answered = ask(headers, host, allowed)

    assert got == status
    assert b"frame-ancestors 'none'" in answered[b"content-security-policy"]
    assert b"unsafe" not in answered[b"content-security-policy"]
    assert ask(headers, host, allowed, kind="websocket")[0] == 1008  # the page opens no socket, so nobody does


@pytest.mark.parametrize(
    ("told", "chunks"),
    [({"content-length": str(1_000_000_000)}, [b""]), ({"content-length": "-1"}, [b""]), ({}, [b"x" * 1_000_000] * 9)],
)
def test_a_body_that_is_too_large_is_refused_before_it_is_kept(told, chunks, attempt):
    attempt("the explorer's server", "bodies too large, told or not", "413")
    assert ask({"host": OWN, **told}, chunks=chunks)[0] == 413
    assert ask({"host": OWN}, chunks=[b"x" * (MAX_BODY_BYTES // 4)] * 4)[0] == 200


def test_reading_an_upload_is_stopped(attempt):
    attempt("the explorer's server", "an upload that takes long to read", "stopped at the deadline, one line")
    begun = time.monotonic()
    with pytest.raises(FileFormatError, match=r"slow\.py: reading it took more than 0\.05 s and was stopped"):
        read_upload("slow.py", b"f'" + b"{a}" * 600_000 + b"'\n", 0.15, deadline_s=0.05)
    assert time.monotonic() - begun < 5


def test_an_upload_imports_nothing_from_the_current_folder(tmp_path, monkeypatch, attempt):
    attempt("the explorer's server", "a numpy.py in the current folder", "never imported")
    (tmp_path / "numpy.py").write_text("open('run', 'w')\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileFormatError, match=r"^a\.csv"):
        read_upload("../../a.csv", b"no,table\n", 0.15)
    assert not (tmp_path / "run").exists()


HOLDER = "import fcntl, os, sys, time; fcntl.flock(os.open(sys.argv[1], os.O_RDONLY), 2); print(1, flush=True)"


@posix
def test_a_lock_that_somebody_holds_is_given_up(tmp_path, attempt):
    attempt("favourites", "another user holds the lock of the folder", "given up after a deadline")
    with subprocess.Popen(
        [sys.executable, "-c", f"{HOLDER}; time.sleep(60)", tmp_path], stdout=subprocess.PIPE
    ) as holder:
        holder.stdout.readline()
        begun = time.monotonic()
        with pytest.raises(TimeoutError, match="another process holds its lock"), storage.alone(tmp_path, 0.2):
            pass
        assert time.monotonic() - begun < 5
        holder.terminate()
    with storage.alone(tmp_path, 5):
        pass


@posix
def test_nobody_else_reads_the_favourites(tmp_path, monkeypatch, attempt):
    attempt("favourites", "another user reads them", "folder 0700, file 0600")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    (tmp_path / "creative_nao").mkdir(mode=0o755)  # as an older release made it
    Session(default_path()).add(Favourite("m", ((0.1, 0.2),), "mine"))

    assert stat.S_IMODE(default_path().stat().st_mode) == 0o600
    assert stat.S_IMODE(default_path().parent.stat().st_mode) == 0o700
