"""The explorer's server: what it answers, what it survives, what it says when it cannot start."""

import contextlib
import http.client
import json
import socket
import sys
import time

import numpy as np
import pytest
from visiting import CHROMIUM, FLAGS, Server, Visit

from creative_nao.cli import main
from creative_nao.explorer.keyframes import boxing
from creative_nao.model import load_memory


def ask(server, path, content=None, method=None):
    """Return the status and the answer."""
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)) as connection:
        body = None if content is None else content if isinstance(content, bytes) else json.dumps(content)
        connection.request(method or ("GET" if content is None else "POST"), path, body)
        answer = connection.getresponse()
        text = answer.read()
        return answer.status, json.loads(text) if text.startswith((b"{", b"[")) else text


@pytest.fixture(scope="module")
def ready(server):
    deadline = time.monotonic() + 120
    while not ask(server, "/api/state")[1].get("ready"):
        assert time.monotonic() < deadline
        time.sleep(0.1)
    return server


def test_the_page_and_its_parts_are_served_and_nothing_else(ready):
    assert b"Surprise me" in ask(ready, "/")[1]
    assert ask(ready, "/teach")[1] == ask(ready, "/")[1]
    assert ask(ready, "/static/engine.js")[0] == 200
    for path in ("/static/../server.py", "/static/%2e%2e%2fserver.py", "/static//etc/passwd", "/api/nothing", "/etc"):
        assert ask(ready, path)[0] == 404


GUARD = boxing().drafts[0].keys[0].posture
MOVEMENT = {"dt": 0.15, "angles": load_memory("half/0").demonstrations.trajectories[1].tolist()}


@pytest.mark.parametrize(
    ("path", "content", "status", "said"),
    [
        ("perform", MOVEMENT | {"dt": 0.0}, 400, "`dt` should be above 0"),
        ("perform", MOVEMENT | {"angles": [[0.0] * 7]}, 400, "at least 8"),
        ("perform", MOVEMENT | {"angles": [[0.0] * 8] * 2001}, 400, "at most 2000"),
        ("perform", MOVEMENT | {"more": 1}, 400, "no key `more`"),
        ("perform", b'{"dt": 0.15, "angles": [[NaN,0,0,0,0,0,0,0]]}', 400, "nan"),
        ("perform", b"[" * 100_000, 400, "movement"),
        ("film", MOVEMENT | {"ending": "exe"}, 400, "ending"),
        ("export", {"memory": "half/0", "points": [[9, 9]], "format": "csv"}, 400, "[-1, 1]"),
        ("export", {"memory": "../../etc/passwd", "points": [[0, 0]], "format": "csv"}, 404, "no memory"),
        ("export", {"memory": "half/0", "points": [[0, 0]], "format": "../x"}, 404, "no format"),
        ("favourites", {"memory": "m", "points": []}, 400, "points"),
        ("keyframes", [["<b>", [[0, *GUARD], [1, *GUARD]]]], 400, "should be a letter"),
        ("keyframes", [["a", [[0, *[9.0] * 8], [1, *GUARD]]]], 400, "joints' ranges"),
        ("train", {"drafts": [["a", [[0, *GUARD], [1, *GUARD]]]], "epochs": 10**9}, 400, "at most 300000"),
        ("read?name=a.csv&memory=half/0", b"no,movement\n", 400, "a.csv"),
        ("cells?name=half/0&colour=nope", None, 404, "no colouring"),
        ("cells?name=half/0&left=nan&bottom=0&width=1&n=50", None, 400, "a window should be"),
        ("cells?name=half/0&left=0&bottom=0&width=1&n=5000", None, 400, "from 2 to 200"),
        ("cells?name=half/0&left=0&bottom=0&width=1&n=x", None, 400, "a window is three numbers"),
        ("memory?name=/etc/passwd", None, 404, "no memory"),
        ("memory?name=taught:guess", None, 404, "is gone"),
        ("taught/guess", None, 404, "is gone"),
        ("agent?name=random&memory=half/0&seed=-1", None, 400, "`seed`"),
    ],
)
def test_what_is_no_request_of_the_page_is_refused_in_one_line(ready, path, content, status, said):
    got, answer = ask(ready, f"/api/{path}", content)

    assert got == status
    assert said in answer["error"]
    assert "\n" not in answer["error"]


def test_what_the_page_asks_for_is_answered(ready):
    status, memory = ask(ready, "/api/memory?name=half/0")
    assert status == 200
    assert memory["memory"]["names"][0] == "left jab"
    assert "physical" in memory["colours"]
    assert ask(ready, "/api/cells?name=half/0&colour=physical")[1]["n"] == 200
    assert ask(ready, "/api/cells?name=half/0&colour=speed&left=0&bottom=0&width=0.5&n=10")[1]["n"] == 10
    assert ask(ready, "/api/perform", MOVEMENT)[1]["failure"] is None
    favourite = {"memory": memory["key"], "points": [[0.1, 0.2]], "note": "<b>", "beside": ""}
    assert ask(ready, "/api/favourites", favourite) == (200, {})
    assert ask(ready, f"/api/favourites?key={memory['key']}")[1] == [favourite]
    assert ask(ready, "/api/favourites", favourite, "DELETE") == (200, {})
    assert ask(ready, f"/api/favourites?key={memory['key']}")[1] == []
    table = ask(ready, "/api/export", {"memory": "half/0", "points": [[0.1, 0.2]], "format": "csv"})[1]
    assert table["name"] == "movement.csv"


def test_a_recording_is_read_and_recognised(ready):
    memory = load_memory("half/0")
    rows = ["time_s," + ",".join(memory.joints)]
    rows += [",".join([str(0.15 * tick), *map(str, row)]) for tick, row in enumerate(memory.generate(memory.pb[:1])[0])]
    status, told = ask(ready, "/api/read?memory=half/0&name=..%2Fmine.csv", "\n".join(rows).encode())
    assert status == 200
    np.testing.assert_allclose(told["pb"], memory.pb[0], atol=0.02)
    assert told["error"] < 1


def test_a_body_that_is_too_large_is_refused(ready):
    with socket.create_connection(("127.0.0.1", ready.port), timeout=10) as connection:
        head = (
            f"POST /api/read?name=a.csv HTTP/1.1\r\nHost: 127.0.0.1:{ready.port}\r\nContent-Length: 1000000000\r\n\r\n"
        )
        connection.sendall(head.encode())
        assert connection.recv(100).startswith(b"HTTP/1.1 413")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other loopback addresses exist on Linux only")
def test_it_listens_on_this_machine_only(server):
    with pytest.raises(ConnectionRefusedError), socket.create_connection(("127.0.0.2", server.port), timeout=5):
        pass


def test_a_port_in_use_is_one_line_and_exit_code_2(server, capsys):
    assert main(["explore", "half/0", "--no-open", "--port", str(server.port)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"port {server.port} on 127.0.0.1 cannot be used" in said
    assert "--port" in said


def test_without_the_extra_it_says_what_to_install(monkeypatch, capsys):
    for name in [name for name in sys.modules if name.startswith(("starlette", "creative_nao.explorer"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "starlette", None)
    assert main(["explore", "half/0", "--no-open"]) == 2
    assert 'pip install "creative-nao[explore]"' in capsys.readouterr().err


@pytest.mark.slow
def test_a_restarted_server_returns_to_the_same_point(visit, tmp_path):
    first = Server(tmp_path)
    try:
        tab = visit(f"{first.url}?x=0.3&y=0.6")
        tab.click_map(0.25, 0.25)
        tab.until("() => location.search.includes('x=-0.5')")
        points = tab.points
    finally:
        first.stop()
    second = Server(tmp_path, first.port)
    try:
        tab.page.reload()
        tab.until("() => globalThis.explorer?.panels[0]?.recall")
        assert tab.points == points
    finally:
        second.stop()
        tab.errors.clear()  # what it asked for in between


@pytest.mark.slow
def test_without_webgl_it_still_answers(playwright_run, server):
    browser = playwright_run.chromium.launch(executable_path=CHROMIUM, args=[*FLAGS, "--disable-3d-apis"])
    tab = Visit(browser, server.url)
    tab.click_map(0.25, 0.25)
    assert tab.points == pytest.approx(np.array([[-0.5, 0.5]]), abs=0.01)
    assert tab.page.get_by_text("The robot needs WebGL").is_visible()
    browser.close()
