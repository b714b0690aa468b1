"""An argument of a wrong kind is named by an error of the project, and an agent is told in a line."""

import numpy as np
import pytest

from creative_nao.agents import (
    Agent,
    AgentPolicy,
    CmaEsAgent,
    FunctionAgent,
    MapElitesAgent,
    PolicyAgent,
    RandomAgent,
    load_agent,
    load_entry_point,
    make_agent,
    save_bundle,
    train_ppo,
)
from creative_nao.agents.play import evaluate_agent, play_episode
from creative_nao.errors import SettingsError, ShapeError

ENV = "CreativeNao/BoxingMental-v0"


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: make_agent(5), "`name` should be text, but is 5"),
        (lambda: load_agent(None), "a bundle should be a shipped name or a path, but is None"),
        (lambda: load_entry_point(3), "is named `package.module:factory`, but this is `3`"),
        (lambda: RandomAgent().begin(3), "`context` should be of the class Context, but is 3"),
        (lambda: evaluate_agent(RandomAgent(), 5, ["half/0"], [0]), "`env_id` should be text, but is 5"),
        (lambda: evaluate_agent(RandomAgent(), ENV, "half/0", [0]), "`memories` should be a list, but is 'half/0'"),
        (lambda: evaluate_agent(RandomAgent(), ENV, ["half/0"], ["a"]), "`seeds`, entry 1 should be a whole number"),
        (lambda: next(play_episode(3, None, seed=0, rng=None)), "`agent` should be of the class Agent, but is 3"),
        (lambda: train_ppo(ENV, settings=None, seed=0), "`settings` should be of the class PPOSettings, but is None"),
        (lambda: CmaEsAgent("wide"), "`settings` should be of the class CmaEsSettings, but is 'wide'"),
        (lambda: MapElitesAgent(3), "`settings` should be of the class MapElitesSettings, but is 3"),
        (lambda: AgentPolicy(3, 3), "`make_agent` should be a `Callable`, but is 3"),
        (lambda: FunctionAgent(3), "`function` should be a `Callable`, but is 3"),
        (lambda: PolicyAgent(3), "`policy` should have a method `predict`, but is 3"),
        (lambda: save_bundle("x", 3, None), "`header` should be of the class BundleHeader, but is 3"),
    ],
)
def test_an_argument_of_a_wrong_kind_is_named(call, text):
    with pytest.raises(SettingsError, match=text):
        call()


def test_a_choice_that_is_no_vector_is_named(make_context):
    class Speaker(Agent):
        name = "speaker"

        def choose(self, observation):
            return "left"

    agent = Speaker()
    agent.begin(make_context())
    with pytest.raises(ShapeError, match=r"agent `speaker` should choose a PB vector inside .* but chose 'left'"):
        agent.ask(np.zeros(4, np.float32))


def test_an_agent_is_told_in_a_line():
    assert repr(RandomAgent()) == "RandomAgent() named `random`"
    assert repr(CmaEsAgent()) == "CmaEsAgent(CmaEsSettings(population_size=10, sigma=0.8)) named `cma_es`"
