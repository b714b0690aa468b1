"""The page without a server: opened from a file, its network makes the movements of the memory."""

import re

import numpy as np
import pytest

from creative_nao.cli import main
from creative_nao.measures import attribution, score
from creative_nao.model import load_memory


@pytest.fixture(scope="module")
def page(browser, tmp_path_factory):
    folder = tmp_path_factory.mktemp("alone")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CREATIVE_NAO_CACHE", str(folder / "cache"))
        assert main(["explore", "half/0", "--resolution", "20", "--html", str(folder / "alone.html")]) == 0
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


def test_a_page_must_end_in_html(capsys):
    assert main(["explore", "half/0", "--html", "page.txt"]) == 2
    assert "--html should end in .html, but is page.txt" in capsys.readouterr().err
