import numpy as np
import pytest

from creative_nao import load_memory
from creative_nao.errors import SettingsError, ShapeError
from creative_nao.model import walk
from creative_nao.model.generation import pb_of_each_tick


def test_a_path_that_stays_is_the_movement_of_that_point(tiny_memory):
    still = tiny_memory.generate_path([[0.3, -0.6]])

    assert np.array_equal(still, tiny_memory.generate(np.array([[0.3, -0.6]]))[0])
    assert np.array_equal(tiny_memory.generate_path([[0.3, -0.6]] * 3), still)


def test_a_jump_changes_nothing_before_it_and_much_after():
    memory = load_memory("half/0")
    first, second = memory.pb[:2]
    jumped = memory.generate_path([first, first, second], n_steps=60, at_ticks=[0, 30, 30])
    stayed = memory.generate(first[None], n_steps=60)[0]

    # Tick t is read from the activity of t - 1, which the PB of tick 30 has not reached before tick 30.
    assert np.array_equal(jumped[:31], stayed[:31])
    assert np.abs(jumped[31:] - stayed[31:]).max() > 0.05


def test_the_pb_moves_in_straight_lines_and_rests_at_both_ends():
    pb = pb_of_each_tick([[0.0, 0.0], [1.0, -1.0], [1.0, 0.0]], n_pb=2, n_steps=9, at_ticks=[1, 5, 7])

    assert pb.tolist() == [
        [0, 0], [0, 0], [0.25, -0.25], [0.5, -0.5], [0.75, -0.75], [1, -1], [1, -0.5], [1, 0], [1, 0],
    ]  # fmt: skip


def test_by_default_the_points_are_reached_at_even_times():
    pb = pb_of_each_tick([[0.0], [1.0], [0.0]], n_pb=1, n_steps=5)

    assert pb.ravel().tolist() == [0, 0.5, 1, 0.5, 0]


def test_at_a_jump_the_later_point_counts():
    pb = pb_of_each_tick([[0.0], [0.5], [1.0], [1.0]], n_pb=1, n_steps=5, at_ticks=[0, 2, 2, 4])

    assert pb.ravel().tolist() == [0, 0.25, 1, 1, 1]


def test_a_walk_generates_one_movement_at_each_evenly_spaced_stop(tiny_memory):
    corners = [[0.0, 0.0], [0.8, 0.0], [0.8, 0.4]]
    found = walk(tiny_memory, corners, n_points=4)

    np.testing.assert_allclose(found.pb, [[0, 0], [0.4, 0], [0.8, 0], [0.8, 0.4]], atol=1e-15)
    assert np.array_equal(found.trajectories, tiny_memory.generate(found.pb))
    assert len(found) == 4


def test_a_walk_on_the_spot_stays(tiny_memory):
    assert walk(tiny_memory, [[0.1, 0.2]], n_points=3).pb.tolist() == [[0.1, 0.2]] * 3


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([0.0, 0.0], r"`points` should have shape \(n, 2\) with n at least 1, but has \(2,\)"),
        ([[0.0]], r"`points` should have shape \(n, 2\) with n at least 1, but has \(1, 1\)"),
        (np.zeros((0, 2)), r"has \(0, 2\)"),
        ([[0.0, 0.0], [1.01, 0.0]], r"`points` should lie in \[-1, 1\], but row 1 is \[1.01, 0.0\]"),
        ([[np.nan, 0.0]], r"row 0 is \[nan, 0.0\]"),
    ],
)
def test_bad_points_are_named(tiny_memory, points, message):
    with pytest.raises(ShapeError, match=message):
        tiny_memory.generate_path(points)
    with pytest.raises(ShapeError, match=message):
        walk(tiny_memory, points, 3)


@pytest.mark.parametrize("at_ticks", [[0], [5, 3], [0, np.nan]])
def test_ticks_that_do_not_fit_are_named(tiny_memory, at_ticks):
    with pytest.raises(SettingsError, match="`at_ticks` should hold 2 ticks, one for each point, none before"):
        tiny_memory.generate_path([[0, 0], [1, 1]], at_ticks=at_ticks)


def test_counts_below_one_are_named(tiny_memory):
    with pytest.raises(SettingsError, match="`n_steps` should be at least 1, but is 0"):
        tiny_memory.generate_path([[0, 0]], n_steps=0)
    with pytest.raises(SettingsError, match="`n_points` should be at least 1, but is 0"):
        walk(tiny_memory, [[0, 0]], 0)
