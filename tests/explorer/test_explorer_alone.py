"""The page without a server: opened from a file, its network makes the movements of the memory."""

import re
from base64 import b64decode
from io import BytesIO

import numpy as np
import pytest
from PIL import Image
from visiting import PHYSICAL

from creative_nao import maps
from creative_nao.cli import main
from creative_nao.envs.physical_map import PhysicalMap
from creative_nao.explorer.colours import NAMES, cell_colours, is_number, is_physical, map_picture, physical_figure
from creative_nao.explorer.static_export import texture_address
from creative_nao.explorer.view import SIZE
from creative_nao.measures import attribution, score
from creative_nao.model import load_memory


@pytest.fixture(scope="module")
def page(browser, tmp_path_factory):
    folder = tmp_path_factory.mktemp("alone")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CREATIVE_NAO_CACHE", str(folder / "cache"))
        words = ["--resolution", "20", "--physical", str(PHYSICAL), "--html", str(folder / "alone.html")]
        assert main(["explore", "half/0", *words]) == 0
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    opened = context.new_page()
    opened.faults, opened.asked = [], []
    opened.on("pageerror", lambda error: opened.faults.append(str(error)))
    opened.on("console", lambda said: opened.faults.append(said.text) if said.type == "error" else None)
    opened.on("request", lambda request: opened.asked.append(request.url))
    opened.goto((folder / "alone.html").as_uri())
    opened.wait_for_function("window.robotPlayer?.duration > 0")
    yield opened
    assert not opened.faults
    assert all(url.startswith(("file:", "data:", "blob:")) for url in opened.asked)
    context.close()


def test_the_network_in_the_page_is_the_memory(page):
    memory = load_memory("half/0")
    points = np.concatenate([memory.pb, np.random.default_rng(0).uniform(-1, 1, (60, 2))])
    made = page.evaluate("(points) => points.map((pb) => memory.recall([pb]))", points.tolist())
    truth = memory.generate(points)
    error = np.abs(np.array([one["angles"] for one in made]) - truth).max(axis=(1, 2))
    assert error.max() < 1e-3
    scores = score(truth, memory.demonstrations)
    assert [one["outcome"] for one in made] == scores.outcome.tolist()
    np.testing.assert_allclose([one["novelty"] for one in made], scores.novelty, atol=1e-2)


def test_a_path_in_the_page_is_that_of_the_memory(page):
    memory, path = load_memory("half/0"), [[-0.5, -0.2], [0.1, 0.4], [0.6, 0.0]]
    made = page.evaluate("(path) => memory.recall(path).angles", path)
    np.testing.assert_allclose(made, memory.generate_path(path), atol=1e-3)


def test_the_strip_in_the_page_is_that_of_the_measures(page):
    memory = load_memory("half/0")
    points = np.concatenate([memory.pb[:3], np.random.default_rng(1).uniform(-1, 1, (20, 2))])
    made = page.evaluate(
        """async (points) => {
            const { distances, stretches } = await import("cn-attribution");
            return points.map((pb) => {
                const found = distances(memory.recall([pb]).angles, memory.demonstrations, memory.dt);
                return [found, stretches(found).map((one) => [one.first, one.end, one.action])];
            });
        }""",
        points.tolist(),
    )
    truth = [attribution(one, memory.demonstrations) for one in memory.generate(points)]
    np.testing.assert_allclose([one[0] for one in made], [one.distances for one in truth], atol=2e-3)
    assert [one[1] for one in made] == [[list(part[:3]) for part in one.stretches()] for one in truth]
    assert page.locator(".cn-resembles").inner_text().startswith("Resembles ")


def test_it_answers_pointer_and_keys_and_the_robot_plays(page):
    turn = "scene_alone.getObjectByName('nao/RForearm').quaternion.toArray()"
    page.evaluate("robotPlayer.playing = true")
    before = page.evaluate(turn)
    page.wait_for_function(f"(before) => {turn}.some((value, k) => Math.abs(value - before[k]) > 0.02)", arg=before)
    box = page.locator("#map").bounding_box()
    page.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + 0.25 * box["height"])
    assert re.match(r"PB 0\.(49|50)\d, 0\.(49|50)\d; ", page.locator("#status").inner_text())
    page.keyboard.press("2")
    assert "like a basic action; nearest B right straight" in page.locator("#status").inner_text()


@pytest.fixture(scope="module")
def drawn_maps():
    return maps.pb_map(load_memory("half/0"), 20), PhysicalMap.load(PHYSICAL)


def numbers(pb_map, name):
    if not is_number(name):
        return None
    return physical_figure(pb_map, name) if is_physical(name) else maps.colour_values(pb_map, name)[0]


SHOWN = """(name) => document.getElementById("legend").dataset.of === name"""


@pytest.mark.slow
def test_it_has_every_colouring_of_the_served_page(page, drawn_maps):
    assert page.locator("#colour option").evaluate_all("all => all.map((one) => one.value)") == list(NAMES)
    assert page.locator("#colour option").all_inner_texts() == list(NAMES.values())
    for name in NAMES:
        page.locator("#colour").select_option(name)
        page.wait_for_function(SHOWN, arg=name)
        pb_map = drawn_maps[is_physical(name)]
        n = pb_map.resolution
        painted = page.evaluate(
            "() => { const c = document.getElementById('cells');"
            "return [...c.getContext('2d').getImageData(0, 0, c.width, c.height).data] }"
        )
        painted = np.reshape(painted, (n, n, 4))[::-1, :, :3] / 255
        error = np.abs(painted - cell_colours(pb_map, name, numbers(pb_map, name)))
        assert error.max() < 0.06, name  # a step of the scale, or of 256 colours
        assert error.mean() < 0.006, name


@pytest.mark.slow
def test_the_colour_under_the_cursor_is_told_as_a_number(page, drawn_maps):
    pb_map, _ = drawn_maps
    box = page.locator("#map").bounding_box()
    for name in ("speed", "ruggedness", "outcome"):
        page.locator("#colour").select_option(name)
        page.wait_for_function(SHOWN, arg=name)
        values = numbers(pb_map, name)
        for cell in (21, 110, 138, 239, 377):
            x, y = (pb_map.pb[cell] * (1, -1) + 1) / 2
            page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
            said = page.locator("#here").inner_text()
            if values is None:
                assert said == ""
            elif pb_map.appropriate[cell]:
                usable = values[pb_map.appropriate]
                assert float(said.split(": ")[-1]) == pytest.approx(values[cell], abs=0.01 * np.ptp(usable))
            else:
                assert said.endswith(": none, the movement cannot be used")


@pytest.mark.slow
def test_colours_are_chosen_with_keys_and_the_legend_follows(page):
    page.locator("#colour").select_option("nearest")
    page.wait_for_function(SHOWN, arg="nearest")
    assert "strong: like the basic action" in page.locator("#legend").inner_text()
    page.locator("#surprise").focus()
    for _ in range(2):
        page.keyboard.press("Shift+Tab")
    assert page.evaluate("document.activeElement.id") == "colour"
    for _ in range(2):
        page.keyboard.press("ArrowDown")
    page.wait_for_function(SHOWN, arg="novelty")
    assert "DTW distance to the nearest basic action [rad]" in page.locator("#legend").inner_text()


def test_what_lies_over_the_colours_is_that_of_the_served_map(drawn_maps):
    """Colours below, hatching and borders above: together the picture that the server draws."""
    for pb_map in drawn_maps:
        n = pb_map.resolution
        below = Image.fromarray(np.round(255 * cell_colours(pb_map, "outcome")[::-1]).astype(np.uint8))
        below = below.resize((SIZE, SIZE), Image.Resampling.NEAREST).convert("RGBA")
        above = Image.open(BytesIO(b64decode(texture_address(pb_map).split(",")[1]))).convert("RGBA")
        together = np.asarray(Image.alpha_composite(below, above).convert("RGB")).astype(int)
        assert SIZE % n == 0
        assert np.abs(together - np.asarray(map_picture(pb_map, "outcome"))).max() <= 2


@pytest.mark.slow
def test_a_fine_page_stays_below_1_6_mb(tmp_path, monkeypatch):
    monkeypatch.setenv("CREATIVE_NAO_CACHE", str(tmp_path))
    assert main(["explore", "half/0", "--html", str(tmp_path / "fine.html")]) == 0
    assert (tmp_path / "fine.html").stat().st_size < 1.6e6


def test_a_physical_map_of_another_memory_is_refused(tmp_path, capsys):
    words = ["--resolution", "20", "--physical", str(PHYSICAL), "--html", str(tmp_path / "alone.html")]
    assert main(["explore", "open/0", *words]) == 2
    assert "is a physical map of the memory half/0, with other weights" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_page_must_end_in_html(capsys):
    assert main(["explore", "half/0", "--html", "page.txt"]) == 2
    assert "--html should end in .html, but is page.txt" in capsys.readouterr().err
