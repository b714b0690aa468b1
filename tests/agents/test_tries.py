"""Policies over every try: attention by distance, untried rows unseen, commits, and what they refuse."""

import gymnasium as gym
import numpy as np
import pytest
import torch

from creative_nao.agents import PolicyAgent, TryPolicy, rehearse
from creative_nao.agents.cells import CellDistribution, cells_at
from creative_nao.agents.play import play_episode, told_track
from creative_nao.agents.settings import AUGMENTATION, TRY_POLICY, check_entry
from creative_nao.agents.training import TrainingPlan, train_agent
from creative_nao.agents.tries import TryFeatures, TryWeights
from creative_nao.envs import Track
from creative_nao.envs.observation import layout, observation_space, tries_of, try_columns
from creative_nao.errors import SettingsError

MENTAL, REHEARSAL = "CreativeNao/BoxingMental-v1", "CreativeNao/BoxingRehearsal-v0"


def space(n_rows=5, **sizes):
    return observation_space(layout(n_rows=n_rows, **sizes), try_columns(**sizes))


def drawn(space, n_tried, n=3, seed=0):
    """Observations with some tries, the rest of the rows empty."""
    parts, columns = tries_of(space)
    space.seed(seed)
    found = np.stack([space.sample() for _ in range(n)])
    tries = next(part for part in parts if part.name == "tries")
    rows = found[:, tries.start : tries.stop].reshape(n, -1, columns[-1].stop)
    rows[:, n_tried:], rows[:, :n_tried, 0] = 0.0, 1.0
    found[:, tries.start : tries.stop] = rows.reshape(n, -1)
    return torch.as_tensor(found)


@pytest.mark.parametrize("rehearsal", [False, True])
@pytest.mark.parametrize("n_pb", [1, 2, 4, 8])
@pytest.mark.parametrize("track", [Track.OUTCOMES, Track.POINTS, Track.TRAJECTORIES])
def test_the_layout_follows_from_the_bounds_of_the_space(track, n_pb, rehearsal):
    sizes = {"n_pb": n_pb, "track": track, "rehearsal": rehearsal}
    parts, columns = tries_of(space(n_rows=7, **sizes))
    assert parts == layout(n_rows=7, **sizes)
    assert [(one.name, one.start, one.stop) for one in columns] == [
        (one.name, one.start, one.stop) for one in try_columns(**sizes)
    ]


@pytest.mark.parametrize("other", [observation_space(layout()), space(n_rows=1), space(n_decisions=10), "a space"])
def test_other_observations_are_refused(other):
    with pytest.raises(SettingsError, match="`observation_space` should tell at least two tries of one PB vector each"):
        tries_of(other)


@pytest.mark.parametrize("n_pb", [1, 2, 3])
def test_cells_attend_by_distance_and_by_what_came_out(n_pb):
    torch.manual_seed(0)
    features = TryFeatures(space(n_pb=n_pb), 4)
    weights = TryWeights(features, 8, 1)
    seen = []
    weights.gathered.register_forward_pre_hook(lambda module, arguments: seen.append(arguments[0]))
    tokens, pb, mask, others = features(drawn(space(n_pb=n_pb), 3))
    weights(tokens, pb, mask, others)
    embedded = weights.embed(tokens)
    squared = ((features.places[:, None] - pb[:, None]) ** 2).sum(dim=3)
    scores = weights.matter(embedded).mT[:, :, None] - weights.reach.exp()[:, None, None] * squared[:, None]
    scores = torch.cat([scores, weights.nothing.view(1, -1, 1, 1).expand(3, -1, 4**n_pb, 1)], dim=3)
    values = weights.values(embedded).view(3, 9, 4, -1).transpose(1, 2)
    expected = (scores.softmax(dim=3)[..., :-1] @ values).transpose(1, 2).flatten(2)
    assert mask.sum(dim=1).tolist() == [9, 9, 9]  # six learned points and three tries
    assert torch.allclose(seen[0][..., : expected.shape[2]], expected, atol=1e-6)


def test_rows_without_a_try_and_other_observations_of_a_batch_change_nothing():
    torch.manual_seed(0)
    features = TryFeatures(space(), 4)
    weights = TryWeights(features, 8, 2)
    torch.nn.init.normal_(weights.weigh.weight)
    few, many = drawn(space(), 2), drawn(space(), 5)
    together, _ = weights(*features(torch.cat([few, many])))
    assert torch.allclose(together[:3], weights(*features(few))[0], atol=1e-6)
    assert torch.allclose(together[3:], weights(*features(many))[0], atol=1e-6)
    assert together.std(dim=1).min() > 0.01  # and there is something to see


def test_a_commit_is_drawn_beside_the_point():
    logits = torch.tensor([[0.0, 5.0, 0.0, 0.0, np.log(3.0)]]).expand(4000, 5)
    torch.manual_seed(0)
    distribution = CellDistribution(2, resolution=2, commits=True).proba_distribution(logits)
    actions = distribution.sample()
    assert float((actions[:, 2] > 0).float().mean()) == pytest.approx(0.75, abs=0.03)
    expected = distribution.categorical.logits[0, cells_at(actions[:, :2], 2)]  # a cell has the area 1
    expected = expected + torch.where(actions[:, 2] > 0, np.log(0.75), np.log(0.25))
    assert torch.allclose(distribution.log_prob(actions), expected, atol=1e-5)
    assert distribution.mode()[0].tolist() == [0.5, -0.5, 1.0]


def test_before_training_every_point_is_as_likely_and_one_in_eight_is_committed():
    env = gym.make(REHEARSAL, n_imagined=6, n_actions=2, memory="half/0")
    policy = TryPolicy(env.observation_space, env.action_space, lambda _: 1e-3, width=8, resolution=4)
    found = policy.get_distribution(drawn(env.observation_space, 3))
    assert torch.equal(found.categorical.probs, torch.full((3, 16), 1 / 16))
    assert found.bernoulli.probs.tolist() == pytest.approx([0.12] * 3, abs=0.01)
    agent = PolicyAgent(policy, deterministic=False, track=told_track(REHEARSAL, {}))
    steps = [*play_episode(agent, env, seed=0, rng=np.random.default_rng(0))]
    assert len(steps) == steps[-1].n_imagined <= 6


def test_a_policy_that_imagines_draws_all_but_its_first_proposal():
    env = gym.make(MENTAL, memory="half/0", n_imagined=120)
    policy = TryPolicy(env.observation_space, env.action_space, lambda _: 1e-3, width=8, resolution=4)
    agent = rehearse(PolicyAgent(policy, deterministic=True, track=Track.TRAJECTORIES), 4)
    proposed, imagine = [], env.unwrapped.imagine
    env.unwrapped.imagine = lambda pb: (proposed.append(pb[0].tobytes()), imagine(pb))[1]
    next(play_episode(agent, env, seed=0, rng=np.random.default_rng(0)))
    assert len(set(proposed)) == len(proposed) == 4
    assert agent.agent.deterministic


def test_what_an_environment_tells_follows_from_its_name_and_settings():
    assert told_track(MENTAL, {}) == told_track(REHEARSAL, {}) == Track.TRAJECTORIES
    assert told_track(MENTAL, {"observation": "points"}) == Track.POINTS
    assert told_track("CreativeNao/BoxingMental-v0", {}) == told_track("no.module:Own-v0", {}) == Track.OUTCOMES


def test_a_grid_beyond_reason_is_refused():
    env = gym.make(MENTAL, memory="half-4pb/0")
    with pytest.raises(SettingsError, match=r"`resolution` 16 makes 16\^4 cells for 4 PB units, expected at most 4096"):
        TryPolicy(env.observation_space, env.action_space, lambda _: 1e-3)


def test_it_trains_with_flipped_axes_and_is_judged_on_what_it_saw():
    entry = {"vec_env_wrapper": AUGMENTATION, "policy": TRY_POLICY, "policy_kwargs": {"width": 8, "resolution": 4}}
    chosen = check_entry("ppo", {**entry, "n_timesteps": 24, "n_envs": 4, "n_steps": 3, "batch_size": 6}, "test")
    plan = TrainingPlan(chosen, MENTAL, MENTAL, memory="half/0", judged_memory="half/10", judged_seeds=(0,))
    policy, record = train_agent(plan)
    assert len(record.evaluations) == 2
    agent = PolicyAgent(policy, track=Track.TRAJECTORIES)
    with pytest.raises(SettingsError, match=r"was trained with observations of shape \(583,\), but these .* \(70,\)"):
        next(play_episode(agent, gym.make(MENTAL, n_actions=3), seed=0, rng=np.random.default_rng(0)))


@pytest.mark.slow
def test_on_one_memory_it_learns_within_seconds():
    """Random actions earn 10.6 on half/0."""
    chosen = check_entry(
        "ppo",
        {"n_timesteps": 15360, "n_envs": 64, "n_steps": 30, "batch_size": 240, "n_epochs": 3, "learning_rate": 0.003,
         "gamma": 0.9, "policy": TRY_POLICY},
        "test",
    )  # fmt: skip
    plan = TrainingPlan(chosen, MENTAL, MENTAL, memory="half/0", judged_memory="half/0", judged_seeds=tuple(range(8)))
    _, record = train_agent(plan)
    assert record.best_mean > 14.0
