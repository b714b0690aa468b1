"""Exact state: an environment put back, copied, pickled or kept in a file goes on with the same bits."""

import copy
import json
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

from creative_nao.envs import ENVIRONMENTS, EnvState
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError, ShapeError

STEPS = {
    "CreativeNao/Boxing-v0": 2,
    "CreativeNao/BoxingMental-v0": 200,
    "CreativeNao/BoxingMental-v1": 40,
    "CreativeNao/BoxingModulation-v0": 200,
    "CreativeNao/BoxingModulation-v1": 40,
    "CreativeNao/BoxingRehearsal-v0": 40,
}


@pytest.fixture(params=STEPS)
def name(request):
    return request.param


@pytest.fixture
def env(name):
    """In the middle of an episode, and for modulation in the middle of a movement."""
    with gym.make(name) as env:
        env.reset(seed=1)
        go_on(env, 7 if "Modulation" in name else 2)
        yield env


def go_on(env, n_steps, seed=5):
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(n_steps):
        found.append(env.step(rng.uniform(-1, 1, env.action_space.shape).astype(np.float32)))
        if found[-1][3]:
            found.append(env.reset())
    return found


def test_every_environment_is_tested():
    assert set(STEPS) == set(ENVIRONMENTS) - {"CreativeNao/Boxing-v1"}, "-v1 differs in the observation alone"


def test_whatever_has_the_state_goes_on_alike(env, name):
    """The environment put back, another one, a deep copy and one that was pickled."""
    state, copied, pickled = env.unwrapped.get_state(), copy.deepcopy(env), pickle.loads(pickle.dumps(env))
    first = go_on(env, STEPS[name])
    env.unwrapped.set_state(state)
    with gym.make(name) as other:
        other.reset(seed=9)
        other.unwrapped.set_state(state)
        for one in (env, other, copied, pickled):
            assert data_equivalence(first, go_on(one, STEPS[name]), exact=True)


@pytest.mark.slow
def test_the_robot_goes_on_alike_for_two_hundred_actions():
    with gym.make("CreativeNao/Boxing-v0") as env:
        env.reset(seed=1)
        go_on(env, 2)
        copied, pickled, state = copy.deepcopy(env), pickle.loads(pickle.dumps(env)), env.unwrapped.get_state()
        first = go_on(env, 200)
        env.unwrapped.set_state(state)

        for other in (env, copied, pickled):
            assert data_equivalence(first, go_on(other, 200), exact=True)


def test_a_state_survives_a_file(env, name, tmp_path):
    state = EnvState.load(env.unwrapped.get_state().save(tmp_path / "state.safetensors"))
    first = go_on(env, 3)
    env.unwrapped.set_state(state)

    assert data_equivalence(first, go_on(env, 3), exact=True)


def test_a_state_is_plain(env):
    state = env.unwrapped.get_state()

    json.dumps(state.values)
    assert all(type(array) is np.ndarray and array.dtype.kind in "fi" for array in state.arrays.values())
    assert all(not np.shares_memory(array, env.unwrapped._batch.archive._known) for array in state.arrays.values())


def test_the_physical_state_is_part_of_it():
    with gym.make("CreativeNao/Boxing-v0") as env:
        env.reset()
        env.step(env.unwrapped.memory.pb[1].astype(np.float32))
        data, state = env.unwrapped.data.qpos.copy(), env.unwrapped.get_state()
        env.reset()
        assert not np.array_equal(env.unwrapped.data.qpos, data)
        env.unwrapped.set_state(state)

        assert np.array_equal(env.unwrapped.data.qpos, data)
        assert np.array_equal(copy.deepcopy(env).unwrapped.data.qpos, data)
        with pytest.raises(ShapeError, match="`state` should have shape"):
            env.unwrapped.performer.set_state(np.zeros(3))


def test_the_draw_of_memories_is_part_of_it():
    with gym.make("CreativeNao/BoxingMental-v0", memory="train") as env:
        env.reset(seed=3)
        state = env.unwrapped.get_state()
        drawn = [env.reset()[1]["memory"] for _ in range(6)]
        env.unwrapped.set_state(state)

        assert drawn == [env.reset()[1]["memory"] for _ in range(6)]
        assert len(set(drawn)) > 1


def test_states_of_other_environments_and_memories_are_refused():
    with gym.make("CreativeNao/BoxingMental-v0") as mental, gym.make("CreativeNao/BoxingModulation-v0") as modulation:
        mental.reset()
        modulation.reset()
        with pytest.raises(SettingsError, match="one of a BoxingMentalEnv, but is one of a BoxingModulationEnv"):
            mental.unwrapped.set_state(modulation.unwrapped.get_state())
        with (
            gym.make("CreativeNao/BoxingMental-v0", memory="open/0") as other,
            pytest.raises(NotFoundError, match="`state`: no memory `half/0`"),
        ):
            other.unwrapped.set_state(mental.unwrapped.get_state())


def test_a_foreign_file_is_no_state(tmp_path):
    from creative_nao.model import load_memory

    path = load_memory("half/0").save(tmp_path / "memory.safetensors")
    with pytest.raises(FileFormatError, match="expected kind 'environment-state'"):
        EnvState.load(path)
