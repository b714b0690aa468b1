"""The interface of all agents: order, budget, seeds, and what may be chosen."""

import numpy as np
import pytest

from creative_nao.agents import Agent, AgentOrderError, AgentPolicy, PolicyAgent, make_agent
from creative_nao.errors import NotFoundError, SettingsError, ShapeError

OBSERVATION = np.zeros(4, np.float32)


def play(agent, context):
    agent.begin(context)
    chosen = []
    for _ in range(context.n_actions):
        chosen.append(agent.ask(OBSERVATION))
        agent.tell(chosen[-1], OBSERVATION, 0.0, {})
    return np.array(chosen)


@pytest.fixture(params=["supervised", "random", "sobol"])
def agent(request):
    """Agents that can be told nothing; test_searchers plays all of them in a world that tells."""
    return make_agent(request.param)


def test_ask_before_begin_says_so(agent):
    with pytest.raises(AgentOrderError, match=r"no episode has begun; call `begin\(context\)` first"):
        agent.ask(OBSERVATION)


def test_ask_twice_says_which_action_was_not_told(agent, make_context):
    agent.begin(make_context())
    agent.ask(OBSERVATION)
    with pytest.raises(AgentOrderError, match="`ask` was called twice; `tell` it first what action 1 earned"):
        agent.ask(OBSERVATION)


def test_tell_without_ask_says_so(agent, make_context):
    agent.begin(make_context())
    with pytest.raises(AgentOrderError, match=r"`tell` has no `ask` before it; call `ask\(observation\)` first"):
        agent.tell(np.zeros(2), OBSERVATION, 0.0, {})


def test_the_budget_is_an_end(agent, make_context):
    context = make_context(n_actions=3)
    play(agent, context)
    with pytest.raises(AgentOrderError, match="the budget of 3 generated actions is spent"):
        agent.ask(OBSERVATION)


def test_begin_starts_over(agent, make_context):
    first = play(agent, make_context(seed=1))
    assert np.array_equal(first, play(agent, make_context(seed=1)))


def test_the_seed_decides_the_choices(agent, make_context):
    one, same, other = (play(agent, make_context(seed=seed)) for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_choices_lie_inside_the_action_space(agent, make_context):
    context = make_context(n_actions=500)
    chosen = play(agent, context)
    assert chosen.dtype == np.float32
    assert all(context.action_space.contains(pb) for pb in chosen)


def test_an_agent_that_leaves_the_space_is_named_with_its_choice(make_context):
    class Wild(Agent):
        name = "wild"

        def choose(self, observation):
            return np.array([1.5, 0.0])

    agent = Wild()
    agent.begin(make_context())
    with pytest.raises(ShapeError, match=r"agent `wild` should choose a PB vector inside Box.* but chose \[1.5, 0.0\]"):
        agent.ask(OBSERVATION)


def test_supervised_draws_each_cell_of_the_grid_at_most_once(make_context):
    chosen = play(make_agent("supervised"), make_context(n_actions=20_000))
    axis = np.linspace(-1.0, 1.0, 200).astype(np.float32)
    assert np.isin(chosen, axis).all()
    assert len(np.unique(chosen, axis=0)) == 20_000


def test_supervised_covers_the_whole_grid_when_the_budget_allows(make_context):
    assert len(np.unique(play(make_agent("supervised"), make_context(n_actions=40_000)), axis=0)) == 40_000


def test_supervised_refuses_more_than_the_grid_holds(make_context):
    with pytest.raises(SettingsError, match=r"`n_actions` should be at most 40000.*but is 40001"):
        make_agent("supervised").begin(make_context(n_actions=40_001))


def test_random_is_not_on_the_grid(make_context):
    chosen = play(make_agent("random"), make_context(n_actions=100))
    assert not np.isin(chosen, np.linspace(-1.0, 1.0, 200).astype(np.float32)).all(axis=1).any()


def test_a_wrong_agent_name_brings_the_nearest():
    with pytest.raises(
        NotFoundError, match=r"no agent `supervized` \(did you mean `supervised`\?\); there are: supervised"
    ):
        make_agent("supervized")


def test_ppo_without_its_bundle_says_what_is_missing():
    with pytest.raises(SettingsError, match="agent `ppo` is trained first: `bundle` should be the path of its bundle"):
        make_agent("ppo")


class Centre:
    """Moves half way to the origin at each step; keeps the step in its state."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        state = 0 if episode_start is not None and episode_start[0] else state
        return np.full(2, 0.5**state, np.float32), state + 1


def test_a_policy_with_state_plays_as_an_agent(make_context):
    chosen = play(PolicyAgent(Centre()), make_context(n_actions=3))
    assert chosen[:, 0].tolist() == [1.0, 0.5, 0.25]


def test_an_agent_predicts_as_policies_do(make_context):
    policy = AgentPolicy(lambda: make_agent("random"), lambda: make_context(n_actions=2, seed=3))
    alone = play(make_agent("random"), make_context(n_actions=2, seed=3))
    predicted = [policy.predict(OBSERVATION, "state") for _ in range(4)]
    assert np.array_equal([action for action, _ in predicted], [*alone, *alone])  # a spent budget starts an episode
    assert predicted[0][1] == "state"


def test_a_batch_is_played_by_as_many_agents(make_context):
    seeds = iter(range(10))
    policy = AgentPolicy(lambda: make_agent("random"), lambda: make_context(seed=next(seeds)))
    batch = np.zeros((3, 4), np.float32)
    first, _ = policy.predict(batch, episode_start=np.array([True, True, True]))
    assert first.shape == (3, 2)
    again, _ = policy.predict(batch, episode_start=np.array([False, True, False]))
    expected = make_agent("random")
    expected.begin(make_context(seed=3))
    assert np.array_equal(again[1], expected.ask(OBSERVATION))
    assert not np.array_equal(again[0], first[0])


def test_an_agent_that_needs_rewards_cannot_be_a_policy(make_context):
    class Learner(type(make_agent("random"))):
        name = "learner"
        learns_within_episode = True

    with pytest.raises(SettingsError, match="agent `learner` learns from rewards within an episode"):
        AgentPolicy(Learner, make_context)
