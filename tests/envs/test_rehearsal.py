"""Rehearsal: every step imagines; a commit performs the best imagined since the last performance."""

from contextlib import closing

import gymnasium as gym
import numpy as np
import pytest

from creative_nao.envs import BoxingMentalEnv, BoxingRehearsalEnv, BoxingRehearsalVectorEnv
from creative_nao.envs.observation import split
from creative_nao.errors import SettingsError

REHEARSAL = "CreativeNao/BoxingRehearsal-v0"


@pytest.fixture
def points():
    return np.random.default_rng(0).uniform(-1, 1, (40, 2)).astype(np.float32)


def act(pb, commit):
    return np.array([*pb, 1.0 if commit else -1.0], np.float32)


def test_it_earns_what_the_best_imagined_one_earns_when_performed(points, same):
    """Beside it an environment that performs the same points: rewards and terms have the same bits."""
    env, plain = BoxingRehearsalEnv(), BoxingMentalEnv(n_imagined=240)
    env.reset()
    plain.reset()
    for batch in points.reshape(-1, 5, 2):
        worth = plain.imagine(batch)["reward_novelty"]
        for k, pb in enumerate(batch):
            _, reward, *_, info = env.step(act(pb, k == 4))
            assert info["imagined_reward_novelty"] == worth[k]
            assert (reward == 0.0 and "outcome" not in info) or k == 4
        best = batch[worth.argmax()]
        _, expected, *_, told = plain.step(best)
        assert reward == expected == worth.max()
        assert np.array_equal(info["performed_pb"], best)
        terms = told.keys() - {"pb", "step", "n_imagined", "memory", "episode_measures"}
        assert same({name: info[name] for name in terms}, {name: told[name] for name in terms})


def test_without_a_usable_one_the_last_is_performed():
    """The corner of open/0 fluctuates, and so does the point next to it."""
    env = BoxingRehearsalEnv("open/0")
    env.reset()
    fluctuating = [
        pb for pb in np.random.default_rng(0).uniform(-1, 1, (60, 2)).astype(np.float32)
        if env.step(act(pb, False))[4]["imagined_outcome"] == "fluctuating"
    ]  # fmt: skip
    env.reset()
    env.step(act(fluctuating[0], False))
    _, reward, *_, info = env.step(act(fluctuating[1], True))

    assert np.array_equal(info["performed_pb"], fluctuating[1])
    assert (reward, info["outcome"], info["appropriate"], info["repertoire_size"]) == (0.0, "fluctuating", False, 0)


def test_what_was_imagined_before_a_performance_is_forgotten(points):
    env = BoxingRehearsalEnv()
    env.reset()
    for pb in points[:10]:
        env.step(act(pb, False))
    env.step(act(points[10], True))
    *_, info = env.step(act(points[11], True))

    assert np.array_equal(info["performed_pb"], points[11])


def test_the_observation_tells_every_try(points):
    env = BoxingRehearsalEnv(n_actions=3, n_imagined=20)
    env.reset()
    for k, pb in enumerate(points[:8]):
        observation, reward, *_, info = env.step(act(pb, k in (3, 6)))
        if "outcome" in info:
            last, earned = info, reward
    parts = split(observation, env.observation_parts, env.try_columns)
    columns = {column.name: parts["tries"][:, column.start : column.stop] for column in env.try_columns}
    performed = np.flatnonzero(columns["performed"])

    assert columns["tried"].ravel().tolist() == [1.0] * 8 + [0.0] * 12
    assert np.array_equal(columns["pb"][:8], points[:8])
    assert np.array_equal(columns["pb"][performed[1]], last["performed_pb"].astype(np.float32))
    assert len(performed) == 2
    assert performed[0] < 4 <= performed[1] < 7
    assert columns["reward"][performed[1], 0] == pytest.approx(earned / (1.0 + earned))
    assert np.flatnonzero(columns["candidate"]).tolist() == [7]
    assert (parts["step"][0], parts["imagined"][0]) == (np.float32(2 / 3), np.float32(8 / 20))
    assert np.array_equal(parts["points"], env.memory.pb.ravel().astype(np.float32))
    assert observation in env.observation_space


@pytest.mark.parametrize(("commits", "n_steps", "n_performed"), [(True, 3, 3), (False, 7, 0)])
def test_either_budget_ends_the_episode(commits, n_steps, n_performed, points):
    with gym.make(REHEARSAL, n_actions=3, n_imagined=7) as env:
        assert env.spec.max_episode_steps == 7
        env.reset()
        ends = []
        for pb in points[:n_steps]:
            *_, terminated, truncated, info = env.step(act(pb, commits))
            ends.append(truncated)
            assert not terminated
        assert ends == [False] * (n_steps - 1) + [True]
        assert info["episode_measures"].keys() == {"appropriateness_pct", "novelty", "diversity"}
        assert (len(env.unwrapped.repertoire) <= n_performed, info["n_imagined"]) == (True, n_steps)
        with pytest.raises(SettingsError, match=f"the episode has ended after {n_performed} movements"):
            env.step(act(points[0], True))


def test_with_physics_the_body_performs_it(points):
    with gym.make(REHEARSAL, physics=True) as env:
        env.reset()
        env.step(act(points[0], False))
        *_, info = env.step(act(points[1], True))

    assert not np.array_equal(info["trajectory"], info["imagined_trajectory"])
    assert np.abs(info["trajectory"] - info["commanded"]).max() < 0.5
    assert {"fell", "tracking_error"} <= info.keys()


def test_a_candidate_is_part_of_the_state(points):
    env = BoxingRehearsalEnv(n_imagined=9)
    env.reset()
    for pb in points[:3]:
        env.step(act(pb, False))
    state = env.get_state()
    worth = env.step(act(points[3], True))[1]
    env.reset()
    env.set_state(state)
    assert env.step(act(points[3], True))[1] == worth > 0.0
    state.values["candidate"] = 5
    with pytest.raises(SettingsError, match="its `candidate` should be at most its `n_imagined`, 3, but is 5"):
        env.set_state(state)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"n_imagined": 0}, "`n_imagined` should be at least 1"),
        ({"observation": "cells"}, "`observation` should be one of outcomes, points, trajectories, but is 'cells'"),
        ({"observation": "map"}, "`observation` should be one of"),
        ({"observation": None}, "`observation` should be one of"),
        ({"physics": 1}, "`physics` should be"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    for make in (BoxingRehearsalEnv, BoxingRehearsalVectorEnv):
        with pytest.raises(SettingsError, match=message):
            make(**arguments)


def test_many_rehearse_in_physics_and_over_the_bank_as_single_ones_do(points):
    arguments = {"memory": "train", "n_imagined": 4, "n_actions": 2}
    with closing(BoxingRehearsalVectorEnv(3, n_threads=2, **arguments)) as envs:
        names = envs.reset(seed=1)[1]["memory"]
        singles = [gym.make(REHEARSAL, **{**arguments, "memory": name}) for name in names]
        for env in singles:
            env.reset()
        for k in range(4):
            actions = np.stack([act(pb, (k + j) % 3 == 0) for j, pb in enumerate(points[3 * k : 3 * k + 3])])
            seen, rewards, _, over, _ = envs.step(actions)
            for j, env in enumerate(singles):
                observation, reward, _, truncated, _ = env.step(actions[j])
                assert np.array_equal(observation, seen[j])
                assert (reward, truncated) == (rewards[j], over[j])
            if over.any():
                break
    assert len(set(names)) > 1
