"""Take the documentation's pictures of the explorer again: `python docs/make_explorer_images.py [desktop ...]`.

A real `creative-nao explore` and a headless Chromium, as in the tests of the page.
"""

import argparse
import io
import os
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

IMAGES = Path(__file__).parent / "images"
sys.path.insert(0, str(IMAGES.parents[1] / "tests" / "explorer"))

from visiting import CHROMIUM, FLAGS, Server, Visit  # noqa: E402

from creative_nao import load_memory  # noqa: E402
from creative_nao.explorer.registry import cached_map  # noqa: E402
from creative_nao.maps.figure_style import save_small  # noqa: E402

MEMORIES, RESOLUTION = ("half/0", "open/0"), 200
WINDOW = {"width": 1280, "height": 1000}
SCRUBBED = "143"
"""Thousandths of the movement at which the robot is shown: 1.05 s of 7.35 s."""


def explore(
    browser: Browser, url: str, query: str, *, size: dict[str, int] = WINDOW, whole: bool = False, dark: bool = False
) -> bytes:
    """Return a PNG of the page at an address, the robot standing still at one moment of its movement."""
    tab = Visit(browser, f"{url}{query}", color_scheme="dark" if dark else "light")
    tab.page.set_viewport_size(size)
    tab.wait_for_robot()
    tab.page.get_by_role("button", name="Pause").click()
    tab.page.locator("[data-player=scrub]").fill(SCRUBBED)
    return _taken(tab, whole=whole)


def teach(browser: Browser, url: str) -> bytes:
    """Return a PNG of the page for teaching, when a memory of the boxing set has been trained on it."""
    tab = Visit(browser, f"{url}teach", ready="all fit to be taught")
    tab.wait_for_pose()
    tab.page.get_by_label("How long").click()
    tab.page.get_by_role("option", name="30,000 epochs").click()
    tab.page.get_by_role("button", name="Train", exact=True).click()
    tab.page.get_by_text("of 6 demonstrations come back within 10 rad").wait_for(timeout=600_000)
    tab.page.get_by_role("button", name="Key at 0.70 s").click()
    return _taken(tab, whole=True)


def _taken(tab: Visit, *, whole: bool) -> bytes:
    tab.page.mouse.move(0, 0)
    tab.page.wait_for_timeout(3_000)  # the robot's posture, the curves' cursor and faded buttons settle
    png = tab.page.screenshot(full_page=whole)
    assert not tab.errors, tab.errors
    tab.context.close()
    return png


PICTURES = {
    "desktop": lambda browser, url: explore(browser, url, "?x=0.45&y=0.62"),
    "dark": lambda browser, url: explore(browser, url, "?x=0.3&y=0.2", size={"width": 1400, "height": 1000}, dark=True),
    "phone": lambda browser, url: explore(
        browser, url, "?x=0.3&y=0.2", size={"width": 390, "height": 844}, whole=True, dark=True
    ),
    "twin": lambda browser, url: explore(browser, url, "?x=0.3&y=0.2&beside=open/0"),
    "teach": teach,
}


def main() -> None:
    """Take the pictures that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pictures", nargs="*", metavar="PICTURE", help=f"of {', '.join(PICTURES)}; default: all")
    names = parser.parse_args().pictures or list(PICTURES)
    if unknown := [name for name in names if name not in PICTURES]:
        parser.error(f"no picture `{unknown[0]}`; there are {', '.join(PICTURES)}")
    if CHROMIUM is None:
        raise SystemExit("no Chromium; install your distribution's package `chromium`")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as running:
        os.environ["CREATIVE_NAO_CACHE"] = str(Path(folder) / "cache")  # where the server looks, too
        for name in MEMORIES:
            cached_map(load_memory(name), RESOLUTION)
        server = Server(Path(folder), words=["--resolution", str(RESOLUTION)])
        try:
            browser = running.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
            for name in names:
                save_small(io.BytesIO(PICTURES[name](browser, server.url)), IMAGES / f"explorer_{name}.png")
        finally:
            server.stop()


if __name__ == "__main__":
    main()
