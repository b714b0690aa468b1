import numpy as np
import pytest

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.maps import PBMap, landscape, pb_grid, pb_map, pb_slice
from creative_nao.model import NetworkSettings, TrainingSettings, train_network


@pytest.fixture(scope="module")
def three_units(waves):
    settings = NetworkSettings(layer_sizes=(9, 4), time_constants=(2, 5), n_pb=3, pb_weight_scale=1.0)
    return train_network(waves, TrainingSettings(n_epochs=100), settings)


def test_a_slice_holds_the_other_units(three_units):
    chart = pb_slice(three_units, axes=(2, 0), at=[9e-9, 0.25, -0.5], resolution=4)

    assert np.array_equal(chart.full_pb[:, [2, 0]], pb_grid(4))
    assert (chart.full_pb[:, 1] == 0.25).all()
    assert np.array_equal(chart.trajectories, three_units.generate(chart.full_pb))
    assert np.array_equal(chart.learned_pb, three_units.pb[:, [2, 0]])


def test_by_default_the_others_are_zero(three_units):
    assert not pb_slice(three_units, axes=(0, 1), resolution=3).full_pb[:, 2].any()


def test_with_two_units_the_slice_is_the_map(tiny_memory):
    whole, chart = pb_map(tiny_memory, 7), pb_slice(tiny_memory, resolution=7)

    for name in ("pb", "outcome", "nearest", "distance", "learned_pb", "trajectories"):
        assert np.array_equal(getattr(whole, name), getattr(chart, name)), name
    assert landscape(whole) == landscape(chart)


def test_a_slice_is_saved_with_its_place(three_units, tmp_path):
    chart = pb_slice(three_units, axes=(0, 2), at=[0, 0.5, 0], resolution=5)
    back = PBMap.load(chart.save(tmp_path / "slice.npz"))

    assert np.array_equal(back.distance, chart.distance)
    assert (back.record["settings"]["axes"], back.record["settings"]["at"]) == ([0, 2], [0.0, 0.5, 0.0])


def test_the_picture_names_its_axes(three_units, tmp_path):
    figure = pb_slice(three_units, axes=(2, 1), at=[0.5, 0, 0], resolution=5).plot(tmp_path / "slice.png")

    assert (figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()) == ("PB 3", "PB 2")
    assert figure.axes[0].get_title() == "Slice at PB 1 = 0.5"
    assert (tmp_path / "slice.png").stat().st_size > 10_000


@pytest.mark.parametrize("axes", [(0, 0), (0, 3), (-1, 1), (0,), (0, 1, 2)])
def test_axes_that_are_none_are_named(three_units, axes):
    with pytest.raises(SettingsError, match=r"`axes` should be two different PB units of this memory, from 0 to 2"):
        pb_slice(three_units, axes=axes)


@pytest.mark.parametrize("at", [[0, 0], [0, 0, 1.1], [0, 0, np.nan]])
def test_a_place_outside_is_named(three_units, at):
    with pytest.raises(ShapeError, match=r"`at` should hold 3 PB values in \[-1, 1\], but is \[0"):
        pb_slice(three_units, at=at)


def test_a_map_of_many_units_points_to_slices(three_units):
    with pytest.raises(SettingsError, match="but this one has 3; `pb_slice` maps two of them"):
        pb_map(three_units)
    with pytest.raises(SettingsError, match="`resolution` should be at most 4000, but is 5000"):
        pb_slice(three_units, resolution=5000)
