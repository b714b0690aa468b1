"""Vector environments: the bits of separate environments in Gymnasium's own vector environments."""

import copy
import pickle
from contextlib import closing

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from creative_nao.envs import ENVIRONMENTS
from creative_nao.errors import NotFoundError, SettingsError, ShapeError
from creative_nao.model import SPLITS, split_memories

BOXING = "CreativeNao/Boxing-v0"
STEPS = {
    BOXING: (2, 2, 5),
    "CreativeNao/BoxingMental-v0": (5, 3, 12),
    "CreativeNao/BoxingMental-v1": (3, 3, 12),
    "CreativeNao/BoxingModulation-v0": (3, 2, 45),
    "CreativeNao/BoxingModulation-v1": (2, 2, 45),
    "CreativeNao/BoxingRehearsal-v0": (3, 2, 12),
}
"""Sub-environments, actions in an episode, and steps to play."""


@pytest.fixture(params=STEPS)
def name(request):
    return request.param


def native(name, n=None, **arguments):
    n = n or STEPS[name][0]
    return gym.make_vec(name, n, vectorization_mode="vector_entry_point", **arguments)


def separate(name, n=None, mode="sync", autoreset_mode=AutoresetMode.NEXT_STEP, **arguments):
    n = n or STEPS[name][0]
    return gym.make_vec(name, n, vectorization_mode=mode, vector_kwargs={"autoreset_mode": autoreset_mode}, **arguments)


def play(envs, n_steps, seed=3):
    rng = np.random.default_rng(seed)
    found = [envs.reset(seed=seed)]
    for _ in range(n_steps):
        found.append(envs.step(rng.uniform(-1, 1, envs.action_space.shape).astype(np.float32)))
    envs.close()
    return found


def test_every_environment_is_tested():
    assert set(STEPS) == set(ENVIRONMENTS) - {"CreativeNao/Boxing-v1"}, "-v1 differs in the observation alone"


@pytest.mark.parametrize(
    ("name", "mode"),
    [
        pytest.param(name, mode, marks=[pytest.mark.slow] if name == BOXING and mode is AutoresetMode.SAME_STEP else [])
        for name in STEPS
        for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP)
    ],
)
def test_the_same_bits_as_sync(name, mode, same):
    _, n_actions, n_steps = STEPS[name]
    ours = play(native(name, n_actions=n_actions, autoreset_mode=mode), n_steps)
    theirs = play(separate(name, n_actions=n_actions, autoreset_mode=mode), n_steps)

    assert sum(step[3].any() for step in ours[1:]) >= 2, "episodes end on the way"
    assert same(ours, theirs)


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_the_same_bits_as_async(mode, same):
    arguments = {"n_actions": 3, "autoreset_mode": mode}
    ours = play(native("CreativeNao/BoxingMental-v0", 2, **arguments), 8)
    theirs = play(separate("CreativeNao/BoxingMental-v0", 2, "async", **arguments), 8)

    assert same(ours, theirs)


@pytest.mark.parametrize("n_threads", [1, 2, 3])
def test_any_number_of_threads_gives_the_same_bits(n_threads, same):
    one = play(native("CreativeNao/BoxingMental-v0", 40, n_threads=1), 6)
    many = play(native("CreativeNao/BoxingMental-v0", 40, n_threads=n_threads), 6)

    assert same(one, many)


def test_sub_environments_draw_their_own_memories_as_separate_ones_do(same):
    arguments = {"memory": "train", "n_actions": 2, "autoreset_mode": AutoresetMode.SAME_STEP}
    ours = play(native("CreativeNao/BoxingMental-v0", 12, **arguments), 7)
    theirs = play(separate("CreativeNao/BoxingMental-v0", 12, **arguments), 7)

    assert same(ours, theirs)
    assert len(set(ours[0][1]["memory"])) > 1
    assert set(ours[0][1]["memory"]) <= set(split_memories("train"))


def test_a_memory_may_be_named_for_all():
    drawn = split_memories("train")[-1]
    with closing(native("CreativeNao/BoxingMental-v0", memory="train")) as envs:
        assert set(envs.reset(options={"memory": drawn})[1]["memory"]) == {drawn}
        assert {memory.name for memory in envs.memories} == {drawn}
        with pytest.raises(NotFoundError, match="no memory `hlf/0`"):
            envs.reset(options={"memory": "hlf/0"})
    assert "train" in SPLITS


@pytest.mark.parametrize("name", [pytest.param(BOXING, marks=pytest.mark.slow), *sorted({*STEPS} - {BOXING})])
def test_episodes_begun_at_different_times_are_those_of_sync(name, same):
    """Only some are reset with a mask, so that from then on they end at different steps."""
    n, n_actions, n_steps = STEPS[name]
    mask = np.array([True, False, False, True, False])[:n]

    def play_masked(envs):
        rng = np.random.default_rng(0)
        found = [envs.reset(seed=1)]
        for k in range(n_steps):
            if k == 1:
                found.append(envs.reset(options={"reset_mask": mask.copy()}))
            found.append(envs.step(rng.uniform(-1, 1, envs.action_space.shape).astype(np.float32)))
        envs.close()
        return found

    for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP):
        ours = play_masked(native(name, n_actions=n_actions, autoreset_mode=mode))
        theirs = play_masked(separate(name, n_actions=n_actions, autoreset_mode=mode))
        assert same(ours, theirs)


def test_without_autoreset_ended_episodes_wait_for_a_mask():
    with closing(native("CreativeNao/BoxingMental-v0", 2, n_actions=1, autoreset_mode="Disabled")) as envs:
        envs.reset(seed=0)
        assert envs.step(np.zeros((2, 2)))[3].all()
        with pytest.raises(SettingsError, match=r"sub-environments \[0, 1\] have ended"):
            envs.step(np.zeros((2, 2)))
        envs.reset(options={"reset_mask": np.ones(2, bool)})
        assert envs.step(np.zeros((2, 2)))[3].all()


@pytest.mark.parametrize("mode", AutoresetMode)
def test_the_autoreset_mode_is_declared(name, mode):
    with closing(native(name, autoreset_mode=mode)) as envs:
        assert envs.metadata["autoreset_mode"] is mode


def test_the_spaces_are_those_of_the_single_environment(name):
    with closing(native(name)) as envs, gym.make(name) as env:
        assert envs.single_observation_space == env.observation_space
        assert envs.single_action_space == env.action_space
        assert envs.observation_space.shape == (envs.num_envs, *env.observation_space.shape)


def test_states_go_back_and_into_single_environments(name, same):
    n, n_actions, _ = STEPS[name]
    with closing(native(name, n_actions=n_actions)) as envs, gym.make(name, n_actions=n_actions) as env:
        actions = np.random.default_rng(0).uniform(-1, 1, (3, *envs.action_space.shape)).astype(np.float32)
        envs.reset(seed=2)
        envs.step(actions[0])
        states = envs.get_state()
        first = envs.step(actions[1])
        envs.set_state(states)
        second = envs.step(actions[1])
        env.reset()
        env.unwrapped.set_state(states[n - 1])
        alone = env.step(actions[1, n - 1])

    assert same(first, second)
    assert np.array_equal(alone[0], first[0][n - 1])
    assert alone[1] == first[1][n - 1]


def test_copies_go_on_alike(name, same):
    _, n_actions, _ = STEPS[name]
    envs = native(name, n_actions=n_actions)
    envs.reset(seed=0)
    envs.step(np.zeros(envs.action_space.shape, np.float32))
    others = [copy.deepcopy(envs), pickle.loads(pickle.dumps(envs))]

    for k in range(3):
        actions = np.random.default_rng(k).uniform(-1, 1, envs.action_space.shape).astype(np.float32)
        found = envs.step(actions)
        assert all(same(found, other.step(actions)) for other in others)
    for one in (envs, *others):
        one.close()


def test_each_sub_environment_is_rendered():
    with closing(native("CreativeNao/BoxingMental-v0", 2, render_mode="rgb_array")) as envs:
        envs.reset()
        envs.step(envs.memories[0].pb[:2].astype(np.float32))
        one, other = envs.render()

    assert one.shape == other.shape == (480, 640, 3)
    assert not np.array_equal(one, other)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"num_envs": 0}, "`num_envs` should be at least 1"),
        ({"n_threads": 0}, "`n_threads` should be at least 1"),
        ({"autoreset_mode": "never"}, "`autoreset_mode` should be one of"),
        ({"render_mode": "human"}, "opens one window"),
        ({"n_actions": 0}, "`n_actions` should be at least 1"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    from creative_nao.envs import BoxingMentalVectorEnv

    with pytest.raises(SettingsError, match=message):
        BoxingMentalVectorEnv(**arguments)


def test_bad_actions_seeds_and_masks_are_named():
    with closing(native("CreativeNao/BoxingMental-v0", 2)) as envs:
        envs.reset()
        with pytest.raises(ShapeError, match=r"finite PB vectors of shape \(2, 2\)"):
            envs.step(np.zeros(2))
        with pytest.raises(SettingsError, match="`seed` should hold 2 seeds"):
            envs.reset(seed=[1])
        with pytest.raises(SettingsError, match="reset_mask"):
            envs.reset(options={"reset_mask": np.zeros(2, bool)})
        with pytest.raises(SettingsError, match="`states` should hold 2 states"):
            envs.set_state([])
