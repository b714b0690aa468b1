"""Every generated action is written down, and what decides it is the seed alone."""

import csv
import json

import fake_boxing
import gymnasium as gym
import numpy as np
import pytest

from creative_nao.agents import make_agent
from creative_nao.errors import SettingsError
from creative_nao.evaluation.protocol import Episode, play, random_streams, write_episodes
from creative_nao.schema import dump, parse


def episode(agent="random", physical=False, n_actions=30, **kwargs):
    env = gym.wrappers.PassiveEnvChecker(fake_boxing.FakeBoxing(physical=physical))
    values = {"env_id": "Fake", "memory": "fake/0", "seed": 0, **kwargs}
    return play(make_agent(agent), env, n_actions=n_actions, **values)


def points(found):
    return [action.pb for action in found.actions]


def test_an_episode_spends_the_whole_budget():
    found = episode()
    assert [action.step for action in found.actions] == list(range(1, 31))
    assert found.reward == pytest.approx(sum(action.reward for action in found.actions))
    assert found.appropriateness_pct == pytest.approx(100.0 * np.mean([a.appropriate for a in found.actions]))


def test_the_seeds_decide_the_choices():
    assert points(episode(seed=1)) == points(episode(seed=1))
    assert points(episode(seed=1)) != points(episode(seed=2))
    assert points(episode(base_seed=0)) != points(episode(base_seed=1))
    assert random_streams(0, 1, "random")[1] != random_streams(0, 1, "supervised")[1]


def test_the_same_points_are_played_in_physics_and_in_the_mind():
    assert points(episode(physical=True)) == points(episode(physical=False))


@pytest.mark.parametrize(("n_actions", "text"), [(29, "but is 29; it goes on"), (31, "but is 31; it ends after 30")])
def test_a_budget_that_is_not_the_episode_is_refused(n_actions, text):
    with pytest.raises(SettingsError, match=text):
        episode(n_actions=n_actions)


def test_an_episode_survives_json():
    found = episode()
    assert parse(Episode, json.dumps(dump(found)), "episode") == found


def test_the_csv_holds_every_action_with_all_digits(tmp_path):
    found = [episode(seed=0), episode(seed=1)]
    with open(write_episodes(tmp_path / "episodes.csv", found), encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    columns = (
        "agent,env,memory,seed,step,pb_1,pb_2,outcome,appropriate,nearest,distance,known_distance,reward,"
        "repertoire_size,n_imagined"
    )
    assert ",".join(rows[0]) == columns
    assert len(rows) == 60
    assert float(rows[31]["distance"]) == found[1].actions[1].distance
    assert rows[31]["seed"] == "1"
