"""Figures are written small, and their colours stay what they were."""

import io

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from creative_nao.maps.figure_style import DPI, save


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
