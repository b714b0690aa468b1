"""SAC's actor and critics over the cells of the PB space; see `cells`.

The critics value every cell, so that the actor's loss and the targets need not draw one: they are expectations over all
cells, as in SAC for discrete actions. Nothing of the algorithm changes: the actor's actions carry their distribution,
and a critic that is given such actions returns the expected value.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box
from stable_baselines3.common.policies import BaseModel, BasePolicy
from stable_baselines3.sac.policies import SACPolicy
from torch import nn

from creative_nao.agents.cells import CellDistribution, CellFeatures, CellWeights, cells_at, refuse_sde

_CARRIED = "cell_probabilities"


class CellActor(BasePolicy):
    """Draws points of the PB space.

    Args:
        observation_space: Space of this project's observations.
        action_space: Box(-1, 1, (n_pb,)).
        width: Channels of a hidden layer.
        n_layers: Hidden convolutions.
    """

    def __init__(self, observation_space: Box, action_space: Box, width: int, n_layers: int) -> None:
        super().__init__(observation_space, action_space, squash_output=True)
        n_pb = int(np.prod(action_space.shape))
        self.features = CellFeatures(observation_space, n_pb)
        self.weights = CellWeights(self.features, width, n_layers)
        self.action_dist = CellDistribution(n_pb)

    def forward(self, obs: torch.Tensor, deterministic: bool = False) -> torch.Tensor:
        """Return points (n, n_pb) for observations (n, n_values)."""
        logits = self.weights(*self.features(obs))
        return self.action_dist.actions_from_params(logits, deterministic=deterministic)

    def action_log_prob(self, obs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return points (n, n_pb) that carry their distribution, and its expected log density (n,)."""
        distribution = self.action_dist.proba_distribution(self.weights(*self.features(obs)))
        actions = distribution.sample()
        setattr(actions, _CARRIED, distribution.categorical.probs)
        return actions, -distribution.entropy()

    def _predict(self, observation: torch.Tensor, deterministic: bool = False) -> torch.Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        return self(observation, deterministic)


class CellCritic(BaseModel):
    """Values every cell, with several networks.

    Args:
        observation_space: Space of this project's observations.
        action_space: Box(-1, 1, (n_pb,)).
        width: Channels of a hidden layer.
        n_layers: Hidden convolutions.
        n_critics: Networks.
    """

    def __init__(self, observation_space: Box, action_space: Box, width: int, n_layers: int, n_critics: int) -> None:
        super().__init__(observation_space, action_space)
        self.features = CellFeatures(observation_space, int(np.prod(action_space.shape)))
        self.values = nn.ModuleList(CellWeights(self.features, width, n_layers) for _ in range(n_critics))

    def forward(self, obs: torch.Tensor, actions: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """Return each network's values (n, 1): of the actions' cells, or of the distribution the actions carry."""
        told = self.features(obs)
        maps = [values(*told) for values in self.values]
        probabilities = getattr(actions, _CARRIED, None)
        if probabilities is not None:
            return tuple((probabilities * one).sum(dim=1, keepdim=True) for one in maps)
        cells = cells_at(actions)[:, None]
        return tuple(one.gather(1, cells) for one in maps)


class CellSACPolicy(SACPolicy):
    """Actor and critics of SAC over the cells of the PB space; name it as `policy` in a file of hyperparameters.

    Args:
        observation_space: Space of this project's observations.
        action_space: Box(-1, 1, (n_pb,)).
        lr_schedule: Learning rate by what is left of the training.
        width: Channels of a hidden layer.
        n_layers: Hidden convolutions, each over a neighbourhood of three cells a side.
        n_critics: Networks that value cells; the lowest counts.
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
        n_critics: int = 2,
        use_sde: bool = False,
    ) -> None:
        refuse_sde(use_sde, "CellSACPolicy")
        self.width, self.n_layers = width, n_layers
        super().__init__(observation_space, action_space, lr_schedule, n_critics=n_critics)

    def make_actor(self, features_extractor: Any = None) -> CellActor:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return an untrained actor."""
        return CellActor(*self._spaces, self.width, self.n_layers).to(self.device)

    def make_critic(self, features_extractor: Any = None) -> CellCritic:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return untrained critics."""
        n_critics = self.critic_kwargs["n_critics"]
        return CellCritic(*self._spaces, self.width, self.n_layers, n_critics).to(self.device)

    @property
    def _spaces(self) -> tuple[Box, Box]:
        assert isinstance(self.observation_space, Box)
        assert isinstance(self.action_space, Box)
        return self.observation_space, self.action_space
