"""Flipped and swapped PB axes: the agent meets a consistent world, another one each episode, decided by the seed."""

import numpy as np
import pytest
from gymnasium.spaces import Box

from creative_nao.agents.augmentation import FlippedSwappedAxes, symmetries
from creative_nao.agents.settings import AUGMENTATION, check_entry
from creative_nao.envs import SB3VecEnv
from creative_nao.envs.observation import N_CELLS, cells_of, split, tries_of
from creative_nao.errors import SettingsError

MENTAL = "CreativeNao/BoxingMental-v0"
N = 8


def wrapped(env=MENTAL, seed=0, n_actions=3):
    made = FlippedSwappedAxes(SB3VecEnv(env, N, n_threads=1, memory="half/0", n_actions=n_actions))
    made.seed(seed)
    return made


def test_there_are_eight_symmetries_with_two_units_and_the_first_changes_nothing():
    table = symmetries(2)
    assert len(set(table)) == 8
    pb = np.array([[0.25, -0.5]])
    assert {tuple(np.array(signs) * pb[0, list(order)]) for order, signs in table} == {
        (a, b) for x, y in ((0.25, 0.5), (0.5, 0.25)) for a in (x, -x) for b in (y, -y)
    }
    env = wrapped()
    first = np.zeros(1, np.int64)
    observation = np.linspace(-1.0, 1.0, 85, dtype=np.float32)[None]
    assert np.array_equal(env.to_env(pb, first), pb)
    assert np.array_equal(env.to_agent(observation, first), observation)


@pytest.mark.parametrize(("env", "n_decisions"), [(MENTAL, 1), ("CreativeNao/BoxingModulation-v0", 10)])
def test_the_agent_sees_its_own_actions_in_its_own_cells(env, n_decisions):
    turned = wrapped(env)
    turned.reset()
    turned.symmetry = np.arange(N)  # every way once
    plain = SB3VecEnv(env, N, n_threads=1, memory="half/0", n_actions=3)
    plain.reset()
    rng = np.random.default_rng(0)
    cells = cells_of(turned.observation_space, 2)
    for decision in range(2 * n_decisions):
        pb = rng.uniform(-1.0, 1.0, (N, 2)).astype(np.float32)
        seen, rewards, _, _ = turned.step(pb)
        meant, expected, _, _ = plain.step(turned.to_env(pb, turned.symmetry))
        assert np.array_equal(rewards, expected)
        assert np.array_equal(seen[:, :2], pb)
        column = np.floor((pb + 1.0) / 2.0 * N_CELLS).astype(int)
        marked = seen[:, cells][np.arange(N), column[:, 0] + N_CELLS * column[:, 1]] != 0.0
        assert np.all(marked | ((decision + 1) % n_decisions != 0))
        others = np.r_[2 : cells.start, cells.stop : seen.shape[1]]
        assert np.array_equal(seen[:, others], meant[:, others])
        assert np.array_equal(np.sort(seen[:, cells]), np.sort(meant[:, cells]))
    assert not np.array_equal(seen[:, cells], meant[:, cells])


@pytest.mark.parametrize("env", ["CreativeNao/BoxingMental-v1", "CreativeNao/BoxingRehearsal-v0"])
def test_the_agent_sees_tries_and_learned_points_turned_alike(env):
    turned = wrapped(env)
    seen = turned.reset()
    turned.symmetry = np.arange(N)
    plain = SB3VecEnv(env, N, n_threads=1, memory="half/0", n_actions=3)
    meant = plain.reset()
    parts, columns = tries_of(turned.observation_space)
    rng, chosen = np.random.default_rng(0), []
    for _ in range(3):
        told, true = split(seen, parts, columns), split(meant, parts, columns)
        points = told["points"].reshape(N, -1, 2)
        if chosen:  # the learned points of the reset were turned otherwise
            back = np.stack([turned.to_env(row, np.full(6, k)) for k, row in enumerate(points)])
            assert np.array_equal(back.reshape(N, -1), true["points"])
            assert np.array_equal(told["tries"][:, : len(chosen), 1:3], np.stack(chosen, axis=1))
        assert np.array_equal(np.delete(told["tries"], [1, 2], axis=2), np.delete(true["tries"], [1, 2], axis=2))
        action = rng.uniform(-1.0, 1.0, (N, turned.action_space.shape[0])).astype(np.float32)
        action[:, 2:] = -1.0
        chosen.append(action[:, :2])
        sent = turned.to_env(action, turned.symmetry)
        assert np.array_equal(sent[:, 2:], action[:, 2:])
        seen, rewards, _, _ = turned.step(action)
        meant, expected, _, _ = plain.step(sent)
        assert np.array_equal(rewards, expected)


def test_every_episode_is_turned_anew_and_its_last_observation_as_before():
    env = wrapped(n_actions=2)
    env.reset()
    before = env.symmetry.copy()
    env.step(np.full((N, 2), 0.3, np.float32))
    assert np.array_equal(env.symmetry, before)
    pb = np.tile(np.array([[0.1, -0.7]], np.float32), (N, 1))
    seen, _, ended, infos = env.step(pb)
    assert ended.all()
    assert not np.array_equal(env.symmetry, before)
    for info in infos:
        assert np.array_equal(info["terminal_observation"][:2], pb[0])
    assert not seen.any()


def test_the_seed_decides_how_episodes_are_turned():
    drawn = []
    for seed in (3, 3, 4):
        env = wrapped(seed=seed)
        env.reset()
        drawn.append(env.symmetry.tolist())
    assert drawn[0] == drawn[1] != drawn[2]


def test_every_way_turns_up_about_equally_often():
    env = wrapped(n_actions=1)
    env.reset()
    counts = np.zeros(env.n_symmetries)
    for _ in range(100):
        np.add.at(counts, env.symmetry, 1)
        env.step(np.zeros((N, 2), np.float32))
    assert counts.min() > 0.7 * counts.mean()  # 100 expected each, standard deviation 9.4


def test_observations_without_cells_are_refused():
    with pytest.raises(SettingsError, match="`observation_space` should have 64 cells of a PB space with 2 units"):
        cells_of(Box(0.0, 1.0, (85,)), 2)


def test_hyperparameters_name_it_as_rl_zoo_does():
    chosen = check_entry("ppo", {"vec_env_wrapper": AUGMENTATION}, "here")
    assert chosen.augment
    assert check_entry("ppo", chosen.as_zoo(), "again") == chosen
    assert not check_entry("ppo", {}, "here").augment
    released = "creative_nao.agents.augmentation.FlippedSwappedAxes"
    assert check_entry("ppo", {"vec_env_wrapper": released}, "here") == chosen
    with pytest.raises(SettingsError, match=r"`vec_env_wrapper` should be creative_nao.* but is 'os.system'"):
        check_entry("ppo", {"vec_env_wrapper": "os.system"}, "here")
