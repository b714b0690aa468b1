"""How long after a click on the explorer's map does the robot begin the movement there?

    python benchmarks/explorer_latency.py [--clicks 20] [--memory half/0]

A real `creative-nao explore` and a headless Chromium that draws in software, on the machine as it is. A click is a
pointer event on the map; it is answered in the frame in which the robot has another movement: the server has made the
movement, scored and told it, and the browser has it. Beside each click, in turn with it, stands an empty round trip:
the pointer passes over the map and the line below tells what lies there, over the same socket and into the same frames,
but no movement is made and nothing else drawn. The ratio of the two says more than the milliseconds do, which are those
of this machine and of what else runs on it. Two clicks and passes before count for nothing.
"""

import argparse
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np
from explorer_tabs import end, serve  # the script beside this one
from playwright.sync_api import sync_playwright

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chromium-browser")
FLAGS = ["--no-sandbox", "--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
N_WARM, PAUSE_MS = 2, 250
TIMED = """([x, y, kind]) => new Promise((done) => {
    const [map, robot] = [document.elementFromPoint(x, y), [...window.robotPlayer.robots][0]];
    const told = () => kind === "pointerdown" ? robot.movement : document.querySelector(".cn-hover").textContent;
    const before = told();
    const start = performance.now();
    const buttons = kind === "pointerdown" ? 1 : 0;
    map.dispatchEvent(new PointerEvent(kind, {clientX: x, clientY: y, buttons, bubbles: true, pointerId: 1}));
    const look = () => told() !== before ? done(performance.now() - start) : requestAnimationFrame(look);
    look();
})"""


def measure(url: str, n_clicks: int) -> np.ndarray:
    """Return what each click and the pass of the pointer after it took [ms], shape (n_clicks, 2)."""
    rng = np.random.default_rng(0)
    with sync_playwright() as running:
        browser = running.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        page = browser.new_page(viewport={"width": 1280, "height": 1000})
        page.set_default_timeout(300_000)  # drawn in software on a busy machine, the first frame takes its time
        page.goto(url)
        page.wait_for_function("[...(window.robotPlayer?.robots ?? [])][0]?.movement")
        box = page.locator(".cn-map").bounding_box()
        took = []
        for share in rng.uniform(0.1, 0.9, (n_clicks + N_WARM, 2, 2)):
            for kind, (x, y) in zip(("pointerdown", "pointermove"), share, strict=True):
                place = [box["x"] + x * box["width"], box["y"] + y * box["height"]]
                took.append(page.evaluate(TIMED, [*place, kind]))
                page.wait_for_timeout(PAUSE_MS)
        browser.close()
    return np.array(took).reshape(-1, 2)[N_WARM:]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clicks", type=int, default=20)
    parser.add_argument("--memory", default="half/0")
    options = parser.parse_args()
    if CHROMIUM is None:
        raise SystemExit("no Chromium; install your distribution's package `chromium`")
    with tempfile.TemporaryDirectory() as folder:
        process, url = serve(Path(folder), options.memory)
        try:
            took = measure(url, options.clicks)
        finally:
            end(process)
    print(
        f"| {options.clicks} of each | lower quartile (ms) | median (ms) | upper quartile (ms) |\n| --- |"
        + " ---: |" * 3
    )
    for name, column in zip(("click to movement", "empty round trip"), took.T, strict=True):
        print(f"| {name} | " + " | ".join(f"{one:.0f}" for one in np.percentile(column, (25, 50, 75))) + " |")
    low, middle, high = np.percentile(took[:, 0] / took[:, 1], (25, 50, 75))
    print(f"\na click takes {middle:.2f} times as long as the round trip beside it (quartiles {low:.2f} to {high:.2f})")
    return 0


if __name__ == "__main__":
    sys.exit(main())
