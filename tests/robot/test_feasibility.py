"""The body refuses what it cannot do, and names the first reason."""

import dataclasses

import numpy as np
import pytest

from creative_nao.errors import SettingsError
from creative_nao.robot import PHYSICAL_FAILURES, PhysicalLimits, first_failure

TRIPS = {
    "joint_limit": {"limit_excess_rad": 0.1},
    "fell": {"fell": True},
    "self_collision": {"self_collision_share": 0.2},
    "torque_saturated": {"saturated_share": np.array([0, 0, 0, 0, 0, 0, 0.5, 0])},
    "tracking_error": {"mean_error_rad": np.array([0, 0.2, 0, 0, 0, 0, 0, 0])},
}


@pytest.fixture(scope="module")
def good(performances):
    return performances["right_straight"]


@pytest.mark.parametrize(
    "name", ["left_jab", "right_straight", "left_hook", "right_hook", "left_uppercut", "right_uppercut"]
)
def test_the_basic_actions_pass_with_half_of_what_is_allowed(performances, name):
    full = PhysicalLimits()
    half = PhysicalLimits(**{key: value / 2 for key, value in dataclasses.asdict(full).items()})
    assert first_failure(performances[name], half) is None


def test_they_still_pass_at_one_and_a_half_times_their_speed(performer, demos):
    for trajectory in demos.trajectories:
        assert first_failure(performer.perform(trajectory, 0.10)) is None


def test_they_fail_at_three_times_their_speed(performer, demos):
    assert first_failure(performer.perform(demos.trajectories[5], 0.05)) == "torque_saturated"


@pytest.mark.parametrize("name", PHYSICAL_FAILURES)
def test_each_limit_trips_by_itself(good, name):
    assert first_failure(dataclasses.replace(good, **TRIPS[name])) == name


def test_the_first_in_the_order_is_named(good):
    for place, name in enumerate(PHYSICAL_FAILURES):
        rest = {key: value for later in PHYSICAL_FAILURES[place:] for key, value in TRIPS[later].items()}
        assert first_failure(dataclasses.replace(good, **rest)) == name


def test_an_error_that_is_no_number_trips(good):
    assert first_failure(dataclasses.replace(good, mean_error_rad=np.full(8, np.nan))) == "tracking_error"


def test_leaning_on_the_body_is_a_self_collision(performer, still):
    leaning = still.copy()
    leaning[3:, :4] = [1.4, 0.3142, 0.0, 1.5446]
    assert first_failure(performer.perform(leaning, 0.15)) == "self_collision"


@pytest.mark.parametrize("value", [-0.1, float("nan")])
def test_a_limit_is_a_number_of_at_least_zero(value):
    with pytest.raises(SettingsError, match="`tracking_error_rad` should be"):
        PhysicalLimits(tracking_error_rad=value)
