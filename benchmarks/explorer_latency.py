"""How soon after a click does the explorer's robot begin to move, and what does an idle page cost?

    python benchmarks/explorer_latency.py [--clicks 20] [--memory half/0]

A real `creative-nao explore`, the file of `explore --html`, and a headless Chromium that draws in software, on the
machine as it is. A click is a pointer event on the map; it is answered in the frame in which the robot has another
movement. A hover is answered when the card stands there. The processor's time is that of all processes of the browser:
while the robot moves in a loop, and at rest, when it is paused. Two clicks before count for nothing.
"""

import argparse
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chromium-browser")
FLAGS = ["--no-sandbox", "--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
N_WARM, PAUSE_MS, IDLE_S = 2, 250, 10
TIMED = """([x, y, kind]) => new Promise((done) => {
    const stage = explorer.panels[0].stage;
    const like = document.querySelector("#card-like");
    if (kind === "pointermove") like.textContent = "";
    const told = () => kind === "pointerdown" ? stage.movement : like.textContent;
    const before = told();
    const start = performance.now();
    const buttons = kind === "pointerdown" ? 1 : 0;
    const map = document.querySelector("#map");
    const event = (name) => new PointerEvent(name, { clientX: x, clientY: y, buttons, bubbles: true, pointerId: 1 });
    map.dispatchEvent(event(kind));
    if (buttons) map.dispatchEvent(event("pointerup"));
    const look = () => told() !== before ? done(performance.now() - start) : requestAnimationFrame(look);
    requestAnimationFrame(look);
})"""


def processor_s(browser_dir: Path) -> float:
    """Return the processor's time of all processes whose command line names a folder [s]."""
    total = 0
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if str(browser_dir).encode() in (folder / "cmdline").read_bytes():
                fields = (folder / "stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
                total += int(fields[11]) + int(fields[12])
        except OSError:
            continue
    return total / os.sysconf("SC_CLK_TCK")


def measure(running, url: str, n_clicks: int) -> tuple[np.ndarray, float, float]:
    """Return what clicks and hovers took [ms], shape (n_clicks, 2), and the share of a core moving and at rest."""
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        context = running.chromium.launch_persistent_context(
            folder, executable_path=CHROMIUM, args=FLAGS, viewport={"width": 1280, "height": 720}
        )
        page = context.pages[0]
        page.set_default_timeout(300_000)  # drawn in software on a busy machine, the first frame takes its time
        page.goto(url)
        page.wait_for_function("() => globalThis.explorer?.panels[0]?.stage?.movement")
        page.wait_for_timeout(2000)
        box = page.locator("#map").bounding_box()
        took = []
        for share in rng.uniform(0.1, 0.9, (n_clicks + N_WARM, 2, 2)):
            for kind, (x, y) in zip(("pointerdown", "pointermove"), share, strict=True):
                place = [box["x"] + x * box["width"], box["y"] + y * box["height"]]
                took.append(page.evaluate(TIMED, [*place, kind]))
                page.wait_for_timeout(PAUSE_MS)
        page.evaluate("() => document.querySelector('#map').dispatchEvent(new PointerEvent('pointerleave'))")
        shares = []
        for act in ("play", "pause"):
            page.evaluate(f"() => explorer.player.{act}()")
            page.wait_for_timeout(1000)
            before = processor_s(Path(folder))
            time.sleep(IDLE_S)
            shares.append((processor_s(Path(folder)) - before) / IDLE_S)
        context.close()
    return np.array(took).reshape(-1, 2)[N_WARM:], *shares


def serve(folder: Path, memory: str) -> tuple[subprocess.Popen, str]:
    """Start the explorer on a free port and wait until it answers."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "creative_nao", "explore", memory, "--no-open", "--port", str(port)]
    command += ["--session", str(folder / "session.json"), "--resolution", "60"]
    process = subprocess.Popen(command, env={**os.environ, "CREATIVE_NAO_CACHE": str(folder)}, stdout=sys.stderr)
    for _ in range(600):
        try:
            socket.create_connection(("127.0.0.1", port), timeout=5).close()
            return process, f"http://127.0.0.1:{port}/"
        except OSError:
            time.sleep(0.2)
    raise SystemExit("the explorer does not answer")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clicks", type=int, default=20)
    parser.add_argument("--memory", default="half/0")
    options = parser.parse_args()
    if CHROMIUM is None:
        raise SystemExit("no Chromium; install your distribution's package `chromium`")
    print("| page | click to motion (ms) | quartiles (ms) | hover to card (ms) | a core, moving | at rest |")
    print("| --- | ---: | --- | ---: | ---: | ---: |")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as running:
        alone = Path(folder) / "alone.html"
        command = [sys.executable, "-m", "creative_nao", "explore", options.memory, "--html", str(alone)]
        subprocess.run([*command, "--resolution", "60"], check=True, stdout=sys.stderr)
        process, served = serve(Path(folder), options.memory)
        try:
            for name, url in (("served", served), ("file", alone.as_uri())):
                took, moving, rest = measure(running, url, options.clicks)
                low, middle, high = np.percentile(took[:, 0], (25, 50, 75))
                hover = np.median(took[:, 1])
                print(
                    f"| {name} | {middle:.0f} | {low:.0f} to {high:.0f} | {hover:.0f} | {moving:.0%} | {rest:.0%} |",
                    flush=True,
                )
        finally:
            process.terminate()
            process.wait(timeout=60)
    return 0


if __name__ == "__main__":
    sys.exit(main())
