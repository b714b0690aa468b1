"""SAC over tries: in rehearsal each cell has a value with a commit and one without."""

import gymnasium as gym
import numpy as np
import pytest
import sac_over_tries
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.vec_env import DummyVecEnv


@pytest.mark.slow
@pytest.mark.parametrize(("name", "n_values"), [("BoxingMental-v1", 64), ("BoxingRehearsal-v0", 128)])
def test_it_values_cells_and_in_rehearsal_commits(name, n_values):
    env = gym.make(f"CreativeNao/{name}", memory="half/0")
    model = SAC(
        sac_over_tries.TrySACPolicy, DummyVecEnv([lambda: env]), buffer_size=50, learning_starts=8, batch_size=4,
        seed=0, device="cpu", policy_kwargs={"width": 8, "n_layers": 1},
    )  # fmt: skip
    model.learn(16)
    observations, actor, critic = torch.as_tensor(env.reset(seed=0)[0])[None], model.actor, model.critic
    logits = actor.weights(*actor.features(observations))
    assert logits.shape == (1, n_values)
    drawn = actor.action_dist.proba_distribution(logits.expand(2000, -1)).sample()
    assert drawn.shape == (2000, env.action_space.shape[0])
    assert torch.all(drawn.abs() <= 1.0)
    values = critic.values[0](*critic.features(observations))
    place = 9  # second cell of the second row
    action = torch.tensor([[-0.7, -0.7, -1.0][: drawn.shape[1]]])
    assert torch.equal(critic(observations, action)[0][0, 0], values[0, place])
    if n_values == 128:
        assert set(drawn[:, 2].tolist()) == {-1.0, 1.0}
        action[0, 2] = 1.0
        assert torch.equal(critic(observations, action)[0][0, 0], values[0, 64 + place])
    actions, _ = actor.action_log_prob(observations)
    mean = (logits.softmax(1) * values).sum()
    assert np.isclose(critic(observations, actions)[0].item(), mean.item(), atol=1e-5)
