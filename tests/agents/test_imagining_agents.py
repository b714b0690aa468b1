"""Two budgets and four tracks: agents imagine as much as they may, and are told what their track is told."""

import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from creative_nao.agents import Agent, AgentOrderError, FunctionAgent, RandomAgent, SpreadAgent, make_agent, rehearse
from creative_nao.agents.base import PolicyAgent
from creative_nao.agents.black_box import lattice_sides
from creative_nao.agents.play import make_env, play_episode
from creative_nao.agents.registry import UNTRAINED, split_name
from creative_nao.envs import Track
from creative_nao.errors import SettingsError

MODULATED = "CreativeNao/BoxingModulation-v0"
MENTAL, LATER = "CreativeNao/BoxingMental-v0", "CreativeNao/BoxingMental-v1"
N_ACTIONS = 6


def play(agent, env_id=MENTAL, memory="half/10", seed=0, n_actions=N_ACTIONS):
    """Play an episode; return its steps."""
    env = make_env(env_id, memory, agent, n_actions)
    try:
        return [*play_episode(agent, env, seed=seed, rng=np.random.default_rng(seed), n_actions=n_actions)]
    finally:
        env.close()


def total(steps):
    return sum(step.reward for step in steps)


class Curious(Agent):
    """Keeps its context and everything it is told; imagines what `plan` says before each movement."""

    name = "curious"
    imagines = True
    learns_within_episode = True

    def __init__(self, track="outcomes", plan=()):
        self.track, self.plan, self.told = track, plan, []

    def choose(self, observation):
        self.imagined = [self.context.imagine(pb) for pb in self.plan]
        return np.zeros(2)

    def learn(self, pb, observation, reward, info):
        self.told.append(info)


@pytest.mark.parametrize("track", list(Track))
def test_an_agent_is_told_what_its_track_is_told_and_nothing_else(track):
    agent = Curious(track, plan=[np.full(2, 0.3)])
    agent.n_candidates = 1
    env = gym.make(MENTAL, memory="half/10", n_imagined=2 * N_ACTIONS, n_actions=N_ACTIONS)
    steps = [*play_episode(agent, env, seed=0, rng=np.random.default_rng(0))]
    context = agent.context
    assert (context.points is not None) == (track >= Track.POINTS)
    assert (context.demonstrations is not None) == (track >= Track.TRAJECTORIES)
    assert (context.memory is not None) == (track >= Track.MAP)
    for info in (agent.told[-1], agent.imagined[-1][0]):
        assert ("trajectory" in info) == ("basic_distances" in info) == (track >= Track.TRAJECTORIES)
        assert {"outcome", "appropriate", "distance"} <= set(info)
        if track < Track.TRAJECTORIES:
            with pytest.raises(SettingsError, match="told from the track `trajectories` on"):
                info["trajectory"]
    assert steps[-1].n_imagined == N_ACTIONS


def test_what_is_imagined_is_counted_and_refused_beyond_the_budget():
    agent = Curious(plan=[np.zeros((3, 2))])
    agent.n_candidates = 1
    env = gym.make(MENTAL, memory="half/10", n_imagined=7, n_actions=N_ACTIONS)
    steps = play_episode(agent, env, seed=0, rng=np.random.default_rng(0))
    assert [next(steps).n_imagined, next(steps).n_imagined] == [3, 6]
    assert agent.context.n_imagined_left == 1
    with pytest.raises(AgentOrderError, match="3 more movements cannot be imagined: 6 of the budget of 7 are used"):
        next(steps)
    with pytest.raises(AgentOrderError, match="budget of 0"):
        play(Curious(plan=[np.zeros(2)]))


def test_an_imagined_movement_earns_what_it_earns_when_performed_and_changes_nothing():
    agent = rehearse(RandomAgent(), 4)
    steps = play(agent)
    again = play(agent)
    assert [step.reward for step in steps] == [step.reward for step in again]
    plain = gym.make(MENTAL, memory="half/10", n_actions=N_ACTIONS)
    plain.reset(seed=0)
    assert [plain.step(step.pb)[1] for step in steps] == [step.reward for step in steps]
    assert steps[-1].n_imagined == 4 * N_ACTIONS


def test_rehearsing_performs_the_farthest_of_its_proposals():
    class Recorded(RandomAgent):
        def look_ahead(self, observation, n):
            self.found = super().look_ahead(observation, n)
            return self.found

    inner = Recorded()
    env = gym.make(MENTAL, memory="half/10", n_imagined=5 * N_ACTIONS, n_actions=N_ACTIONS)
    for step in play_episode(rehearse(inner, 5), env, seed=0, rng=np.random.default_rng(0)):
        assert step.reward == max(info["reward"] for _, info in inner.found)
        assert len(inner.found) == 5


@pytest.mark.parametrize("name", ["random@8", "spread@8", "spread_points@8", "plan@8", "surrogate@8"])
def test_imagining_eight_earns_more_than_performing_at_once(name):
    """By a quarter at least, over two memories: the effect is several times that."""
    few = sum(total(play(make_agent("random"), memory=memory)) for memory in ("half/10", "open/10"))
    many = sum(total(play(make_agent(name), memory=memory)) for memory in ("half/10", "open/10"))
    assert many > 1.25 * few


@pytest.mark.parametrize("name", ["imagine", "plan@3", "surrogate@3", "spread_points@3", "random@3", "lattice@3"])
def test_one_seed_one_imagining_episode(name):
    first, again = play(make_agent(name), n_actions=4), play(make_agent(name), n_actions=4)
    assert np.array_equal([step.pb for step in first], [step.pb for step in again])
    other = play(make_agent(name), seed=1, n_actions=4)
    assert not np.array_equal([step.pb for step in first], [step.pb for step in other])
    assert first[-1].n_imagined == 4 * make_agent(name).n_candidates


@pytest.mark.parametrize("name", sorted(set(UNTRAINED) - {"bayesian", "cma_me", "map_elites", "novelty_search"}))
def test_at_k_1_nothing_is_imagined(name):
    env_id = MODULATED if name == "plan_modulated" else MENTAL
    agent = make_agent(f"{name}@1" if name not in ("imagine_with_body", "oracle") else "random@1")
    steps = play(agent, env_id)
    assert steps[-1].n_imagined == 0
    assert total(steps) > 0.0


@pytest.mark.slow
def test_imagining_with_the_body_loses_no_movement():
    """closed/12 is a memory on which the body refuses novel movements."""
    agent, names = "imagine_with_body@16", ("CreativeNao/Boxing-v0", "closed/12")
    steps = play(make_agent(agent), *names, n_actions=5)
    assert all(step.info["appropriate"] for step in steps)
    assert 5 * 9 <= steps[-1].n_imagined <= 5 * 16


def test_the_surrogate_of_the_tutorial_finds_more_than_random_points():
    """By a fifth, on a memory where the effect is half; `test_docs.py` runs the tutorial's commands."""
    sys.path.insert(0, str(Path(__file__).parents[2]))
    from examples.my_surrogate import MySurrogate

    few, many = (
        sum(total(play(agent, memory="half/11", seed=seed, n_actions=30)) for seed in range(3))
        for agent in (make_agent("random"), MySurrogate())
    )
    assert many > 1.2 * few


def test_a_name_tells_how_many_movements_are_looked_at():
    assert split_name("spread@8") == ("spread", 8)
    assert split_name("ppo/BoxingMental-v0@64") == ("ppo/BoxingMental-v0", 64)
    for name in ("spread", "spread@", "spread@0", "spread@x", "spread@1234567"):
        assert split_name(name) == (name, None)
    assert rehearse(rehearse(SpreadAgent(), 2), 8).name == "spread@8"
    with pytest.raises(SettingsError, match="n_candidates"):
        rehearse(SpreadAgent(), 0)


def test_observations_that_tell_more_than_the_track_are_refused():
    env = gym.make(LATER, memory="half/10", n_actions=2)
    play_it = {"seed": 0, "rng": np.random.default_rng(0)}
    with pytest.raises(SettingsError, match="is of the track `outcomes`, but these observations tell `trajectories`"):
        next(play_episode(RandomAgent(), env, **play_it))
    next(play_episode(FunctionAgent(lambda _: np.zeros(2), track="trajectories"), env, **play_it))
    assert make_env(LATER, "half/10", RandomAgent()).observation_space != env.observation_space
    with pytest.raises(SettingsError, match="`track` should be one of outcomes, points, trajectories, map"):
        PolicyAgent(env, track="everything") if hasattr(env, "predict") else FunctionAgent(print, track="everything")


@pytest.mark.parametrize(("n_points", "n_axes", "sides"), [(30, 2, [6, 5]), (100, 2, [10, 10]), (30, 8, [2] * 8)])
def test_the_lattice_has_room_for_the_budget_with_sides_that_differ_by_one(n_points, n_axes, sides):
    found = lattice_sides(n_points, n_axes).tolist()
    assert found == sides or (n_axes == 8 and np.prod(found) >= n_points)
    assert np.prod(found) >= n_points
    assert max(found) - min(found) <= 1


def test_a_movement_of_five_pb_vectors_is_imagined_as_it_is_performed():
    """Each is held for two of ten decisions, and the movement performed is the one imagined, to the bit."""
    agent, imagined = make_agent("plan_modulated@4"), []
    keep = agent.learn_imagined
    agent.learn_imagined = lambda pb, info: (imagined.append((pb, info)), keep(pb, info))
    steps = play(agent, MODULATED, n_actions=3)
    chosen = np.array([step.pb for step in steps]).reshape(3, 10, 2)
    assert np.array_equal(chosen[:, ::2], chosen[:, 1::2])
    assert len(np.unique(chosen[0], axis=0)) == 5
    assert steps[-1].n_imagined == 12
    found = {np.asarray(pb, np.float32).tobytes(): info for pb, info in imagined}
    for path, step in zip(chosen[:, ::2].astype(np.float32), steps[9::10], strict=True):
        assert np.array_equal(found[path.tobytes()]["trajectory"], step.info["trajectory"])


def test_several_pb_vectors_need_an_environment_that_takes_them():
    with pytest.raises(SettingsError, match="5 PB vectors, but decisions of a movement here: 1"):
        play(make_agent("plan_modulated"))
