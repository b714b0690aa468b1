"""The agents that need no training, on a small world: budget, space, seeds, what they read, missing packages."""

import random
import sys

import fake_boxing
import numpy as np
import pytest

from creative_nao.agents import (
    UNTRAINED,
    BayesianAgent,
    CmaEsAgent,
    CmaMeAgent,
    Context,
    MapElitesAgent,
    NoveltySearchAgent,
    OracleAgent,
    ReplayAgent,
    make_agent,
)
from creative_nao.agents.black_box import BayesianSettings, CmaEsSettings, OracleSettings, ReplaySettings
from creative_nao.agents.quality_diversity import (
    CmaMeSettings,
    MapElitesSettings,
    NoveltySearchSettings,
    arm_excursions,
    mean_postures,
)
from creative_nao.errors import MissingDependencyError, SettingsError
from creative_nao.evaluation.suites import check_agent

SEARCHES = ("cma_es", "cma_me", "map_elites", "novelty_search", "bayesian")
IMAGINING = ("imagine", "imagine_with_body", "plan", "plan_modulated", "plan_with_body", "plan_with_sense", "surrogate")
DRAWING = tuple(name for name in UNTRAINED if name not in ("oracle", *IMAGINING))


def play(agent, seed=0, n_actions=30, env=None):
    """Play an episode in the fake world; return the PB vectors (n, 2) and the rewards (n,)."""
    env = env or fake_boxing.FakeBoxing(physical=False)
    observation, _ = env.reset()
    agent.begin(Context(env.action_space, env.observation_space, n_actions, np.random.default_rng(seed), env.memory))
    chosen, rewards = [], []
    for _ in range(n_actions):
        pb = agent.ask(observation)
        observation, reward, _, _, info = env.step(pb)
        agent.tell(pb, observation, reward, info)
        chosen.append(pb)
        rewards.append(reward)
    return np.array(chosen), np.array(rewards)


def small(name):
    """Return the agent, the oracle with a small map."""
    return OracleAgent(OracleSettings(resolution=9)) if name == "oracle" else make_agent(name)


@pytest.fixture(scope="module")
def played():
    return {name: play(small(name)) for name in DRAWING}


@pytest.mark.parametrize("name", DRAWING)
def test_a_whole_episode_lies_inside_the_space(name, played):
    chosen, _ = played[name]
    assert chosen.shape == (30, 2)
    assert chosen.dtype == np.float32
    assert np.abs(chosen).max() <= 1.0


@pytest.mark.parametrize("name", DRAWING)
def test_one_seed_one_episode_whatever_the_global_generators_do(name, played):
    import torch

    random.seed(5)
    np.random.seed(5)  # noqa: NPY002 - the global generator is what must not matter
    torch.manual_seed(5)
    before = global_state()
    again, _ = play(make_agent(name))
    assert np.array_equal(again, played[name][0])
    assert global_state() == before
    assert not np.array_equal(play(make_agent(name), seed=1, n_actions=12)[0], again[:12])


def global_state():
    import torch

    return random.getstate(), np.random.get_state()[1].tolist(), torch.get_rng_state().tolist()  # noqa: NPY002


@pytest.mark.parametrize("name", DRAWING)
def test_a_second_episode_of_one_agent_remembers_nothing(name, played):
    agent = make_agent(name)
    play(agent, seed=7, n_actions=11)
    assert np.array_equal(play(agent, n_actions=30)[0][:12], played[name][0][:12])


@pytest.mark.parametrize("name", SEARCHES)
def test_a_search_heeds_what_it_is_told(name, played):
    """The same seed in another world: the first movements are the same, the later ones are not."""
    here, there = played[name][0], play(make_agent(name), env=Mirrored(physical=False))[0]
    assert np.array_equal(here[:4], there[:4])
    assert not np.array_equal(here, there)
    assert make_agent(name).learns_within_episode


class Mirrored(fake_boxing.FakeBoxing):
    """Movements are appropriate where they are not in the other world, and earn by another rule."""

    def step(self, action):
        observation, _, terminated, truncated, info = super().step(action)
        pb = np.asarray(action, np.float64)
        info = {**info, "appropriate": bool(pb[0] > 0.0), "trajectory": info["trajectory"] * (1.0 + pb[1])}
        return observation, float(pb[0] > 0.0) * (1.0 + pb[1]), terminated, truncated, info


@pytest.mark.parametrize(
    ("agent", "package", "extra"),
    [
        (CmaEsAgent, "cmaes", "search"),
        (CmaMeAgent, "ribs", "search"),
        (MapElitesAgent, "ribs", "search"),
        (NoveltySearchAgent, "ribs", "search"),
        (BayesianAgent, "optuna", "bayes"),
    ],
)
def test_a_missing_package_is_named_with_its_extra_when_the_agent_is_made(agent, package, extra, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    expected = rf'agent `{agent.name}` needs the package `{package}`: pip install "creative-nao\[{extra}\]"'
    with pytest.raises(MissingDependencyError, match=expected):
        agent()
    with pytest.raises(MissingDependencyError, match=expected):
        check_agent(agent.name)


def test_a_package_that_is_there_and_broken_is_named_when_it_is_loaded(monkeypatch):
    agent = MapElitesAgent()
    monkeypatch.delitem(sys.modules, "ribs", raising=False)
    monkeypatch.setitem(sys.modules, "ribs.archives", None)
    with pytest.raises(MissingDependencyError, match=r"`map_elites` needs the package `ribs`: .*\(import of ribs"):
        play(agent)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: ReplaySettings(spread=0.0), "`spread` should be above 0, but is 0.0"),
        (lambda: OracleSettings(resolution=1), "`resolution` should be at least 2, but is 1"),
        (lambda: CmaEsSettings(population_size=3), "`population_size` should be at least 4, but is 3"),
        (lambda: CmaMeSettings(sigma=-1.0), "`sigma` should be above 0, but is -1.0"),
        (lambda: MapElitesSettings(n_initial=0), "`n_initial` should be at least 1, but is 0"),
        (lambda: NoveltySearchSettings(threshold=-0.1), "`threshold` should be at least 0, but is -0.1"),
        (lambda: BayesianSettings(n_startup=0), "`n_startup` should be at least 1, but is 0"),
    ],
)
def test_a_search_setting_out_of_range_is_named(make, text):
    with pytest.raises(SettingsError, match=text):
        make()


def test_replay_begins_with_what_was_learned_and_stays_close(played):
    chosen, _ = played["replay"]
    learned = fake_boxing.FakeMemory("fake/0").pb
    assert np.array_equal(chosen[:3], learned.astype(np.float32))
    strayed = chosen[3:] - np.resize(learned, (27, 2))
    assert 0.0 < np.abs(strayed).max() < 0.5
    assert strayed.std() == pytest.approx(ReplaySettings().spread, rel=0.4)


def test_replay_without_a_memory_says_so(make_context):
    with pytest.raises(SettingsError, match=r"agent `replay` needs the learned PB points: the memory of the context"):
        ReplayAgent().begin(make_context())


def test_sobol_leaves_no_hole():
    """Of 64 points, each of the 8 x 8 cells holds one: the sequence is a net."""
    chosen, _ = play(make_agent("sobol"), n_actions=64)
    cells = np.minimum((chosen + 1.0) * 4.0, 7).astype(int)
    assert len(np.unique(cells, axis=0)) == 64


def test_map_elites_keeps_one_elite_a_cell():
    agent = MapElitesAgent()
    _, rewards = play(agent)
    assert 1 < len(agent.archive) <= 30
    assert agent.archive.stats.obj_max == pytest.approx(rewards.max())


def test_cma_es_moves_to_where_the_reward_is():
    """On a fixed target the last movements are nearer to it than the first."""

    class Target(fake_boxing.Target):
        memory = None

        def step(self, action):
            observation, reward, terminated, truncated, _ = super().step(action)
            return observation, reward, terminated, truncated, {"outcome": "learned"}

    for agent in (CmaEsAgent(), BayesianAgent()):
        chosen, _ = play(agent, env=Target())
        away = np.linalg.norm(chosen - np.array([0.5, -0.5]), axis=1)
        assert np.median(away[-10:]) < 0.5 * np.median(away[:10])


def test_one_pb_is_held_while_a_movement_unfolds(make_context):
    agent = CmaEsAgent()
    agent.begin(make_context())
    observation = np.zeros(4, np.float32)
    held = []
    for tick in (5, 10, 15):
        held.append(agent.ask(observation))
        agent.tell(held[-1], observation, 0.0, {"tick": tick})
    last = agent.ask(observation)
    agent.tell(last, observation, 1.0, {"tick": 20, "outcome": "unlearned"})
    assert all(np.array_equal(pb, last) for pb in held)
    assert not np.array_equal(agent.ask(observation), last)


def movement(n_joints=8, appropriate=True):
    trajectory = np.zeros((10, n_joints))
    trajectory[5:, 0] = 0.8
    trajectory[0, -1] = -0.4
    return {"trajectory": trajectory, "appropriate": appropriate}


def test_arm_excursions_tell_the_arms_apart():
    assert arm_excursions(movement()) == pytest.approx([0.2, 0.1])
    assert arm_excursions(movement(appropriate=False)).tolist() == [0.0, 0.0]
    assert arm_excursions({"trajectory": np.arange(3.0)[:, None], "appropriate": True}).tolist() == [2.0, 0.0]


def test_mean_postures_go_through_time():
    first, second = mean_postures(movement(), 2).reshape(2, 8)
    assert (first[0], second[0], first[-1]) == pytest.approx((0.0, 0.8, -0.08))
    assert mean_postures(movement(appropriate=False), 2).tolist() == [*[0.0] * 7, -0.4] * 2


def test_a_descriptor_without_its_term_says_which(make_context):
    agent = MapElitesAgent()
    agent.begin(make_context())
    pb = agent.ask(np.zeros(4, np.float32))
    with pytest.raises(SettingsError, match=r'a descriptor reads `info\["trajectory"\]`.*holds only: outcome'):
        agent.tell(pb, np.zeros(4, np.float32), 0.0, {"outcome": "learned"})
