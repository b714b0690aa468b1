"""The oracle is the ceiling: it earns what the greedy selection over the map says, and nobody earns more."""

import gymnasium as gym
import numpy as np
import pytest

import creative_nao as cn
from creative_nao.agents import UNTRAINED, Agent, Context, OracleAgent, make_agent
from creative_nao.agents.black_box import OracleSettings
from creative_nao.errors import SettingsError
from creative_nao.evaluation.job_handlers import score_map
from creative_nao.evaluation.protocol import play

MENTAL = "CreativeNao/BoxingMental-v0"
RESOLUTION = 60


@pytest.fixture(scope="module")
def env():
    made = gym.make(MENTAL, memory="half/10")
    yield made
    made.close()


@pytest.fixture(scope="module")
def oracle(env):
    return play(OracleAgent(OracleSettings(RESOLUTION)), env, env_id=MENTAL, memory="half/10", seed=0)


def test_the_environment_pays_the_oracle_what_the_map_promises(oracle, tmp_path):
    memory = {"name": "half/10", "file": None}
    spec = {"env": MENTAL, "memory": memory, "resolution": RESOLUTION, "n_actions": 30, "chart": "map.npz"}
    spec["oracle"] = "found"
    charted = score_map(spec, tmp_path, lambda _: None)
    assert [action.reward for action in oracle.actions] == pytest.approx(charted["oracle_rewards"], abs=1e-5)
    assert [list(action.pb) for action in oracle.actions] == pytest.approx(np.array(charted["oracle_pb"]), abs=1e-7)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            name, marks=pytest.mark.slow if name in ("cma_me", "map_elites", "novelty_search", "bayesian") else ()
        )
        for name in UNTRAINED
        if name not in ("oracle", "imagine", "imagine_with_body", "plan_modulated")  # they need imagining or modulation
    ],
)
def test_no_agent_earns_more_than_the_oracle(name, env, oracle):
    """Measured, over an episode. That no first choice earns more than the oracle's is a theorem on its own grid."""
    episode = play(make_agent(name), env, env_id=MENTAL, memory="half/10", seed=0)
    assert 0.0 < episode.reward < oracle.reward


def test_no_first_choice_on_the_grid_earns_more_than_the_oracle_s(env, oracle):
    class OneOfTheGrid(Agent):
        name = "one_of_the_grid"

        def choose(self, observation):
            axis = np.linspace(-1.0, 1.0, RESOLUTION)
            return self.context.rng.choice(axis, 2)

    firsts = [
        play(OneOfTheGrid(), env, env_id=MENTAL, memory="half/10", seed=seed).actions[0].reward for seed in range(20)
    ]
    assert 0.0 < max(firsts) <= oracle.actions[0].reward + 1e-5


def test_every_seed_of_the_oracle_gives_the_same_choices(env, oracle):
    other = play(OracleAgent(OracleSettings(RESOLUTION)), env, env_id=MENTAL, memory="half/10", seed=1)
    assert other.actions == oracle.actions


def begin(agent, env, memory, n_actions=30):
    agent.begin(Context(env.action_space, env.observation_space, n_actions, np.random.default_rng(0), memory))
    zeros = np.zeros(env.observation_space.shape, np.float32)
    chosen = []
    for _ in range(n_actions):
        chosen.append(agent.ask(zeros))
        agent.tell(chosen[-1], zeros, 0.0, {})
    return np.array(chosen)


def test_a_longer_plan_begins_with_the_shorter_one(env):
    memory = env.unwrapped.memory
    at_once = begin(OracleAgent(OracleSettings(20, n_planned=12)), env, memory, 12)
    in_parts = begin(OracleAgent(OracleSettings(20, n_planned=5)), env, memory, 12)
    assert np.array_equal(at_once, in_parts)
    assert len(np.unique(at_once, axis=0)) == 12


def test_another_memory_gets_another_plan(env):
    agent = OracleAgent(OracleSettings(20, n_planned=3))
    plans = [begin(agent, env, memory, 3) for memory in (env.unwrapped.memory, cn.load_memory("open/10"))]
    assert not np.array_equal(*plans)


def test_when_nothing_is_left_the_last_choice_is_repeated(env):
    chosen = begin(OracleAgent(OracleSettings(2, n_planned=3)), env, env.unwrapped.memory, 9)
    assert 1 <= len(np.unique(chosen, axis=0)) <= 4


def test_the_oracle_without_a_memory_that_generates_says_so(env):
    with pytest.raises(SettingsError, match=r"agent `oracle` maps the memory first: .* but is NoneType"):
        begin(OracleAgent(), env, None)
