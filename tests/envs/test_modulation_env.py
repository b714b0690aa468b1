"""The PB may change while a movement unfolds."""

import gymnasium as gym
import numpy as np
import pytest

from creative_nao.errors import SettingsError
from creative_nao.model import load_memory

NAME = "CreativeNao/BoxingModulation-v0"


@pytest.fixture
def env():
    with gym.make(NAME) as env:
        yield env


def unfold(env, path):
    return [env.step(np.asarray(pb, np.float32)) for pb in path]


def test_a_pb_held_constant_is_the_movement_of_the_mental_environment(env):
    pb = np.array([0.3, -0.6], np.float32)
    with gym.make("CreativeNao/BoxingMental-v0") as mental:
        mental.reset()
        env.reset()
        expected = mental.step(pb)
        found = unfold(env, [pb] * 10)[-1]

    assert np.array_equal(found[4]["trajectory"], expected[4]["trajectory"])
    assert found[1] == expected[1]
    assert {k: v for k, v in found[4].items() if k in ("outcome", "distance", "nearest")} == {
        k: v for k, v in expected[4].items() if k in ("outcome", "distance", "nearest")
    }


def test_turning_the_pb_combines_actions(env):
    first, second = env.unwrapped.memory.pb[[0, 5]].astype(np.float32)
    env.reset()
    found = unfold(env, [first] * 5 + [second] * 5)[-1][4]
    alone = env.unwrapped.memory.generate(np.array([first, second], float))

    assert np.array_equal(found["trajectory"][:25], alone[0, :25])
    assert np.abs(found["trajectory"][25:] - alone[0, 25:]).max() > 0.2
    assert found["pb_path"].tolist() == [first.tolist()] * 5 + [second.tolist()] * 5


def test_only_the_last_decision_of_a_movement_earns(env):
    env.reset()
    steps = unfold(env, [env.unwrapped.memory.pb[2]] * 20)

    assert ["outcome" in step[4] for step in steps] == ([False] * 9 + [True]) * 2
    assert [step[1] for step in steps[:9]] == [0.0] * 9
    assert [step[4]["tick"] for step in steps[:10]] == list(range(5, 55, 5))
    assert [step[4]["step"] for step in steps] == list(range(1, 21))


def test_an_episode_is_thirty_movements_of_ten_decisions():
    with gym.make(NAME) as env:
        env.reset()
        steps = unfold(env, np.random.default_rng(0).uniform(-1, 1, (300, 2)))

    assert [step[3] for step in steps] == [False] * 299 + [True]
    assert set(steps[-1][4]["episode_measures"]) == {"appropriateness_pct", "novelty", "diversity"}


def test_the_observation_tells_posture_slow_layer_and_phase(env):
    start, _ = env.reset()
    first, *_, info = env.step(np.array([0.9, 0.9], np.float32))
    taught = np.concatenate(load_memory("half/0").demonstrations.trajectories)
    low, high = taught.min(axis=0), taught.max(axis=0)

    assert not np.delete(start, np.s_[85:93]).any()
    np.testing.assert_allclose(first[85:93], 2 * (info["posture"] - low) / (high - low) - 1, atol=1e-5)
    assert np.abs(first[93:103]).max() > 0
    assert first[103] == pytest.approx(0.1)
    assert first[:2].tolist() == pytest.approx([0.9, 0.9])
    assert first[84] == pytest.approx(1 / 300)


def test_the_next_movement_begins_with_the_network_at_rest(env):
    env.reset()
    rng = np.random.default_rng(3)
    path = rng.uniform(-1, 1, (10, 2))
    once = unfold(env, path)
    twice = unfold(env, path)

    assert np.array_equal(once[-1][4]["trajectory"], twice[-1][4]["trajectory"])
    assert not once[-1][0][93:104].any()


def test_the_robot_may_perform_it():
    pb = load_memory("half/0").pb[1].astype(np.float32)
    with gym.make(NAME, physics=True) as env, gym.make("CreativeNao/Boxing-v0") as boxing:
        env.reset()
        boxing.reset()
        expected = boxing.step(pb)[4]
        found = unfold(env, [pb] * 10)[-1][4]

    assert np.array_equal(found["trajectory"], expected["trajectory"])
    assert found["hits"] == expected["hits"]
    assert found["outcome"] == expected["outcome"]


def test_a_memory_that_cannot_be_stopped_is_refused(demonstrations):
    class Foreign:
        pb = np.zeros((6, 2))

        def generate(self, pb, n_steps=None):
            return np.repeat(demonstrations.trajectories[0][None], len(pb), axis=0)

    memory = Foreign()
    memory.demonstrations = demonstrations
    with pytest.raises(SettingsError, match="stopped between ticks"):
        gym.make(NAME, memory=memory)
    gym.make("CreativeNao/BoxingMental-v0", memory=memory).close()  # while whole movements can come from anything
