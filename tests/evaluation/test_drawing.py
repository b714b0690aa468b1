"""Figures are written small, their colours stay what they were, and agents are told apart by colour and shape."""

import io
import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from creative_nao.agents.registry import NAMES
from creative_nao.evaluation.plots import AGENTS, agent_look
from creative_nao.maps.figure_style import DPI, rgb, save

RESULTS = Path(__file__).parents[2] / "docs" / "results"
VISIONS = {
    "usual": np.eye(3),
    "without long cones": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                           [-0.003882, -0.048116, 1.051998]],
    "without middle cones": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                             [-0.011820, 0.042940, 0.968881]],
    "without short cones": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
                            [0.004733, 0.691367, 0.303900]],
}  # fmt: skip
"""Linear red, green and blue as they are seen (Machado and others 2009, severity 1)."""
CONES = [[0.4122214708, 0.5363325363, 0.0514459929], [0.2119034982, 0.6806995451, 0.1073969566],
         [0.0883024619, 0.2817188376, 0.6299787005]]  # fmt: skip
OKLAB = [[0.2104542553, 0.7936177850, -0.0040720468], [1.9779984951, -2.4285922050, 0.4505937099],
         [0.0259040371, 0.7827717662, -0.8086757660]]  # fmt: skip


@pytest.fixture(scope="module")
def drawn():
    """A figure with 20,000 colours, and a patch of pink that is rare beside purple."""
    figure = Figure(figsize=(4, 3))
    axes = figure.subplots()
    red, green = np.meshgrid(np.linspace(0.4, 1.0, 200), np.linspace(0.4, 1.0, 100))
    axes.imshow(np.stack([red, green, np.ones_like(red)], axis=-1), extent=(0, 1, 0, 1))
    axes.fill([0, 1, 1, 0], [0, 0, 0.3, 0.3], color=(75 / 255, 0, 130 / 255))
    axes.fill([0.9, 0.95, 0.95, 0.9], [0.4, 0.4, 0.45, 0.45], color=(214 / 255, 150 / 255, 185 / 255))
    return figure


def test_a_picture_is_small_and_its_colours_stay(drawn, tmp_path):
    whole = io.BytesIO()
    drawn.savefig(whole, format="png", dpi=DPI, facecolor="white")
    written = Image.open(save(drawn, tmp_path / "figure.png"))
    before, after = (np.asarray(one.convert("RGB")).astype(int) for one in (Image.open(whole), written))
    pink = np.all(before == (214, 150, 185), axis=2)

    assert written.mode == "P"
    assert (tmp_path / "figure.png").stat().st_size < len(whole.getvalue()) / 2
    assert pink.sum() > 50
    assert np.abs(after - before)[pink].max() <= 2
    assert np.percentile(np.abs(after - before), 99) <= 16


def test_the_same_figure_is_the_same_file(drawn, tmp_path):
    one, other = save(drawn, tmp_path / "one.png"), save(drawn, tmp_path / "other.png")

    assert one.read_bytes() == other.read_bytes()


def seen(colour, vision):
    """Return a colour's place in OKLab, times 100, as it is seen: a step of 2 is just noticed."""
    red_green_blue = np.array(rgb(colour))
    linear = np.where(red_green_blue <= 0.04045, red_green_blue / 12.92, ((red_green_blue + 0.055) / 1.055) ** 2.4)
    return 100 * np.array(OKLAB) @ np.cbrt(np.array(CONES) @ np.clip(np.array(VISIONS[vision]) @ linear, 0, 1))


def test_agents_are_told_apart_by_colour_and_those_of_one_figure_by_shape_too():
    assert set(NAMES) == set(AGENTS)
    together = set()
    for path in RESULTS.glob("*.json"):
        rows = json.loads(path.read_text(encoding="utf-8"))["rows"]
        names = {row["agent"].partition("@")[0].partition("/")[0] for row in rows} | {"oracle"}
        together |= set(itertools.combinations(sorted(names), 2))
    place = {name: [seen(agent_look(name)[0], vision) for vision in VISIONS] for name in AGENTS}
    for pair in itertools.combinations(sorted(AGENTS), 2):
        gaps = np.linalg.norm(np.subtract(*(place[name] for name in pair)), axis=1)
        assert gaps.min() > (8 if pair in together else 4.5), pair
        assert pair not in together or agent_look(pair[0])[1] != agent_look(pair[1])[1], pair
