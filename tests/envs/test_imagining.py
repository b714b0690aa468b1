"""Imagining costs nothing but its budget, and tells what performing would."""

from contextlib import closing

import gymnasium as gym
import numpy as np
import pytest

from creative_nao.envs import BoxingEnv, BoxingMentalEnv, BoxingMentalVectorEnv, BoxingModulationEnv, Track
from creative_nao.errors import SettingsError, ShapeError


@pytest.fixture
def points():
    return np.random.default_rng(0).uniform(-1, 1, (12, 2)).astype(np.float32)


def test_it_is_told_to_the_bit_what_performing_earns(points, same):
    """One by one and many at once, with a repertoire that grows."""
    env = BoxingMentalEnv(n_imagined=200)
    env.reset()
    for pb in points:
        one, many = env.imagine(pb), env.imagine(points)
        _, reward, *_, info = env.step(pb)
        place = int(np.flatnonzero((points == pb).all(axis=1))[0])

        assert one["reward_novelty"] == reward
        assert same(one, {name: info[name] for name in one})
        assert all(np.array_equal(one[name], many[name][place]) for name in one)


def test_nothing_changes_but_the_count(points, same):
    played = []
    for n_imagined in (0, 12):
        env = BoxingMentalEnv(n_imagined=n_imagined, observation="trajectories")
        steps = [env.reset()]
        for pb in points:
            if n_imagined:
                env.imagine(-pb)
            steps.append(env.step(pb))
        assert [step[4].pop("n_imagined") for step in steps[1:]] == [min(k, n_imagined) for k in range(1, 13)]
        played.append(steps)

    assert same(*played)


def test_the_budget_is_counted_and_kept(points):
    env = BoxingMentalEnv(n_imagined=5)
    env.reset()
    env.imagine(points[0])
    env.imagine(points[:3])
    with pytest.raises(SettingsError, match=r"at most 1 movements to imagine, what is left of `n_imagined` \(5\)"):
        env.imagine(points[:2])
    assert env.n_imagined_used == 4, "what is refused does not count"
    env.imagine(points[0])
    with pytest.raises(SettingsError, match="at most 0"):
        env.imagine(points[0])
    env.reset()
    assert env.n_imagined_used == 0


def test_without_a_budget_nothing_is_imagined(points):
    with gym.make("CreativeNao/BoxingMental-v0") as env:
        env.reset()
        with pytest.raises(SettingsError, match="at most 0"):
            env.unwrapped.imagine(points[0])


def test_the_count_is_part_of_the_state(points, tmp_path):
    env = BoxingMentalEnv(n_imagined=5)
    env.reset()
    env.imagine(points[:4])
    state = env.get_state()
    env.reset()
    env.set_state(state)

    assert env.n_imagined_used == 4
    with pytest.raises(SettingsError, match="`n_imagined` should be at most 3, the budget here, but is 4"):
        BoxingMentalEnv(n_imagined=3).set_state(state)


def test_a_turning_pb_can_be_imagined_too(points, same):
    env, mental = BoxingModulationEnv(n_imagined=20), BoxingMentalEnv(n_imagined=20)
    env.reset()
    mental.reset()
    held, turned = env.imagine(points[:3]), env.imagine(points[None, :10])
    env.step(points[5])
    again = env.imagine(points[None, :10])
    assert same(turned, again), "a movement under way is none of its business"
    env.reset()
    for pb in points[:10]:
        *_, info = env.step(pb)

    assert same(held, mental.imagine(points[:3]))
    assert np.array_equal(turned["trajectory"][0], info["trajectory"])
    assert turned["reward_novelty"][0] == info["reward_novelty"]


def test_the_robot_imagines_without_its_body(points):
    body, mind = BoxingEnv(n_imagined=3), BoxingMentalEnv(n_imagined=3)
    body.reset()
    mind.reset()
    one, other = (env.imagine(points[:3]) for env in (body, mind))

    assert np.array_equal(one["trajectory"], other["trajectory"])
    assert np.array_equal(one["reward_novelty"], other["reward_novelty"])


def test_each_sub_environment_imagines_for_itself(points):
    with closing(BoxingMentalVectorEnv(3, "train", n_imagined=6, n_threads=2)) as envs:
        names = envs.reset(seed=0)[1]["memory"]
        envs.step(points[:3])
        found, few = envs.imagine(points.reshape(3, 4, 2)), envs.imagine(points[:2], [0, 2])
        assert envs.n_imagined_used.tolist() == [5, 4, 5]
        with pytest.raises(SettingsError, match="at most 1"):
            envs.imagine(points[:4].reshape(2, 2, 2), [1, 2])
        assert envs.n_imagined_used.tolist() == [5, 4, 5]
        for k, name in enumerate(names):
            env = BoxingMentalEnv(name, n_imagined=4)
            env.reset()
            env.step(points[k])
            alone = env.imagine(points.reshape(3, 4, 2)[k])
            assert all(np.array_equal(found[term][k], alone[term]) for term in alone)
        assert few["trajectory"].shape == (2, 50, 8)
        for env_ids in ([2, 0], [3], [0.5], [[0]], []):
            with pytest.raises(SettingsError, match="`env_ids` should be rising numbers"):
                envs.imagine(points[: len(env_ids)], env_ids)


@pytest.mark.parametrize("pb", [np.zeros(3), np.zeros((0, 2)), np.full(2, np.nan), np.zeros((1, 10, 2)), "left", None])
def test_what_is_no_pb_vector_is_named(pb):
    env = BoxingMentalEnv(n_imagined=5)
    env.reset()
    with pytest.raises(ShapeError, match=r"`pb` should be finite PB vectors of shape \(2,\) or \(n, 2\)"):
        env.imagine(pb)
    assert env.n_imagined_used == 0


@pytest.mark.parametrize("n_imagined", [-1, 2.5, "4", None])
def test_a_budget_is_a_whole_number(n_imagined):
    with pytest.raises(SettingsError, match="`n_imagined` should be"):
        BoxingMentalEnv(n_imagined=n_imagined)


def test_tracks_are_ordered_and_hide_what_they_do_not_hold():
    tracks = list(Track)
    assert sorted(tracks, key=str) != sorted(tracks) == tracks
    assert Track.OUTCOMES < "points" <= Track.POINTS < Track.MAP
    env = BoxingMentalEnv(n_imagined=1)
    env.reset()
    terms = env.imagine(np.zeros(2))

    for track in tracks:
        hidden = terms.keys() - track.visible(terms).keys()
        assert hidden == ({"trajectory", "basic_distances"} if track < Track.TRAJECTORIES else set())
    assert not Track.POINTS.visible({"imagined_trajectory": 0, "_trajectory": 0, "commanded": 0})
