"""Does the explorer free what its tabs held? Fifty tabs open, click and vanish, again and again.

    python benchmarks/explorer_tabs.py [--tabs 50] [--clicks 5] [--rounds 4] [--out FILE]

The server is `creative-nao explore` itself, as it is; the tabs are plain clients that do what a browser does to it: ask
for the page, open its socket, click on the map, wait until the page tells of the movement there. A tab that the server
refuses or hangs up on, or whose click is not answered in two minutes, ends the benchmark with the reason. Nothing is
drawn, so what is measured is the server's. Of every four tabs one leaves in order, one has its connection cut, one goes
silent and is given up by the heartbeat, and one asks for the page and never comes back. After each round, when the
server has had the time to free them, its resident memory, threads and open files are read from /proc (so it needs
Linux). Memory counts as flat when it grows by less than 16 MB after the first round, in which caches fill. Exits with 1
if anything grew.
"""

import argparse
import asyncio
import json
import os
import re
import socket
import subprocess
import sys
import tempfile
import time
import uuid
from dataclasses import asdict, dataclass
from pathlib import Path

import aiohttp
import numpy as np

WAYS = ("leaves", "cut", "silent", "never came")
HEARTBEAT_S, NEVER_CAME_S, ALLOWED_MB = 60.0, 75.0, 16.0
ANSWER_S = 120.0
SAID = re.compile(r"\bPB (-?\d\.\d+), (-?\d\.\d+); [^\"]*?novelty")
HALF_MAP, NEAR = 300, 0.03
"""Half the pixels of the map, and how far the point told may lie from the middle of a pixel: the map begins with cells
of 1/39 and is then exchanged for a finer one, and the edge of what it shows lies half a cell beyond the PB space."""


@dataclass(frozen=True)
class Sample:
    """What the server holds after a round."""

    round: int
    n_tabs: int
    n_movements: int
    peak_mb: float
    resident_mb: float
    n_threads: int
    n_files: int


class TabLostError(Exception):
    """The server hung up on a tab, or would not have it."""


class PlainTab:
    """One tab without a browser: Engine.IO and Socket.IO by hand, over one websocket."""

    def __init__(self, session: aiohttp.ClientSession, url: str) -> None:
        self.session, self.url = session, url
        self.told = asyncio.Queue()
        self.ws = None
        self._listening = None

    async def ask(self) -> None:
        """Ask for the page and read its identity and its map's listener."""
        async with self.session.get(self.url) as answer:
            page = await answer.text()
        self.client_id = re.search(r"'client_id': '([0-9a-f-]+)'", page)[1]
        elements = json.loads(re.search(r"parseElements\(String\.raw`(.*?)`\)", page, re.DOTALL)[1])
        self.map_id, found = next((int(key), one) for key, one in elements.items() if "cn-map" in one.get("class", ()))
        self.listener = next(event["listener_id"] for event in found["events"] if event["type"] == "mouse")

    async def connect(self) -> None:
        """Open the socket; from now on every ping is answered."""
        words = {"client_id": self.client_id, "next_message_id": 0, "implicit_handshake": "true"}
        words |= {"document_id": str(uuid.uuid4()), "tab_id": str(uuid.uuid4()), "EIO": 4, "transport": "websocket"}
        self.ws = await self.session.ws_connect(f"{self.url}_nicegui_ws/socket.io/", params=words)
        if (await self.ws.receive()).type is not aiohttp.WSMsgType.TEXT:
            raise TabLostError("the server hung up on the socket that it was asked for")
        await self.ws.send_str("40")
        self._listening = asyncio.create_task(self._listen())

    async def _listen(self) -> None:
        """Note what the page says of movements until the server hangs up, which ends in the reason for it."""
        async for message in self.ws:
            if message.type is not aiohttp.WSMsgType.TEXT:
                continue
            if message.data == "2":
                await self.ws.send_str("3")
            elif message.data.startswith(("41", "44")):
                raise TabLostError(f"the server refused: {message.data:.200}")
            for first, second in SAID.findall(message.data):
                self.told.put_nowait((float(first), float(second)))
        raise TabLostError(f"the server hung up with code {self.ws.close_code} ({self.ws.exception()})")

    async def click(self, x: float, y: float) -> None:
        """Click on a pixel of the map and wait until the page tells of the movement there.

        Raises:
            TabLostError: At once if the server hangs up, and after two minutes without an answer.
        """
        args = [json.dumps({"mouse_event_type": "pointerdown", "image_x": x, "image_y": y, "buttons": 1})]
        event = {"id": self.map_id, "client_id": self.client_id, "listener_id": self.listener, "args": args}
        await self.ws.send_str("42" + json.dumps(["event", event]))
        wanted, heard = (x / HALF_MAP - 1, 1 - y / HALF_MAP), []
        deadline = time.monotonic() + ANSWER_S
        while not heard or max(abs(a - b) for a, b in zip(heard[-1], wanted, strict=True)) > NEAR:
            telling = asyncio.ensure_future(self.told.get())
            patience = deadline - time.monotonic()
            await asyncio.wait({telling, self._listening}, timeout=patience, return_when=asyncio.FIRST_COMPLETED)
            if telling.done():
                heard.append(telling.result())
                continue
            telling.cancel()
            if self._listening.done():
                self._listening.result()
            raise TabLostError(f"no answer in {ANSWER_S:.0f} s to a click at {wanted}; told of {heard}")

    async def vanish(self, way: str) -> None:
        """Go, in one of `WAYS`."""
        if self._listening is not None:
            self._listening.cancel()
        if way == "leaves":
            await self.ws.send_str("41")
            await self.ws.close()
        elif way == "cut":
            self.ws.get_extra_info("socket").setsockopt(
                socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0"
            )  # a reset instead of a farewell
            self.ws._response.connection.transport.abort()


async def visit(session: aiohttp.ClientSession, url: str, place: int, n_clicks: int) -> PlainTab:
    """Open a tab and click; return it, still open."""
    rng = np.random.default_rng(place)
    tab = PlainTab(session, url)
    await tab.ask()
    if WAYS[place % len(WAYS)] != "never came":
        await tab.connect()
        for number, (x, y) in enumerate(rng.uniform((0, 0), (280, 600), (n_clicks, 2))):
            await tab.click(float(x) + 320 * (number % 2), float(y))  # left and right in turn: every answer is another
    return tab


def held(process: int) -> tuple[float, int, int]:
    """Return resident memory [MB], threads and open files of a process."""
    status = dict(line.split(":", 1) for line in Path(f"/proc/{process}/status").read_text("ascii").splitlines())
    return int(status["VmRSS"].split()[0]) / 1024, int(status["Threads"]), len(os.listdir(f"/proc/{process}/fd"))


async def one_round(number: int, url: str, process: int, n_tabs: int, n_clicks: int) -> Sample:
    """Open all tabs at once, click, vanish, wait, measure."""
    timeout = aiohttp.ClientTimeout(total=300)
    async with aiohttp.ClientSession(
        connector=aiohttp.TCPConnector(limit=0, force_close=True), timeout=timeout
    ) as session:
        tabs = await asyncio.gather(*(visit(session, url, place, n_clicks) for place in range(n_tabs)))
        peak = held(process)[0]
        for place, tab in enumerate(tabs):
            await tab.vanish(WAYS[place % len(WAYS)])
        await asyncio.sleep(HEARTBEAT_S + NEVER_CAME_S)
    n_movements = n_clicks * sum(WAYS[place % len(WAYS)] != "never came" for place in range(n_tabs))
    return Sample(number, n_tabs, n_movements, peak, *held(process))


def serve(folder: Path, memory: str = "half/0") -> tuple[subprocess.Popen, str]:
    """Start the explorer on a free port and wait until it answers."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "creative_nao", "explore", memory, "--no-open", "--port", str(port)]
    command += ["--session", str(folder / "session.json"), "--resolution", "60"]
    environment = {**os.environ, "CREATIVE_NAO_CACHE": str(folder), "PYTHONFAULTHANDLER": "1"}
    process = subprocess.Popen(command, env=environment, stdout=sys.stderr)
    for _ in range(600):
        try:
            socket.create_connection(("127.0.0.1", port), timeout=5).close()  # asking for a page would open a tab
            return process, f"http://127.0.0.1:{port}/"
        except OSError:
            time.sleep(0.2)
    raise SystemExit("the explorer does not answer")


def end(process: subprocess.Popen) -> None:
    """Ask a server to end, and after a minute do not ask any more."""
    process.terminate()
    try:
        process.wait(timeout=60)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def table(samples: list[Sample]) -> str:
    """Return a Markdown table."""
    lines = [
        "| after round | tabs | movements | at its peak (MB) | memory (MB) | threads | files |",
        "|" + " ---: |" * 7,
    ]
    for one in samples:
        lines.append(
            f"| {one.round} | {one.n_tabs} | {one.n_movements} | {one.peak_mb:.1f} | {one.resident_mb:.1f} | "
            f"{one.n_threads} | {one.n_files} |"
        )
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tabs", type=int, default=50)
    parser.add_argument("--clicks", type=int, default=5, help="clicks in each tab")
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--out", type=Path, help="write every sample here as JSON")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        process, url = serve(Path(folder))
        try:
            samples = []
            for number in range(1, options.rounds + 1):
                samples.append(asyncio.run(one_round(number, url, process.pid, options.tabs, options.clicks)))
                print(samples[-1], file=sys.stderr, flush=True)
        except TabLostError as lost:
            ended = process.poll()
            fate = "still runs" if ended is None else f"has ended with {ended}"
            raise SystemExit(f"round {number}: {lost}; the server {fate}") from None
        finally:
            end(process)
    if options.out is not None:
        options.out.write_text(json.dumps([asdict(one) for one in samples], indent=1) + "\n", encoding="utf-8")
    print(table(samples))
    first, last = samples[0], samples[-1]
    flat = last.resident_mb - first.resident_mb < ALLOWED_MB
    return 0 if flat and last.n_threads <= first.n_threads and last.n_files <= first.n_files else 1


if __name__ == "__main__":
    sys.exit(main())
