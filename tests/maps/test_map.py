import json

import numpy as np
import pytest

from creative_nao import load_memory, measures
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError, ShapeError
from creative_nao.maps import PBMap, nearest_cell, pb_grid, pb_map, pb_slice
from creative_nao.maps.figure_style import FLUCTUATING, rgb
from creative_nao.maps.picture import map_image
from creative_nao.model import NetworkSettings, TrainingSettings, train_network


@pytest.fixture(scope="module")
def chart(tiny_memory):
    return pb_map(tiny_memory, resolution=15)


def test_the_grid_runs_along_the_first_unit_first():
    assert pb_grid(3).tolist() == [[-1, -1], [0, -1], [1, -1], [-1, 0], [0, 0], [1, 0], [-1, 1], [0, 1], [1, 1]]


def test_every_grid_point_is_its_own_nearest_cell():
    assert np.array_equal(nearest_cell(pb_grid(17), 17), np.arange(17 * 17))


def test_the_map_scores_what_the_memory_generates(chart, tiny_memory):
    scores = measures.score(tiny_memory.generate(pb_grid(15)), tiny_memory.demonstrations)

    assert np.array_equal(chart.outcome, scores.outcome)
    assert np.array_equal(chart.nearest, scores.nearest)
    assert np.array_equal(chart.distance, scores.novelty)
    assert np.array_equal(chart.trajectories, tiny_memory.generate(chart.pb))


@pytest.mark.parametrize("ending", ["safetensors", "npz"])
def test_a_saved_map_comes_back(chart, tmp_path, ending):
    path = chart.save(tmp_path / f"map.{ending}")
    back = PBMap.load(path)

    assert path.read_bytes().startswith(b"PK") == (ending == "npz")

    for name in ("pb", "outcome", "nearest", "distance", "learned_pb"):
        assert np.array_equal(getattr(back, name), getattr(chart, name)), name
    assert (back.names, back.record) == (chart.names, chart.record)
    assert back.trajectories is None


@pytest.mark.parametrize("ending", ["safetensors", "npz"])
def test_a_torn_map_is_refused_wherever_it_is_cut(chart, tmp_path, ending):
    content = chart.save(tmp_path / f"map.{ending}").read_bytes()
    path = tmp_path / f"torn.{ending}"
    for length in range(0, len(content), 211):
        path.write_bytes(content[:length])
        with pytest.raises(FileFormatError, match=rf"torn\.{ending}"):
            PBMap.load(path)


def test_a_map_is_told_in_one_line_and_shown_by_a_notebook(chart):
    told = repr(chart)
    assert told.startswith("PBMap")
    assert "15 x 15 points" in told
    assert len(told.splitlines()) == 1
    assert chart._repr_png_().startswith(b"\x89PNG")


@pytest.mark.parametrize("wrong", [None, 3, [["a", 1]]])
def test_what_is_no_memory_is_refused(wrong):
    for make in (pb_map, pb_slice):
        with pytest.raises(SettingsError, match="`memory` should be a memory, such as"):
            make(wrong)


def test_arguments_of_another_kind_are_refused(tiny_memory):
    with pytest.raises(SettingsError, match="`resolution` should be a whole number, but is 'fine'"):
        pb_map(tiny_memory, "fine")
    with pytest.raises(SettingsError, match=r"`resolution` should be a whole number, but is 2\.5"):
        pb_grid(2.5)
    with pytest.raises(SettingsError, match="`axes` should be two different PB units"):
        pb_slice(tiny_memory, axes=("a", 1))
    with pytest.raises(ShapeError, match="`pb` should be an array of numbers, but is 'here'"):
        nearest_cell("here")


def test_a_pickle_in_disguise_is_not_opened(tmp_path):
    path = tmp_path / "evil.npz"
    header = np.frombuffer(json.dumps({"format_version": 1, "resolution": 2, "names": []}).encode(), np.uint8)
    np.savez(path, header=header, outcome=np.array([object()] * 4, dtype=object))

    with pytest.raises(FileFormatError, match="not a PB map"):
        PBMap.load(path)


def test_a_missing_map_says_how_to_make_one(tmp_path):
    with pytest.raises(NotFoundError, match="make one with `creative-nao map MEMORY --out"):
        PBMap.load(tmp_path / "none.npz")


def test_only_two_units_make_a_map(waves):
    settings = NetworkSettings(layer_sizes=(4, 3), time_constants=(2, 4), n_pb=3)
    memory = train_network(waves, TrainingSettings(n_epochs=1), settings)

    with pytest.raises(SettingsError, match="n_pb = 2, but this one has 3"):
        pb_map(memory)


@pytest.mark.parametrize("resolution", [1, 100_000])
def test_a_resolution_out_of_range_is_named(tiny_memory, resolution):
    with pytest.raises(SettingsError, match=f"`resolution` should be .*{resolution}"):
        pb_map(tiny_memory, resolution)


def test_colours_say_what_cannot_be_used(chart):
    image = map_image(chart).reshape(-1, 3)
    bad = chart.outcome == "fluctuating"

    assert (image[bad] == rgb(FLUCTUATING)).all()
    assert not (image[~bad] == rgb(FLUCTUATING)).all(axis=1).any()


@pytest.mark.parametrize("ending", ["png", "svg"])
def test_the_picture_is_written(chart, tmp_path, ending):
    path = tmp_path / f"map.{ending}"
    chart.plot(path, points=np.zeros((3, 2)))

    assert path.stat().st_size > 10_000
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_on_half_0_every_basic_action_owns_a_region_and_most_of_the_map_is_usable():
    """The paper's grid of 200 x 200 on the shipped memory of the half closed loop."""
    chart = pb_map(load_memory("half/0"))

    assert (chart.learned_region_pct() > 0.1).all()
    assert chart.appropriate.mean() >= 0.70
