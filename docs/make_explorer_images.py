"""Take the documentation's pictures of the explorer again: `python docs/make_explorer_images.py [desktop ...]`.

A real `creative-nao explore` and a headless Chromium, as in the tests of the page.
"""

import argparse
import io
import os
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import Browser, sync_playwright

IMAGES = Path(__file__).parent / "images"
sys.path.insert(0, str(IMAGES.parents[1] / "tests" / "explorer"))

from visiting import CHROMIUM, FLAGS, Server, Visit  # noqa: E402

from creative_nao import load_memory  # noqa: E402
from creative_nao.explorer.registry import cached_map  # noqa: E402
from creative_nao.maps.figure_style import save_small  # noqa: E402
from creative_nao.robot import write_gif  # noqa: E402

MEMORIES, RESOLUTION = ("half/0", "open/0"), 200
DESKTOP, SMALL, PHONE = (1440, 900), (1280, 720), (390, 844)
MOMENT_S = 1.05
"""Of the movement, at which the robot is shown."""
FAVOURITES = ((0.62, 0.31), (-0.35, 0.52), (0.1, -0.72), (-0.7, -0.1))


def explore(
    browser: Browser, url: str, query: str, *, size: tuple[int, int] = SMALL, dark: bool = False, card: bool = False
) -> bytes:
    """Return a PNG of the page at an address, the robot standing still at one moment of its movement."""
    tab = Visit(browser, f"{url}{query}", size=size, color_scheme="dark" if dark else "light")
    tab(f"() => explorer.player.seek({MOMENT_S})")
    if card:
        tab.page.mouse.move(*tab.place(0.62, 0.18))
    return _taken(tab)


def teach(browser: Browser, url: str) -> bytes:
    """Return a PNG of the page for teaching, with a posture chosen."""
    tab = Visit(browser, f"{url}teach", size=DESKTOP)
    tab.page.locator(".key").nth(2).click()
    return _taken(tab)


FILM_STEPS, FILM_S, FILM_PX = 42, 0.14, (720, 405)


def film(browser: Browser, url: str) -> None:
    """Write images/explorer.gif: a finger goes over the map, and the robot follows."""
    tab = Visit(browser, f"{url}?x=-0.5&y=0.55", size=(1280, 720))
    tab.page.wait_for_timeout(3_000)
    images = []
    tab.page.mouse.move(*tab.place(0.25, 0.22))
    tab.page.mouse.down()
    for step in range(FILM_STEPS):
        angle = 2 * np.pi * step / FILM_STEPS
        tab.page.mouse.move(*tab.place(0.5 - 0.30 * np.cos(angle), 0.42 - 0.22 * np.sin(angle)))
        tab(f"() => explorer.player.seek({0.6 + FILM_S * step} % explorer.player.duration)")
        tab.page.wait_for_timeout(120)
        images.append(_small(tab))
    tab.context.close()
    write_gif(images, IMAGES / "explorer.gif", frame_dt_s=FILM_S)


RACE_MEMORY, RACE_STEPS_MS, RACE_TURNS, LAST = "half/12", (250, 600), 33, 8
"""The race is on a memory of the test part, that no training has seen; a picture after the first step of a turn."""
FINE = "() => explorer.player.stages.forEach((stage) => { stage.adapt = () => {}; })"


def race(browser: Browser) -> None:
    """Write images/explorer_race.gif: the learned map against uniform sampling, as the page shows it."""
    with tempfile.TemporaryDirectory() as folder:
        server = Server(Path(folder), words=["--resolution", "100"], memories=(RACE_MEMORY,))
        try:
            tab = Visit(browser, server.url, size=(1280, 720), plays=True)
            tab.page.set_default_timeout(600_000)
            tab.page.clock.install(time=0)  # the page's time goes on by what a picture needs, however slow the machine
            tab.page.clock.pause_at(600)
            tab.press("Watch agents")
            tab.page.locator(".dot.b").first.wait_for()
            tab(FINE)  # pictures that take long are no reason for coarser ones here
            images = []
            for turn in range(RACE_TURNS):
                tab.page.clock.fast_forward(RACE_STEPS_MS[0])
                if turn > 5 or turn % 2 == 0:  # the first three tries last twice as long
                    images.append(_small(tab))
                tab.page.clock.fast_forward(RACE_STEPS_MS[1])
            tab.page.get_by_text("wins:").wait_for()
            images += [_small(tab)] * LAST
            tab.context.close()
        finally:
            server.stop()
    write_gif(images, IMAGES / "explorer_race.gif", frame_dt_s=0.2)


def _small(tab: Visit) -> np.ndarray:
    picture = Image.open(io.BytesIO(tab.page.screenshot())).convert("RGB")
    return np.asarray(picture.resize(FILM_PX, Image.Resampling.LANCZOS))


def _taken(tab: Visit) -> bytes:
    tab.page.wait_for_timeout(3_000)  # the robot's posture and finer maps settle
    png = tab.page.screenshot()
    assert not tab.errors, tab.errors
    tab.context.close()
    return png


def keep_favourites(browser: Browser, url: str) -> None:
    """Fill the strip."""
    for x, y in FAVOURITES:
        tab = Visit(browser, f"{url}?x={x}&y={y}")
        tab.press("Keep as favourite")
        tab.page.locator(".favourite").first.wait_for()
        tab.context.close()


PICTURES = {
    "desktop": lambda browser, url: explore(browser, url, "?x=0.45&y=0.62", size=DESKTOP, card=True),
    "small": lambda browser, url: explore(browser, url, "?x=0.45&y=0.62"),
    "dark": lambda browser, url: explore(browser, url, "?x=0.3&y=0.2&colour=novelty", dark=True),
    "phone": lambda browser, url: explore(browser, url, "?x=0.3&y=0.2", size=PHONE),
    "twin": lambda browser, url: explore(browser, url, "?x=0.3&y=0.2&beside=open/0"),
    "teach": teach,
}


def main() -> None:
    """Take the pictures that are asked for."""
    known = [*PICTURES, "film", "race"]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pictures", nargs="*", metavar="PICTURE", help=f"of {', '.join(known)}; default: all")
    names = parser.parse_args().pictures or known
    if unknown := [name for name in names if name not in known]:
        parser.error(f"no picture `{unknown[0]}`; there are {', '.join(known)}")
    if CHROMIUM is None:
        raise SystemExit("no Chromium; install your distribution's package `chromium`")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as running:
        browser = running.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        if "race" in names:
            race(browser)
        if names == ["race"]:
            return
        os.environ["CREATIVE_NAO_CACHE"] = str(Path(folder) / "cache")  # where the server looks, too
        for name in MEMORIES:
            cached_map(load_memory(name), RESOLUTION)
        server = Server(Path(folder), words=["--resolution", str(RESOLUTION)])
        try:
            keep_favourites(browser, server.url)
            for name in names:
                if name == "film":
                    film(browser, server.url)
                elif name != "race":
                    save_small(io.BytesIO(PICTURES[name](browser, server.url)), IMAGES / f"explorer_{name}.png")
        finally:
            server.stop()


if __name__ == "__main__":
    main()
