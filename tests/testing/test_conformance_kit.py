"""What meets the requirements passes; each unmet one is named."""

import dataclasses
import importlib.util

import gymnasium as gym
import numpy as np
import pytest

from creative_nao import envs
from creative_nao.envs import ENVIRONMENTS
from creative_nao.errors import CreativeNaoError
from creative_nao.model import load_memory
from creative_nao.robot import Performer
from creative_nao.testing import ConformanceError, check_environment, check_memory, check_performer, check_task
from creative_nao.testing.conformance import check_scores

MENTAL = "CreativeNao/BoxingMental-v0"


class Straight:
    """A memory that is no network: every joint goes from the first posture in a straight line that the PB turns."""

    def __init__(self, demonstrations, broken=None):
        self.demonstrations = demonstrations
        self.joints, self.dt_s = demonstrations.joints, demonstrations.dt_s
        self.pb = np.linspace(-0.9, 0.9, 2 * demonstrations.n_actions).reshape(-1, 2)
        self.n_calls = 0
        for name, value in (broken or {}).items():
            setattr(self, name, value)

    def generate(self, pb, n_steps=None):
        start = self.demonstrations.trajectories[0][0]
        ramp = np.linspace(0, 1, n_steps or 50)[None, :, None]
        return start + 0.3 * ramp * np.asarray(pb)[:, :1, None] * np.asarray(pb)[:, 1:, None]


def test_what_is_no_network_can_be_a_memory(demonstrations):
    check_memory(Straight(demonstrations))


def test_a_trained_memory_passes():
    check_memory(load_memory("half/0"))


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        ({"demonstrations": None}, "`demonstrations` should be a Demonstrations, but found NoneType"),
        (
            {"pb": np.zeros((5, 2))},
            r"`pb` should have shape \(6, n_pb\), .*, but found \(5, 2\)",
        ),
        ({"pb": np.full((6, 2), 1.5)}, r"`pb` should lie in \[-1, 1\]"),
        ({"dt_s": 0.1}, "`dt_s` should be that of the demonstrations, 0.15, but found 0.1"),
        ({"joints": ("RElbowRoll",)}, "`joints` should be that of the demonstrations"),
    ],
)
def test_wrong_properties_of_a_memory_are_named(demonstrations, broken, message):
    with pytest.raises(ConformanceError, match=message):
        check_memory(Straight(demonstrations, broken))


def generates(change):
    class Broken(Straight):
        def generate(self, pb, n_steps=None):
            self.n_calls += 1
            return change(self, pb, super().generate(pb, n_steps))

    return Broken


def spoil(pb, angles):
    pb[:] = 0
    return angles


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda self, pb, angles: angles.tolist(), "should return an array, but found list"),
        (lambda self, pb, angles: angles[:, :-1], r"should return shape \(7, 50, 8\), but found \(7, 49, 8\)"),
        (lambda self, pb, angles: angles.astype(np.float32), "should return float64, but found float32"),
        (lambda self, pb, angles: angles * np.nan, "should return finite angles"),
        (lambda self, pb, angles: spoil(pb, angles), "should leave its argument alone"),
        (lambda self, pb, angles: angles + 1e-9 * self.n_calls, "should give the same bits again"),
        (lambda self, pb, angles: angles + 1e-9 * len(pb), "alone should give the bits it has in a batch"),
        (lambda self, pb, angles: angles + np.arange(len(pb))[:, None, None] // 6 % 2 * 1e-9, "alone|order"),
        (lambda self, pb, angles: angles + np.asarray(pb)[:, :1, None], "row 0 should be one initial posture"),
    ],
)
def test_each_unmet_requirement_of_generation_is_named(demonstrations, change, message):
    with pytest.raises(ConformanceError, match=message):
        check_memory(generates(change)(demonstrations))


def test_a_length_that_is_not_obeyed_is_named(demonstrations):
    class Deaf(Straight):
        def generate(self, pb, n_steps=None):
            return super().generate(pb)

    with pytest.raises(ConformanceError, match="n_steps=49 should be obeyed"):
        check_memory(Deaf(demonstrations))


@pytest.fixture(scope="module")
def performer():
    return Performer()


def test_the_robot_passes(performer):
    check_performer(performer)


class Changed:
    """The robot, but what it tells is changed."""

    def __init__(self, performer, **changes):
        self.performer, self.changes, self.n_calls = performer, changes, 0

    def perform(self, trajectory, dt_s):
        self.n_calls += 1
        done = self.performer.perform(trajectory, dt_s)
        return dataclasses.replace(done, **{name: change(self, done) for name, change in self.changes.items()})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"measured": lambda self, done: done.measured[1:]}, r"`measured` should have shape \(50, 8\)"),
        ({"self_collision_share": lambda self, done: 1.5}, r"shares of the time should lie in \[0, 1\]"),
        ({"measured": lambda self, done: done.measured + self.n_calls}, "the same bits of `measured` again"),
        ({"fell": lambda self, done: self.n_calls > 1}, "standing still in the first posture should be performable"),
        ({"fell": lambda self, done: self.n_calls > 5}, "basic action left_jab should be performable, but found fell"),
    ],
)
def test_each_unmet_requirement_of_a_robot_is_named(performer, changes, message):
    with pytest.raises(ConformanceError, match=message):
        check_performer(Changed(performer, **changes))


needs_dm_control = pytest.mark.skipif(
    importlib.util.find_spec("dm_control") is None, reason="pip cannot install it on Python 3.13"
)


@needs_dm_control
def test_the_task_passes():
    check_task(lambda seed: envs.load("boxing", seed=seed, start_noise_rad=0.05))


class Task:
    """The task, but its steps are changed."""

    def __init__(self, env, change):
        self.env, self.change = env, change

    def __getattr__(self, name):
        return getattr(self.env, name)

    def step(self, action):
        return self.change(self.env.step(action))


@needs_dm_control
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda step: step._replace(reward=np.nan), "rewards should be finite"),
        (lambda step: step._replace(discount=2.0), r"discounts should lie in \[0, 1\], but found 2.0"),
        (lambda step: step._replace(observation={}), "observations should be those of the spec"),
    ],
)
def test_each_unmet_requirement_of_a_task_is_named(change, message):
    with pytest.raises(ConformanceError, match=message):
        check_task(lambda seed: Task(envs.load("boxing", seed=seed), change), n_steps=2)


@needs_dm_control
def test_a_task_without_seeds_is_named():
    seeds = iter(range(100))
    with pytest.raises(ConformanceError, match="equal seeds should give equal bits"):
        check_task(lambda seed: envs.load("boxing", seed=next(seeds), start_noise_rad=0.05), n_steps=2)


def test_our_environment_passes():
    check_environment(MENTAL, n_actions=2)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted({*ENVIRONMENTS} - {MENTAL}))
def test_our_other_environments_pass(name):
    """In rehearsal every step has to commit, to be a movement."""

    def make():
        env, space = gym.make(name), gym.spaces.Box(-1, 1, (2,), np.float32)
        if "Rehearsal" not in name:
            return env
        return gym.wrappers.TransformAction(env, lambda pb: np.append(pb, np.float32(1)), space)

    check_environment(make, n_actions=2)


class Generous(gym.Wrapper):
    def step(self, action):
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, float(reward) + 1.0, terminated, truncated, info


class Silent(gym.Wrapper):
    def step(self, action):
        observation, reward, terminated, truncated, _ = self.env.step(action)
        return observation, reward, terminated, truncated, {}


@pytest.mark.parametrize(
    ("wrapper", "message"),
    [(Generous, "should earn 0|the reward should be what `info` says"), (Silent, "`info` should tell outcome")],
)
def test_each_unmet_requirement_of_an_environment_is_named(wrapper, message):
    with gym.make(MENTAL) as env, pytest.raises(ConformanceError, match=message):
        check_scores(wrapper(env), 2)


def test_what_gymnasium_finds_is_told():
    class Wrong(type(gym.make(MENTAL).unwrapped)):
        def reset(self, *, seed=None, options=None):
            observation, info = super().reset(seed=seed, options=options)
            return observation + 5, info

    with pytest.raises(ConformanceError, match="Gymnasium's checker should find nothing, but found"):
        check_environment(Wrong)


def test_a_unmet_requirement_is_one_of_the_projects_errors():
    assert issubclass(ConformanceError, CreativeNaoError)
