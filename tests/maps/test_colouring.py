"""A map coloured by a measure: the colours are the numbers, and what has no number says so."""

import json

import numpy as np
import pytest

from creative_nao import measures
from creative_nao.cli.dispatch import main
from creative_nao.errors import NotFoundError, SettingsError, ShapeError
from creative_nao.maps import COLOURINGS, PBMap, colour_values, pb_map
from creative_nao.maps.figure_style import UNUSABLE, rgb
from creative_nao.maps.picture import measure_image


@pytest.fixture(scope="module")
def chart(tiny_memory):
    return pb_map(tiny_memory, resolution=9)


def test_the_numbers_are_those_of_the_measures(chart, tiny_memory):
    speeds = measures.largest_speeds(chart.trajectories, tiny_memory.dt_s).max(axis=1)

    assert np.array_equal(colour_values(chart, "novelty")[0], chart.distance)
    assert np.array_equal(colour_values(chart, "speed")[0], speeds)
    assert np.array_equal(colour_values(chart, "excursion")[0], measures.excursions(chart.trajectories))


def test_the_newest_usable_movement_is_the_least_expected(chart):
    values, _ = colour_values(chart, "unexpectedness")
    usable = chart.distance[chart.appropriate]

    assert len(usable) > 1
    assert np.array_equal(values, measures.unexpectedness(chart.distance, usable))
    assert (
        values[chart.appropriate].max()
        == values[chart.distance == usable.max()].max()
        > values[chart.appropriate].min()
    )


def test_ruggedness_is_the_mean_distance_to_the_neighbours(chart):
    found, _ = colour_values(chart, "ruggedness")
    for cell, neighbours in ((0, (1, 9)), (4, (3, 5, 13)), (40, (39, 41, 31, 49))):  # a corner, an edge, the middle
        distances = [measures.dtw(chart.trajectories[cell], chart.trajectories[k]) for k in neighbours]
        assert found[cell] == pytest.approx(np.mean(distances), rel=1e-12)


def test_the_scale_spans_what_can_be_used_and_the_rest_keeps_its_colour(chart):
    outcome = chart.outcome.copy()
    outcome[:3], outcome[3:] = "fluctuating", "learned"
    values = np.arange(81.0)
    values[0] = 1e6
    mixed = PBMap(9, chart.pb, outcome, chart.nearest, chart.distance, chart.learned_pb, chart.names, {})
    image, scale = measure_image(mixed, values)

    assert scale.get_clim() == (3.0, 80.0)
    assert np.array_equal(image.reshape(-1, 3)[:3], [rgb(UNUSABLE["fluctuating"][0])] * 3)
    assert len(np.unique(image.reshape(-1, 3)[3:], axis=0)) == 78


@pytest.mark.parametrize("colour", [*COLOURINGS, "own"])
def test_every_colouring_draws_with_a_scale(chart, colour, tmp_path):
    own = np.arange(81)
    figure = chart.plot(tmp_path / "map.png", colour=own if colour == "own" else colour, colour_label="how much")

    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    assert figure.axes[1].get_ylabel() == "how much"


def test_a_map_without_a_usable_point_is_drawn(chart, tmp_path):
    unusable = np.full(81, "non_moving")
    PBMap(9, chart.pb, unusable, chart.nearest, chart.distance, chart.learned_pb, chart.names, {}).plot(
        tmp_path / "map.png", colour="novelty"
    )

    assert (tmp_path / "map.png").exists()


def test_a_map_from_a_file_has_novelty_and_says_what_it_lacks(chart, tmp_path):
    back = PBMap.load(chart.save(tmp_path / "map.npz"))

    assert np.array_equal(colour_values(back, "novelty")[0], chart.distance)
    for name in ("speed", "excursion", "ruggedness"):
        with pytest.raises(SettingsError, match=f"colouring by {name} needs the movements"):
            back.plot(colour=name)


def test_a_wrong_colour_is_told(chart):
    with pytest.raises(NotFoundError, match=r"no colouring `sped` \(did you mean `speed`\?\)"):
        chart.plot(colour="sped")
    with pytest.raises(ShapeError, match=r"81 finite numbers.*has shape \(80,\)"):
        chart.plot(colour=np.zeros(80))
    with pytest.raises(ShapeError, match="81 finite numbers"):
        chart.plot(colour=np.full(81, np.nan))


def test_the_command_colours_the_picture_and_nothing_else(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for colour in ("nearest", "speed"):
        words = ["map", "half/0", "--resolution", "5", "--out", f"{colour}.npz", "--colour", colour, "--json"]
        assert main(words) == 0
    first, second = map(json.loads, capsys.readouterr().out.splitlines())

    assert {**first, "out": 0} == {**second, "out": 0}
    assert (tmp_path / "nearest.png").read_bytes() != (tmp_path / "speed.png").read_bytes()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--colour", "sped"], "no colouring `sped` (did you mean `speed`?)"),
        (["--colour", "speed", "--physical"], "--colour speed needs the movements, which a --physical map"),
    ],
)
def test_a_mistaken_colour_costs_no_map(words, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    assert main(["map", "half/0", *words]) == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
