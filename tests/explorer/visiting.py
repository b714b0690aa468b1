"""A server of the explorer as a process of its own, and a visit to it in a real browser."""

import os
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

PHYSICAL = Path(__file__).parents[2] / "docs" / "results" / "physical" / "half_0.npz"
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chromium-browser")
FLAGS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
]  # fmt: skip


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Server:
    """`creative-nao explore` on a free port; a small map, a cache and a session of its own."""

    pipe = None

    def __init__(self, folder, port=None, words=(), memories=("half/0",)):
        self.port = port or free_port()
        self.url = f"http://127.0.0.1:{self.port}/"
        self.log = folder / "server.log"
        environment = {**os.environ, "CREATIVE_NAO_CACHE": str(folder / "cache")}
        environment.pop("NICEGUI_SCREEN_TEST_PORT", None)
        environment.pop("PYTEST_CURRENT_TEST", None)
        with open(self.log, "wb") as log:
            self.process = subprocess.Popen(
                self.command(folder, words, memories), env=environment, stdin=self.pipe, stdout=self.pipe or log,
                stderr=log, cwd=folder,
            )  # fmt: skip
        deadline = time.monotonic() + 90
        while not self.answers():
            assert self.process.poll() is None, self.log.read_text()
            assert time.monotonic() < deadline, self.log.read_text()
            time.sleep(0.1)

    def command(self, folder, words, memories):
        command = [sys.executable, "-m", "creative_nao", "explore", *memories, "--no-open", "--port", str(self.port)]
        return [*command, "--resolution", "30", "--session", str(folder / "session.json"), *words]

    def answers(self):
        """Tell whether it listens; asking for a page would open one, which the server keeps for a minute."""
        try:
            with socket.create_connection(("127.0.0.1", self.port), timeout=5):
                return True
        except OSError:
            return False

    def stop(self):
        self.process.terminate()
        try:
            self.process.wait(timeout=15)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait(timeout=15)


class Visit:
    """One tab of a browser context of its own, with all that it asked for and all that went wrong."""

    POSE = """() => {
        const scene = window[Object.keys(window).find((key) => key.startsWith("scene_"))];
        const names = ["RShoulder", "RForearm", "LShoulder", "LForearm"].map((name) => "nao/" + name);
        return names.flatMap((name) => scene?.getObjectByName(name)?.quaternion.toArray() ?? []);
    }"""
    MOVED = f"(before) => {{ const now = ({POSE})(); return now.length && "
    MOVED += "Math.max(...now.map((value, k) => Math.abs(value - before[k]))) > 0.02 }"

    def __init__(self, browser, url, ready="novelty", **options):
        self.context = browser.new_context(viewport={"width": 1280, "height": 1000}, **options)
        self.page = self.context.new_page()
        self.requests, self.errors = [], []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(url)
        self.page.wait_for_function(
            "(text) => document.querySelector('[role=status]')?.textContent.includes(text)", arg=ready
        )

    def wait_for_robot(self):
        self.page.wait_for_function(f"({self.POSE})().length === 16 && window.robotPlayer?.duration > 0")

    def wait_for_pose(self):
        self.page.wait_for_function(
            f"({self.POSE})().length === 16 && [...(window.robotPlayer?.robots ?? [])][0]?.movement"
        )

    @property
    def status(self):
        return self.page.locator("[role=status]").first.inner_text()

    def says(self, text, seconds=60):
        self.page.wait_for_function(
            "(text) => document.querySelector('[role=status]')?.textContent.includes(text)",
            arg=text,
            timeout=1000 * seconds,
        )

    def place(self, x, y):
        """Return the page coordinates of a share of the map's width and height, from its upper left corner."""
        box = self.page.locator(".cn-map").first.bounding_box()
        return box["x"] + x * box["width"], box["y"] + y * box["height"]

    def click_map(self, x, y):
        self.page.mouse.click(*self.place(x, y))
