"""PPO from a learned map begins as the map itself, and its two losses are trained in turn."""

import gymnasium as gym
import numpy as np
import ppo_from_map
import pytest
import torch
from stable_baselines3.common.vec_env import DummyVecEnv

from creative_nao.agents.learned_map.network import AttentiveMap, expected
from creative_nao.agents.learned_map.training import Simulator, SupervisedMap
from creative_nao.agents.learned_map.truth import memory_truth
from creative_nao.model import load_memory


@pytest.mark.slow
def test_it_begins_as_the_map_and_learns_after_the_value_has():
    env = gym.make("CreativeNao/BoxingMental-v1", memory="half/0")
    torch.manual_seed(0)
    start = AttentiveMap(env.observation_space, env.action_space, width=8, n_heads=2, n_layers=1)
    policy = ppo_from_map.MapPolicy(env.observation_space, env.action_space, lambda _: 1e-3, start)
    observation = torch.as_tensor(env.reset(seed=0)[0])[None]
    points, rows = observation[:, :12].reshape(1, 6, 2), torch.zeros(1, 1, start.columns[-1].stop)
    places = policy.mlp_extractor.places[None]
    usable, far, _ = expected(start(points, rows, rows[..., 0], places))
    assert torch.allclose(
        policy.mlp_extractor(observation)[0], usable * far / policy.mlp_extractor.log_temperature.exp(), atol=1e-5
    )
    model = ppo_from_map.PPO(
        ppo_from_map.MapPolicy, DummyVecEnv([lambda: env]), n_steps=4, batch_size=4, n_epochs=1, device="cpu", seed=0,
        policy_kwargs={"start": start},
    )  # fmt: skip
    simulator = Simulator([memory_truth(load_memory("half/0"), n_points=64)], SupervisedMap(batch_size=4, n_queries=8))
    weights = [one.detach().clone() for one in start.parameters()]

    def moved():
        return any(
            not torch.equal(a, b) for a, b in zip(weights, model.policy.mlp_extractor.map.parameters(), strict=True)
        )

    model.learn(4, callback=ppo_from_map.Auxiliary(simulator, 2, 1, 0))
    assert not moved()
    model.learn(8, callback=ppo_from_map.Auxiliary(simulator, 2, 1, 0))
    assert moved()
    assert np.isfinite(model.policy.mlp_extractor.log_temperature.item())


@pytest.mark.slow
def test_where_the_pb_is_modulated_it_chooses_points_after_what_has_begun_and_holds_between():
    env = gym.make("CreativeNao/BoxingModulation-v1", memory="half/0")
    torch.manual_seed(0)
    start = AttentiveMap(
        env.observation_space, env.action_space, width=8, n_heads=2, n_layers=1, n_asked=16, n_segments=5
    )
    policy = ppo_from_map.MapPolicy(env.observation_space, env.action_space, lambda _: 1e-3, start)
    observation, _ = env.reset(seed=0)
    points = torch.from_numpy(start.candidates)
    begun, held = points.clone(), torch.empty(0)
    for decision in range(4):
        latent, _ = policy.mlp_extractor(torch.as_tensor(observation)[None])
        learned = torch.as_tensor(observation[:12]).reshape(1, 6, 2).repeat(1, 1, 5)
        rows = torch.zeros(1, 1, 1 + 10 + start.columns[-1].stop - start.columns[1].stop)
        usable, far, _ = expected(start(learned, rows, rows[..., 0], begun[None]))
        logits = usable * far / policy.mlp_extractor.log_temperature.exp()
        assert torch.allclose(latent[:, :16], logits, atol=1e-5)
        distribution = policy.get_distribution(torch.as_tensor(observation)[None])
        action = distribution.sample()
        if decision % 2:
            assert torch.equal(action, held)
            assert distribution.log_prob(action).item() == 0.0 == distribution.entropy().item()
        else:
            held = action
            place = decision // 2
            drawn = (points.unflatten(1, (5, 2))[:, place] == action).all(1).nonzero().item()
            assert np.isclose(distribution.log_prob(action).item(), logits.log_softmax(1)[0, drawn].item(), atol=1e-5)
            begun[:, 2 * place : 2 * place + 2] = action
        observation, *_ = env.step(action[0].detach().numpy())
    env.close()
