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

    def __init__(self, folder, port=None, words=(), memories=("half/0",)):
        self.port = port or free_port()
        self.url = f"http://127.0.0.1:{self.port}/"
        self.log, self.session = folder / "server.log", folder / "session.json"
        environment = {**os.environ, "CREATIVE_NAO_CACHE": str(folder / "cache")}
        with open(self.log, "wb") as log:
            self.process = subprocess.Popen(
                self.command(folder, words, memories), env=environment, stdout=log, stderr=log, cwd=folder,
            )  # fmt: skip
        deadline = time.monotonic() + 90
        while not self.answers():
            assert self.process.poll() is None, self.log.read_text()
            assert time.monotonic() < deadline, self.log.read_text()
            time.sleep(0.1)

    def command(self, folder, words, memories):
        command = [sys.executable, "-m", "creative_nao", "explore", *memories, "--no-open", "--port", str(self.port)]
        small = [] if "--resolution" in words else ["--resolution", "30"]
        return [*command, *small, "--session", str(self.session), *words]

    def answers(self):
        """Tell whether it listens."""
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


POSE = """() => ["RShoulder", "RForearm", "LShoulder", "LForearm"].flatMap((name) =>
    explorer.panels[0]?.stage?.robot.nodes["nao/" + name].quaternion.toArray() ?? [])"""
MOVED = f"(before) => {{ const now = ({POSE})(); return now.length === before.length && "
MOVED += "Math.max(...now.map((value, k) => Math.abs(value - before[k]))) > 0.02 }"


class Visit:
    """One tab of a browser context of its own, with all that it asked for and all that went wrong.

    The robot stands unless `plays`: drawing it in software takes a core.
    """

    def __init__(self, browser, url, size=(1280, 720), plays=False, **options):
        motion = "no-preference" if plays else "reduce"
        size = {"width": size[0], "height": size[1]}
        self.context = browser.new_context(viewport=size, reduced_motion=motion, **options)
        self.page = self.context.new_page()
        self.page.set_default_timeout(60_000)
        self.requests, self.errors = [], []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", lambda line: line.type == "error" and self.errors.append(line.text))
        self.page.goto(url)
        self.page.wait_for_function("() => !document.body.classList.contains('loading')")

    def __call__(self, script, argument=None):
        """Return what a function in the page returns."""
        return self.page.evaluate(script, argument)

    def until(self, script, argument=None, seconds=60):
        self.page.wait_for_function(script, arg=argument, timeout=1000 * seconds)

    @property
    def points(self):
        return self("() => explorer.points")

    @property
    def status(self):
        return self.page.locator("#status").text_content()

    def says(self, text, seconds=60):
        self.until("(text) => document.querySelector('#status').textContent.includes(text)", text, seconds)

    def pose(self):
        return self(POSE)

    def moved(self, before):
        self.until(MOVED, before)

    def press(self, name):
        self.page.get_by_role("button", name=name, exact=True).click()

    def place(self, x, y, selector="#map"):
        """Return the page coordinates of a share of the map's width and height, from its upper left corner."""
        box = self.page.locator(selector).bounding_box()
        return box["x"] + x * box["width"], box["y"] + y * box["height"]

    def click_map(self, x, y):
        self.page.mouse.click(*self.place(x, y))

    def resting(self):
        """Stop the player and wait until nothing is drawn any more."""
        self("() => explorer.player.pause()")
        self.page.wait_for_timeout(600)
