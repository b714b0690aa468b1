"""How soon after a click does the explorer's robot begin to move, and what does an idle page cost?

    python benchmarks/explorer_latency.py [--clicks 20] [--memory half/0]
    python benchmarks/explorer_latency.py --play 10 [--actions 900]
    python benchmarks/explorer_latency.py --start

A real `creative-nao explore`, the file of `explore --html`, and a headless Chromium that draws in software, on the
machine as it is. A click is a pointer event on the map; it is answered in the frame in which the robot has another
movement. A hover is answered when the card stands there. The processor's time is that of all processes of the browser:
while the robot moves in a loop, and at rest, when it is paused. Two clicks before count for nothing.

`--play` plays for so many minutes, evenly spread over them what a person does in half an hour at an action every two
seconds: clicks, drags, hovers, surprises, undo, zoom, colours, details, favourites, physics, a second memory, races.
Ten times it says what the page holds after a garbage collection: JavaScript's heap, elements and listeners of the
document, geometries, textures and programs of the graphics library, its drawing contexts.

`--start` says how long it takes from the command to an answering page and to a robot that moves in the browser: with
an empty `NUMBA_CACHE_DIR`, as the first time on a machine, and once more with what that compiled.
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


# Each in a page's own words; [x, y] are shares of the map, `n` counts the actions.
PLAYED = {
    "click": (8, "([x, y]) => { at('pointerdown', x, y, 1); at('pointerup', x, y, 0); }"),
    "drag": (4, "([x, y]) => { at('pointerdown', x, y, 1); for (const k of [0, 0.2, 0.4, 0.6])"
                " at('pointermove', x + (0.5 - x) * k, y, 1); at('pointerup', x, y, 0); }"),
    "hover": (6, "([x, y]) => at('pointermove', x, y, 0)"),
    "find": (5, "([x]) => press(['surprise', 'more', 'less', 'undo', 'redo'][Math.floor(5 * x)])"),
    "zoom": (2, "([x]) => press(['zoom-in', 'zoom-out', 'whole'][Math.floor(3 * x)])"),
    "details": (1, "() => press('open-drawer')"),
    "colour": (1, "([x]) => choose('colour', x)"),
    "favourite": (1, "([x]) => { press('star'); document.querySelector('.favourite .remove')?.click(); }"),
    "physics": (0.5, "() => press('physics')"),
    "second memory": (0.3, "([x]) => choose('beside', x < 0.5 ? 0 : 0.1 * x)"),
    "race": (0.2, "() => press('race')"),
    "end of a race": (0.4, "() => [...document.querySelectorAll('#stop button')].at(-1)?.click()"),
}  # fmt: skip
HELPERS = """() => {
    globalThis.press = (id) => document.getElementById(id).click();
    globalThis.choose = (id, share) => {
        const list = document.getElementById(id);
        list.selectedIndex = Math.floor(share * list.options.length);
        list.dispatchEvent(new Event("change"));
    };
    globalThis.at = (kind, x, y, buttons) => {
        const box = document.querySelector("#map").getBoundingClientRect();
        const place = { clientX: box.left + x * box.width, clientY: box.top + y * box.height, buttons, pointerId: 1 };
        document.querySelector("#map").dispatchEvent(new PointerEvent(kind, { ...place, bubbles: true }));
    };
}"""
HELD = """() => {
    const infos = explorer.player.stages.map((stage) => stage.renderer.info);
    const sum = (of) => infos.reduce((total, info) => total + of(info), 0);
    return [sum((i) => i.memory.geometries), sum((i) => i.memory.textures), sum((i) => i.programs.length),
        document.querySelectorAll("canvas").length];
}"""


def play(running, url: str, minutes: float, n_actions: int) -> None:
    """Play, and print what the page holds ten times on the way."""
    rng = np.random.default_rng(0)
    weights = np.array([weight for weight, _ in PLAYED.values()])
    print("| minute | actions | heap (MB) | elements | listeners | geometries | textures | programs | canvases |")
    print("| ---: " * 9 + "|")
    with tempfile.TemporaryDirectory() as folder:
        context = running.chromium.launch_persistent_context(
            folder, executable_path=CHROMIUM, args=FLAGS, viewport={"width": 1000, "height": 620}
        )
        page = context.pages[0]
        page.set_default_timeout(300_000)
        page.goto(url)
        page.wait_for_function("() => globalThis.explorer?.panels[0]?.stage?.movement")
        page.evaluate(HELPERS)
        session = context.new_cdp_session(page)
        session.send("Performance.enable")
        begun, heaps = time.monotonic(), []
        for done in range(n_actions + 1):
            if done % (n_actions // 10) == 0:
                page.evaluate("() => [...document.querySelectorAll('#stop button')].at(-1)?.click()")
                page.evaluate("() => choose('beside', 0)")
                page.wait_for_timeout(2_000)
                session.send("HeapProfiler.collectGarbage")
                told = {one["name"]: one["value"] for one in session.send("Performance.getMetrics")["metrics"]}
                heaps.append(told["JSHeapUsedSize"] / 1e6)
                row = [told["Nodes"], told["JSEventListeners"], *page.evaluate(HELD)]
                minute = (time.monotonic() - begun) / 60
                print(
                    f"| {minute:.1f} | {done} | {heaps[-1]:.1f} | {' | '.join(f'{n:.0f}' for n in row)} |", flush=True
                )
            kind = str(rng.choice(list(PLAYED), p=weights / weights.sum()))
            page.evaluate(PLAYED[kind][1], rng.uniform(0.05, 0.95, 2).tolist())
            wait_s = begun + (done + 1) * 60 * minutes / n_actions - time.monotonic()
            page.wait_for_timeout(1000 * max(0.02, wait_s))
        context.close()
    early, late = np.mean(heaps[2:6]), np.mean(heaps[-4:])
    print(f"heap: {early:.1f} MB in the samples 3 to 6, {late:.1f} MB in the last four")


def started(running, name: str, folder: Path, memory: str) -> None:
    """Print how long a start takes until the server answers, is ready, and the robot moves in the browser [s]."""
    context = running.chromium.launch(executable_path=CHROMIUM, args=FLAGS).new_context()
    page = context.new_page()
    page.set_default_timeout(600_000)
    page.goto("about:blank")
    begun = time.monotonic()
    process, url = serve(folder, memory)
    try:
        page.goto(url)
        answers = time.monotonic() - begun
        page.wait_for_function("() => globalThis.explorer?.panels[0]?.stage?.frames > 2")
        print(f"| {name} | {answers:.1f} | {time.monotonic() - begun:.1f} |", flush=True)
    finally:
        process.terminate()
        process.wait(timeout=60)
        context.browser.close()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clicks", type=int, default=20)
    parser.add_argument("--memory", default="half/0")
    parser.add_argument("--play", type=float, metavar="MINUTES", help="what the page holds while it is played with")
    parser.add_argument("--actions", type=int, default=900, help="of --play: half an hour's, one every two seconds")
    parser.add_argument("--start", action="store_true", help="how long the first start takes, and the next")
    options = parser.parse_args()
    if CHROMIUM is None:
        raise SystemExit("no Chromium; install your distribution's package `chromium`")
    if options.start:
        print("| start | page answers (s) | robot moves (s) |")
        print("| --- | ---: | ---: |")
        with tempfile.TemporaryDirectory() as folder, sync_playwright() as running:
            os.environ["NUMBA_CACHE_DIR"] = f"{folder}/numba"
            for name in ("first, compiling", "next"):
                started(running, name, Path(folder), options.memory)
        return 0
    if options.play:
        with tempfile.TemporaryDirectory() as folder, sync_playwright() as running:
            process, served = serve(Path(folder), options.memory)
            try:
                play(running, served, options.play, options.actions)
            finally:
                process.terminate()
                process.wait(timeout=60)
        return 0
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
