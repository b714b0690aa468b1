import numpy as np
import pytest

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures import Criteria, excursion_limit, excursions, is_appropriate, largest_speeds, speed_limits


def ramp(speed, n_steps=10, joint=0, dt_s=0.1):
    angles = np.zeros((n_steps, 8))
    angles[:, joint] = np.arange(n_steps) * speed * dt_s
    return angles


def test_speed_is_the_largest_change_over_the_tick():
    angles = np.zeros((4, 2))
    angles[:, 0] = [0.0, 0.1, -0.2, -0.2]
    np.testing.assert_allclose(largest_speeds([angles], dt_s=0.15), [[2.0, 0.0]])


def test_a_single_posture_has_no_speed_and_no_excursion():
    assert largest_speeds([np.ones((1, 8))], 0.1).tolist() == [[0.0] * 8]
    assert excursions([np.ones((1, 8))]).tolist() == [0.0]


def test_excursion_is_that_of_the_most_moving_joint():
    assert excursions(np.array([[[0.0, 1.0], [0.2, 0.5], [-0.1, 0.9]]])).tolist() == [0.5]


def test_lists_of_unequal_lengths_are_looked_at_one_by_one():
    assert excursions([ramp(1.0, 11), ramp(1.0, 21)]) == pytest.approx([1.0, 2.0])
    assert largest_speeds([ramp(1.0, 11), ramp(2.0, 21)], 0.1)[:, 0] == pytest.approx([1.0, 2.0])


def test_the_fastest_joint_sets_the_limit_for_all_unless_each_has_its_own(taught):
    own = largest_speeds(taught.trajectories, taught.dt_s).max(axis=0)
    np.testing.assert_array_equal(speed_limits(taught), np.full(8, 1.5 * own.max()))
    np.testing.assert_array_equal(speed_limits(taught, Criteria(per_joint=True)), 1.5 * own)


@pytest.mark.parametrize(("factor", "passes"), [(1.49, True), (1.51, False)])
def test_an_action_passes_up_to_one_and_a_half_times_the_speed(taught, factor, passes):
    fastest = largest_speeds(taught.trajectories, taught.dt_s).max()
    assert is_appropriate([ramp(factor * fastest)], taught).tolist() == [passes]


def test_per_joint_a_joint_that_never_moved_may_not_move(taught):
    slow = [ramp(0.5, joint=7)]
    assert is_appropriate(slow, taught).all()
    assert not is_appropriate(slow, taught, Criteria(per_joint=True)).any()


@pytest.mark.parametrize(("share", "passes"), [(0.101, True), (0.099, False)])
def test_an_action_moves_from_a_tenth_of_the_least_moving_basic_action_on(taught, share, passes):
    least = min(np.ptp(action, axis=0).max() for action in taught.trajectories)
    assert excursion_limit(taught) == pytest.approx(0.1 * least)
    assert is_appropriate([share * taught.trajectories[0] / np.ptp(taught.trajectories[0]) * least], taught) == [passes]


def test_the_basic_actions_are_appropriate_at_factor_one(taught):
    assert is_appropriate(taught.trajectories, taught, Criteria(speed_factor=1.0, per_joint=True)).all()


def test_nothing_is_appropriate_in_an_empty_set(taught):
    assert is_appropriate([], taught).shape == (0,)
    assert is_appropriate(np.zeros((0, 40, 8)), taught).shape == (0,)


@pytest.mark.parametrize("field", ["speed_factor", "excursion_share", "learned_threshold"])
@pytest.mark.parametrize("value", [-0.1, float("nan"), float("inf")])
def test_a_criterion_out_of_range_is_refused_by_name(field, value):
    with pytest.raises(SettingsError, match=f"`{field}` should be (at least 0|a finite number), but is {value}"):
        Criteria(**{field: value})


def test_other_joints_are_refused(taught):
    with pytest.raises(ShapeError, match=r"`trajectories\[1\]` should have shape \(n_steps, 8\).* has \(5, 7\)"):
        is_appropriate([np.zeros((5, 8)), np.zeros((5, 7))], taught)


def test_one_trajectory_that_is_not_in_a_list_is_refused(taught):
    with pytest.raises(ShapeError, match=r"`trajectories\[0\]` should have shape \(n_steps, 8\).* has \(8,\)"):
        is_appropriate(taught.trajectories[0], taught)


def test_an_angle_that_is_not_finite_is_refused_with_its_place(taught):
    broken = np.zeros((3, 5, 8))
    broken[2, 4, 6] = np.nan
    with pytest.raises(ShapeError, match=r"`trajectories\[2\]` is not finite at step 4, joint 6"):
        is_appropriate(broken, taught)


@pytest.mark.parametrize("wrong", [None, 3, "ab"])
def test_speeds_and_excursions_of_what_is_no_trajectory_are_refused(wrong):
    with pytest.raises(ShapeError, match="`trajectories"):
        excursions(wrong)
    with pytest.raises(ShapeError, match="`trajectories"):
        largest_speeds(wrong, 0.1)
    with pytest.raises(SettingsError, match="`dt_s` should be above 0, but is 0"):
        largest_speeds([np.zeros((3, 1))], 0)
