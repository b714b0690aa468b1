"""The explorer's server: whom it answers, what it survives, what it says when it cannot start."""

import asyncio
import socket
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from visiting import CHROMIUM, FLAGS, Server, Visit

from creative_nao.cli import main
from creative_nao.explorer.server import AT_ONCE, ConcurrencyLimit


def raw(port, request):
    with socket.create_connection(("127.0.0.1", port), timeout=10) as connection:
        connection.sendall(request.replace("\n", "\r\n").encode() + b"\r\n\r\n")
        return connection.recv(4096).decode("latin-1")


def test_a_foreign_host_or_origin_is_refused(server):
    page = raw(server.port, "GET / HTTP/1.1\nHost: evil.example\nConnection: close")
    assert page.startswith("HTTP/1.1 403")
    upgrade = "Connection: Upgrade\nUpgrade: websocket\nSec-WebSocket-Version: 13\n"
    upgrade += "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA=="
    path = "GET /_nicegui_ws/socket.io/?EIO=4&transport=websocket HTTP/1.1"
    own = f"Host: 127.0.0.1:{server.port}"
    assert raw(server.port, f"{path}\n{own}\n{upgrade}\nOrigin: http://evil.example").startswith("HTTP/1.1 403")
    assert raw(server.port, f"{path}\n{own}\n{upgrade}\nOrigin: http://127.0.0.1:{server.port}").startswith(
        "HTTP/1.1 101"
    )
    assert raw(server.port, f"GET / HTTP/1.1\n{own}\nConnection: close").startswith("HTTP/1.1 200")


def play(scene):
    """Run a coroutine in a thread of its own: once a browser is open, Playwright keeps a loop running in this one."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(lambda: asyncio.run(scene())).result()


def test_of_pages_asked_for_at_once_the_first_comes_early(server):
    """Let in together, twelve pages come together: the first took as long as the last, 0.95 of it and more."""
    page = f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nConnection: close\r\n\r\n".encode()

    async def came(reader):
        assert (await reader.readline()).startswith(b"HTTP/1.1 200")
        return time.monotonic()

    async def scene():
        opened = [await asyncio.open_connection("127.0.0.1", server.port) for _ in range(12)]
        start = time.monotonic()
        for _, writer in opened:
            writer.write(page)
        took = sorted(one - start for one in await asyncio.gather(*(came(reader) for reader, _ in opened)))
        for _, writer in opened:
            writer.close()
        return took

    took = play(scene)
    assert took[0] < 0.6 * took[-1], took


def test_a_turn_ends_when_the_answer_begins_or_fails():
    async def app(scope, receive, send):
        entered.append(scope["path"])
        if receive is None:
            raise OSError("gone")
        await receive()
        await send("head")
        await never.wait()  # a reader who never takes the rest

    async def tell(message):
        said.append(message)

    async def scene():
        door, ready = ConcurrencyLimit(app, ("/",)), asyncio.Event()
        ask = [asyncio.create_task(door({"type": "http", "path": "/"}, ready.wait, tell)) for _ in range(AT_ONCE + 3)]
        other = asyncio.create_task(door({"type": "http", "path": "/other"}, ready.wait, tell))
        await asyncio.sleep(0.01)
        assert sorted(entered) == ["/"] * AT_ONCE + ["/other"]
        ready.set()
        await asyncio.sleep(0.01)
        assert len(said) == len(entered) == AT_ONCE + 4
        for _ in range(AT_ONCE + 1):
            with pytest.raises(OSError, match="gone"):
                await asyncio.wait_for(door({"type": "http", "path": "/"}, None, tell), 5)
        never.set()
        await asyncio.gather(*ask, other)

    entered, said, never = [], [], asyncio.Event()
    play(scene)


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
    for name in [name for name in sys.modules if name.startswith(("nicegui", "creative_nao.explorer"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "nicegui", None)
    assert main(["explore", "half/0", "--no-open"]) == 2
    assert 'pip install "creative-nao[explore]"' in capsys.readouterr().err


@pytest.mark.slow
def test_a_restarted_server_returns_to_the_same_point(visit, tmp_path):
    first = Server(tmp_path)
    try:
        tab = visit(f"{first.url}?x=0.3&y=0.6")
        tab.click_map(0.25, 0.25)
        tab.says("PB -0.517, 0.517")
    finally:
        first.stop()
    second = Server(tmp_path, first.port)
    try:
        tab.page.reload()
        tab.says("PB -0.517, 0.517")
    finally:
        second.stop()


@pytest.mark.slow
def test_without_webgl_it_still_answers(playwright_run, server):
    browser = playwright_run.chromium.launch(executable_path=CHROMIUM, args=[*FLAGS, "--disable-3d-apis"])
    tab = Visit(browser, server.url)
    tab.click_map(0.25, 0.25)
    tab.says("PB -0.517, 0.517")
    assert tab.page.get_by_text("The robot needs WebGL").is_visible()
    browser.close()
