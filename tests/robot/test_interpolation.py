"""Commands between ticks are smooth and stay between their neighbours."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from creative_nao.robot.interpolation import limit_speed, minimum_jerk, monotone_slopes, ramp, refine

KNOTS = hnp.arrays(np.float64, st.tuples(st.integers(2, 12), st.just(2)), elements=st.floats(-2, 2, width=32))


@settings(deadline=None)
@given(KNOTS)
def test_the_curve_passes_the_knots_and_never_leaves_their_range(knots):
    factor = 7
    curve = refine(knots, 0.15, factor)
    np.testing.assert_array_equal(curve[::factor], knots)
    for number in range(len(knots) - 1):
        piece = curve[number * factor : (number + 1) * factor + 1]
        low, high = np.sort(knots[number : number + 2], axis=0)
        assert (piece >= low - 1e-9).all()
        assert (piece <= high + 1e-9).all()


def test_it_agrees_with_the_reference_implementation():
    interpolate = pytest.importorskip("scipy.interpolate")
    knots = np.random.default_rng(0).normal(size=(20, 3))
    fine = np.linspace(0, 19 * 0.15, 19 * 10 + 1)
    expected = interpolate.PchipInterpolator(np.arange(20) * 0.15, knots)(fine)
    np.testing.assert_allclose(refine(knots, 0.15, 10), expected, atol=1e-12)


def test_a_straight_line_stays_straight():
    line = np.linspace(0, 3, 4)[:, None]
    np.testing.assert_allclose(refine(line, 0.1, 5)[:, 0], np.linspace(0, 3, 16), atol=1e-12)
    np.testing.assert_allclose(monotone_slopes(line, 0.1), 10.0)


def test_two_knots_are_joined_by_a_line_and_one_comes_back():
    np.testing.assert_allclose(refine(np.array([[0.0], [1.0]]), 0.1, 4)[:, 0], [0, 0.25, 0.5, 0.75, 1])
    np.testing.assert_array_equal(refine(np.array([[0.3]]), 0.1, 4), [[0.3]])


def test_slopes_are_zero_at_a_turning_point():
    assert monotone_slopes(np.array([[0.0], [1.0], [0.0], [2.0]]), 0.1)[1:3].tolist() == [[0.0], [0.0]]


def test_a_minimum_jerk_move_ends_at_its_goal_and_peaks_at_1_875_times_the_mean_speed():
    move = minimum_jerk(np.zeros(1), np.ones(1), 1000)[:, 0]
    assert move[-1] == 1.0
    assert np.diff(move, prepend=0.0).max() * 1000 == pytest.approx(1.875, abs=1e-3)


def test_slow_targets_pass_the_speed_limit_unchanged_and_fast_ones_are_held_back():
    slow = np.array([[0.1], [0.2], [0.3]])
    assert limit_speed(slow, np.zeros(1), np.array([0.1 + 1e-12])) is slow
    held = limit_speed(np.array([[1.0], [1.0], [0.0]]), np.zeros(1), np.array([0.4]))
    np.testing.assert_allclose(held[:, 0], [0.4, 0.8, 0.4])


def test_a_ramp_ends_each_part_at_its_target():
    steps = ramp(np.zeros(1), np.array([[1.0], [3.0]]), 2)
    np.testing.assert_array_equal(steps[:, 0], [0.5, 1.0, 2.0, 3.0])
