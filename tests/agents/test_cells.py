"""Policies over the cells of the PB space: a proper density, the same eyes everywhere, and they learn."""

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box

from creative_nao.agents.cells import CellDistribution, CellFeatures, CellPolicy, CellSACPolicy, CellWeights, cells_at
from creative_nao.agents.settings import CELL_POLICY, CELL_SAC_POLICY, check_entry
from creative_nao.agents.training import TrainingPlan, train_agent
from creative_nao.envs.observation import N_CELLS, cells_of, layout, observation_space
from creative_nao.errors import SettingsError

SPACE = observation_space(layout())
ACTIONS = Box(-1.0, 1.0, (2,), np.float32)
CELLS = cells_of(SPACE, 2)
ENV = "CreativeNao/BoxingMental-v0"


def logits(*likely):
    found = torch.full((1, 64), -20.0)
    found[0, list(likely)] = 0.0
    return found


def test_points_fall_into_the_likely_cells_evenly():
    torch.manual_seed(0)
    drawn = torch.cat([CellDistribution(2).actions_from_params(logits(0, 10)) for _ in range(2000)])
    cells = cells_at(drawn)
    assert set(cells.tolist()) == {0, 10}
    inside = drawn[cells == 10]  # column 2 of row 1
    assert 0.45 < len(inside) / 2000 < 0.55
    assert inside.amin(dim=0) == pytest.approx([-0.5, -0.75], abs=0.01)
    assert inside.amax(dim=0) == pytest.approx([-0.25, -0.5], abs=0.01)
    assert inside.mean(dim=0) == pytest.approx([-0.375, -0.625], abs=0.01)


def test_the_density_integrates_to_one_and_gives_the_entropy():
    distribution = CellDistribution(2).proba_distribution(
        torch.randn(1, 64, generator=torch.Generator().manual_seed(1))
    )
    line = torch.arange(32) / 16.0 - 1.0 + 1.0 / 32.0
    points = torch.cartesian_prod(line, line)
    log_density = distribution.log_prob(points)
    area = 4.0 / len(points)
    assert float(log_density.exp().sum() * area) == pytest.approx(1.0, abs=1e-5)
    entropy = -float((log_density.exp() * log_density).sum() * area)
    assert float(distribution.entropy()) == pytest.approx(entropy, abs=1e-5)
    even = CellDistribution(2).proba_distribution(torch.zeros(1, 64))
    assert float(even.entropy()) == pytest.approx(np.log(4.0), abs=1e-6)


def test_the_likeliest_action_is_the_centre_of_the_likeliest_cell():
    assert CellDistribution(2).actions_from_params(logits(10), deterministic=True).tolist() == [[-0.375, -0.625]]


def test_what_is_seen_of_a_cell_is_what_the_observation_tells():
    observation = torch.zeros(1, 85)
    observation[0, :2] = torch.tensor([-0.3, -0.6])  # in cell 10
    observation[0, CELLS.start + 10], observation[0, CELLS.start + 63] = 0.4, -1.0
    told, others = CellFeatures(SPACE, 2)(observation)
    tried, vain, worth, last, first, second = (told[0, k].ravel() for k in range(6))
    assert tried.nonzero().ravel().tolist() == [10, 63]
    assert vain.nonzero().ravel().tolist() == [63]
    assert worth[10] == pytest.approx(0.4)
    assert last.nonzero().ravel().tolist() == [10]
    assert (first[10], second[10]) == (-0.375, -0.625)
    assert others.shape == (1, 85 - 2 - 64)


def test_a_neighbourhood_is_weighed_alike_wherever_it_is():
    torch.manual_seed(0)
    features = CellFeatures(SPACE, 2)
    weights = CellWeights(features, 8, 2)
    torch.nn.init.normal_(weights.weigh.weight)
    weights.hidden[0].weight.data[:, -4:] = 0.0  # but for where it is
    maps = []
    for shift in (0, 1 + N_CELLS):  # one cell on along both axes
        observation = torch.zeros(1, 85)
        observation[0, CELLS.start + 18 + shift] = 0.6
        observation[0, CELLS.start + 19 + shift] = -1.0
        maps.append(weights(*features(observation))[0].reshape(8, 8))
    assert torch.allclose(maps[0][2:5, 2:5], maps[1][3:6, 3:6], atol=1e-6)
    assert not torch.allclose(maps[0], maps[1], atol=1e-3)


def test_before_any_training_every_cell_is_as_likely():
    policy = CellPolicy(SPACE, ACTIONS, lambda _: 1e-3)
    distribution = policy.get_distribution(torch.rand(3, 85))
    assert torch.equal(distribution.categorical.probs, torch.full((3, 64), 1 / 64))


def test_critics_value_an_action_by_its_cell_and_a_policy_by_its_expectation():
    torch.manual_seed(0)
    policy = CellSACPolicy(SPACE, ACTIONS, lambda _: 1e-3, width=4)
    for net in (policy.actor.weights, *policy.critic.values):
        torch.nn.init.normal_(net.weigh.weight)
    observations = torch.rand(1, 85)
    centres = policy.actor.features.places[:2].flatten(1).T
    one_by_one = torch.cat([policy.critic(observations, centre[None])[0] for centre in centres])
    actions, log_density = policy.actor.action_log_prob(observations)
    probabilities = actions.cell_probabilities
    expected = (probabilities[0] * one_by_one[:, 0]).sum()
    assert torch.allclose(policy.critic(observations, actions)[0], expected, atol=1e-6)
    assert log_density.item() == pytest.approx((probabilities * (probabilities * 16.0).log()).sum().item(), abs=1e-5)
    bare = actions.detach().clone()
    assert torch.allclose(policy.critic(observations, bare)[0], one_by_one[cells_at(bare)], atol=1e-6)


@pytest.mark.parametrize(
    ("kwargs", "text"),
    [
        ({"width": 0}, "`width` should be at least 1, but is 0"),
        ({"n_layers": "two"}, "`n_layers` should be a whole number, but is 'two'"),
        ({"use_sde": True}, "`use_sde` should be false with Cell"),
    ],
)
@pytest.mark.parametrize("policy", [CellPolicy, CellSACPolicy])
def test_a_setting_out_of_range_is_named(policy, kwargs, text):
    with pytest.raises(SettingsError, match=text):
        policy(SPACE, ACTIONS, lambda _: 1e-3, **kwargs)


def test_memories_with_more_units_than_space_has_axes_are_refused():
    with pytest.raises(SettingsError, match="for memories with 1 to 3 PB units, but this one has 4"):
        CellFeatures(SPACE, 4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "entry"),
    [
        ("ppo", {"n_timesteps": 15360, "n_envs": 64, "n_steps": 30, "batch_size": 640, "n_epochs": 5,
                 "learning_rate": 0.003, "gamma": 0.0, "policy": CELL_POLICY}),
        ("sac", {"n_timesteps": 6000, "n_envs": 8, "learning_starts": 500, "learning_rate": 0.002, "gamma": 0.0,
                 "ent_coef": 0.05, "policy": CELL_SAC_POLICY}),
    ],
)  # fmt: skip
def test_on_one_memory_it_learns_within_seconds(algorithm, entry):
    """Random actions earn 10.6 on half/0; a policy of one normal distribution needs five times as long for 14."""
    chosen = check_entry(algorithm, entry, "test")
    plan = TrainingPlan(
        chosen, env=ENV, judged_env=ENV, memory="half/0", judged_memory="half/0", judged_seeds=tuple(range(5)),
        evaluation_interval=chosen.n_timesteps,
    )  # fmt: skip
    _, record = train_agent(plan)
    assert np.mean(record.evaluations[-1]) > 12.5
