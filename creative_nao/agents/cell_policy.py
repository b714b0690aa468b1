"""PPO's policy and value over the cells of the PB space; see `cells`."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import nn

from creative_nao.agents.cells import CellDistribution, CellFeatures, CellWeights, refuse_sde
from creative_nao.envs.observation import N_CELLS


class CellNetwork(nn.Module):
    """Weighs the cells, and reads the value of a situation from what is known of it as a whole.

    Args:
        features: Turns observations into maps.
        width: Channels of a hidden layer.
        n_layers: Hidden convolutions.
    """

    def __init__(self, features: CellFeatures, width: int, n_layers: int) -> None:
        super().__init__()
        self.features = features
        self.weights = CellWeights(features, width, n_layers)
        n_told, n_hidden = features.n_channels + features.n_others, 2 * width
        self.value = nn.Sequential(nn.Linear(n_told, n_hidden), nn.Tanh(), nn.Linear(n_hidden, n_hidden), nn.Tanh())
        self.latent_dim_pi, self.latent_dim_vf = N_CELLS**features.n_pb, n_hidden

    def forward(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return logits of the cells (n, N_CELLS ** n_pb) and what the value is read from (n, 2 * width)."""
        told, others = self.features(observations)
        return self.weights(told, others), self._valued(told, others)

    def forward_actor(self, observations: torch.Tensor) -> torch.Tensor:
        """Return logits of the cells, (n, N_CELLS ** n_pb)."""
        return self.weights(*self.features(observations))

    def forward_critic(self, observations: torch.Tensor) -> torch.Tensor:
        """Return what the value is read from, (n, 2 * width)."""
        return self._valued(*self.features(observations))

    def _valued(self, told: torch.Tensor, others: torch.Tensor) -> torch.Tensor:
        return self.value(torch.cat([told.flatten(2).mean(dim=2), others], dim=1))


class CellPolicy(ActorCriticPolicy):
    """Policy and value of PPO over the cells of the PB space; name it as `policy` in a file of hyperparameters.

    Args:
        observation_space: Space of this project's observations.
        action_space: Box(-1, 1, (n_pb,)).
        lr_schedule: Learning rate by what is left of the training.
        width: Channels of a hidden layer.
        n_layers: Hidden convolutions, each over a neighbourhood of three cells a side.
        use_sde: Has to be False: cells are drawn, no noise is added.

    Raises:
        SettingsError: If the observations hold no cells of the PB space, or a setting is out of range.
    """

    def __init__(
        self,
        observation_space: Box,
        action_space: Box,
        lr_schedule: Any,
        width: int = 16,
        n_layers: int = 2,
        use_sde: bool = False,
    ) -> None:
        refuse_sde(use_sde, "CellPolicy")
        self.width, self.n_layers = width, n_layers
        super().__init__(observation_space, action_space, lr_schedule, ortho_init=False)

    def _build(self, lr_schedule: Any) -> None:
        assert isinstance(self.action_space, Box)
        n_pb = int(np.prod(self.action_space.shape))
        assert isinstance(self.observation_space, Box)
        network = CellNetwork(CellFeatures(self.observation_space, n_pb), self.width, self.n_layers)
        self.mlp_extractor = network  # pyright: ignore[reportAttributeAccessIssue]
        self.action_dist = CellDistribution(n_pb)
        self.action_net = self.action_dist.proba_distribution_net()
        self.value_net = nn.Linear(network.latent_dim_vf, 1)
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)  # pyright: ignore[reportCallIssue]

    def _get_action_dist_from_latent(self, latent_pi: torch.Tensor) -> Distribution:
        return self.action_dist.proba_distribution(latent_pi)
