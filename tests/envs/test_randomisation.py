"""A robot drawn anew every episode: seeded, within its ranges, and back to the published one bit for bit."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest

import creative_nao  # noqa: F401 - registers the environments
from creative_nao.demonstrations import load_demonstrations
from creative_nao.envs.boxing_envs import RandomisedRobot, VariationRanges
from creative_nao.errors import SettingsError
from creative_nao.robot import Performer, RobotVariation, Scene, first_failure

FIXED = {field.name: (getattr(RobotVariation(), field.name),) * 2 for field in dataclasses.fields(RobotVariation)}


@pytest.fixture(scope="module")
def demos():
    return load_demonstrations()


@pytest.fixture(scope="module")
def performer():
    return Performer(Scene())


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def make(**ranges):
    return RandomisedRobot(gym.make("CreativeNao/Boxing-v0", n_actions=3), VariationRanges(**ranges))


def punch(performer, demos):
    return performer.perform(demos.trajectories[1], demos.dt_s)


@pytest.mark.parametrize(
    "change",
    [{"mass": 1.1}, {"friction": 0.5}, {"kp": 0.7}, {"kd": 2.0}, {"latency_s": 0.03}, {"encoder_noise_rad": 0.01}],
)
def test_each_figure_changes_what_is_measured_and_is_taken_back(change, performer, demos, rng):
    before = punch(performer, demos)
    performer.vary(RobotVariation(**change), rng)
    varied = punch(performer, demos)
    performer.vary(RobotVariation(), rng)
    after = punch(performer, demos)

    assert not np.array_equal(varied.measured, before.measured) or varied.hits != before.hits
    for field in dataclasses.fields(before):
        assert np.array_equal(getattr(after, field.name), getattr(before, field.name)), field.name


def test_latency_is_felt_as_an_error_that_grows_with_speed(performer, demos, rng):
    errors = []
    for latency in (0.0, 0.02, 0.04):
        performer.vary(RobotVariation(latency_s=latency), rng)
        errors.append(punch(performer, demos).mean_error_rad.max())
    performer.vary(RobotVariation(), rng)
    assert errors[0] < errors[1] < errors[2]


def test_the_mass_of_all_links_is_scaled_and_that_of_the_bag_is_not(rng):
    scene = Scene()
    weight, bag = scene.model.body_subtreemass[scene.index.torso], scene.model.body("bag/bag").mass[0]
    Performer(scene).vary(RobotVariation(mass=1.2), rng)
    assert scene.model.body_subtreemass[scene.index.torso] == pytest.approx(1.2 * weight)
    assert scene.model.body("bag/bag").mass[0] == bag


def test_the_same_seed_draws_the_same_robots_and_another_seed_others():
    env, other = make(), make()
    first = [env.reset(seed=3)[1]["variation"], env.reset()[1]["variation"]]
    second = [other.reset(seed=3)[1]["variation"], other.reset()[1]["variation"]]

    assert first == second
    assert first[0] != first[1]
    assert env.reset(seed=4)[1]["variation"] != first[0]


def test_an_episode_with_noise_is_the_same_for_the_same_seed():
    def play(seed):
        env = make(encoder_noise_rad=(0.001, 0.001))
        env.reset(seed=seed)
        return [env.step(np.full(2, 0.1, np.float32))[4]["trajectory"] for _ in range(2)]

    one, two, other = play(7), play(7), play(8)
    assert np.array_equal(one, two)
    assert not np.array_equal(one, other)
    assert not np.array_equal(one[0], one[1])  # the noise goes on


def test_draws_stay_in_their_ranges():
    ranges, rng = VariationRanges(), np.random.default_rng(0)
    for _ in range(50):
        drawn = ranges.draw(rng)
        for name, (low, high) in dataclasses.asdict(ranges).items():
            assert low <= getattr(drawn, name) <= high


def test_ranges_of_no_width_at_the_published_robot_change_no_bit():
    env, plain = make(**FIXED), gym.make("CreativeNao/Boxing-v0", n_actions=3)
    env.reset(seed=0)
    plain.reset(seed=0)
    pb = np.array([0.3, -0.2], np.float32)
    assert np.array_equal(env.step(pb)[4]["trajectory"], plain.step(pb)[4]["trajectory"])


def test_the_basic_actions_pass_at_both_ends_of_every_range(performer, demos, rng):
    """What the ranges promise; each end by itself."""
    for name, ends in dataclasses.asdict(VariationRanges()).items():
        for end in ends:
            performer.vary(RobotVariation(**{name: end}), rng)
            for trajectory in (demos.trajectories[1], demos.trajectories[5]):
                assert first_failure(performer.perform(trajectory, demos.dt_s)) is None, (name, end)
    performer.vary(RobotVariation(), rng)


def test_what_is_no_robot_is_refused():
    with pytest.raises(SettingsError, match="`mass` should be above 0, but is 0"):
        RobotVariation(mass=0.0)
    with pytest.raises(SettingsError, match=r"`latency_s` should be at least 0, but is -0\.1"):
        VariationRanges(latency_s=(-0.1, 0.0))
    with pytest.raises(SettingsError, match=r"`kp` should be a range \(low, high\), but is \(2.0, 1.0\)"):
        VariationRanges(kp=(2.0, 1.0))
    with pytest.raises(SettingsError, match="only an environment in which a robot performs"):
        RandomisedRobot(gym.make("CreativeNao/BoxingMental-v0"))
