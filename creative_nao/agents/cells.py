"""Policies of PPO and SAC over the cells of the PB space.

The usual policy, a normal distribution around one point, cannot say "any cell that is still empty" or "beside one of
the two good ones". Here every cell of the coverage map gets a probability from a small convolutional network over its
neighbourhood, and a point is drawn uniformly within the cell. What the network learns about a neighbourhood in one
place holds in every place, and on every memory.

Names of modules (`weights`, `weigh`, `others`) are names of weights in bundles.
"""

from __future__ import annotations

import itertools
from typing import Any, cast

import numpy as np
import torch
from gymnasium.spaces import Box
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.policies import ActorCriticPolicy, BaseModel, BasePolicy
from stable_baselines3.sac.policies import SACPolicy
from torch import nn
from torch.distributions import Bernoulli, Categorical

from creative_nao.envs.observation import N_CELLS, cells_of
from creative_nao.errors import SettingsError
from creative_nao.schema import Count, checked

_CONVOLUTIONS: dict[int, Any] = {1: nn.Conv1d, 2: nn.Conv2d, 3: nn.Conv3d}


class CellDistribution(Distribution):
    """Draws a cell of [-1, 1]^n_pb, then a point of it, each with the same density.

    Args:
        n_pb: PB units; there are `resolution` ** `n_pb` cells, the first unit's index runs fastest.
        resolution: Cells along an axis.
        commits: Whether one more value of an action, -1 or 1, is drawn: the commit of a rehearsal.
    """

    def __init__(self, n_pb: int, resolution: int = N_CELLS, commits: bool = False) -> None:
        super().__init__()
        self.n_pb, self.resolution, self.commits = n_pb, resolution, commits
        self._strides = torch.tensor([resolution**unit for unit in range(n_pb)])
        self._density = n_pb * float(np.log(resolution / 2.0))  # of a point within its cell, as a logarithm

    def proba_distribution_net(self, *args: Any, **kwargs: Any) -> nn.Module:
        """Return the network from latent values to logits: none is needed."""
        return nn.Identity()

    def proba_distribution(self, logits: torch.Tensor) -> CellDistribution:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Take the logits of all cells, shape (n, resolution ** n_pb), and behind them that of a commit."""
        n_cells = self.resolution**self.n_pb
        self.categorical = Categorical(logits=logits[:, :n_cells])
        self.bernoulli = Bernoulli(logits=logits[:, n_cells]) if self.commits else None
        return self

    def _corner(self, cells: torch.Tensor) -> torch.Tensor:
        """Return the lowest corner of cells (n,) in [-1, 1], shape (n, n_pb)."""
        places = cells[:, None] // self._strides % self.resolution
        return places.float() * (2.0 / self.resolution) - 1.0

    def _with_commit(self, points: torch.Tensor, commit: torch.Tensor | None) -> torch.Tensor:
        return points if commit is None else torch.cat([points, commit[:, None].float() * 2.0 - 1.0], dim=1)

    def log_prob(self, actions: torch.Tensor) -> torch.Tensor:
        """Return the logarithm of the density at points (n, n_pb), shape (n,)."""
        found = self.categorical.log_prob(cells_at(actions[:, : self.n_pb], self.resolution)) + self._density
        return found if self.bernoulli is None else found + self.bernoulli.log_prob((actions[:, -1] > 0.0).float())

    def entropy(self) -> torch.Tensor:
        """Return the differential entropy, shape (n,)."""
        found = self.categorical.entropy() - self._density
        return found if self.bernoulli is None else found + self.bernoulli.entropy()

    def sample(self) -> torch.Tensor:
        """Draw points, shape (n, n_pb)."""
        corner = self._corner(self.categorical.sample())
        points = corner + (2.0 / self.resolution) * torch.rand_like(corner)
        return self._with_commit(points, None if self.bernoulli is None else self.bernoulli.sample())

    def mode(self) -> torch.Tensor:
        """Return the centres of the likeliest cells, shape (n, n_pb)."""
        centres = self._corner(self.categorical.logits.argmax(dim=1)) + 1.0 / self.resolution
        return self._with_commit(centres, None if self.bernoulli is None else self.bernoulli.logits > 0.0)

    def actions_from_params(self, logits: torch.Tensor, deterministic: bool = False) -> torch.Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return points of the distribution with these logits, shape (n, n_pb)."""
        return self.proba_distribution(logits).get_actions(deterministic=deterministic)

    def log_prob_from_params(self, logits: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return drawn points (n, n_pb) and the logarithm of the density there (n,)."""
        actions = self.actions_from_params(logits)
        return actions, self.log_prob(actions)


def refuse_sde(use_sde: bool, policy: str) -> None:
    """Refuse Stable-Baselines3's state-dependent exploration: cells are drawn, no noise is added."""
    if use_sde:
        raise SettingsError(f"`use_sde` should be false with {policy}: it draws cells and adds no noise")


def cells_at(points: torch.Tensor, resolution: int = N_CELLS) -> torch.Tensor:
    """Return the cells in which points of [-1, 1]^n_pb lie, shape (n,), for points (n, n_pb)."""
    places = ((points + 1.0) * (resolution / 2.0)).long().clamp(0, resolution - 1)
    return (places * resolution ** torch.arange(points.shape[1])).sum(dim=1)


class CellFeatures(nn.Module):
    """Turns observations into a map over the cells, and what is not about a place.

    Channels of a cell: tried, tried in vain, worth of the best found, the last action was here, its coordinates and
    their absolute values.

    Args:
        space: Space of the observations.
        n_pb: PB units.
    """

    places: torch.Tensor

    def __init__(self, space: Box, n_pb: int) -> None:
        super().__init__()
        if n_pb not in _CONVOLUTIONS:
            raise SettingsError(f"a policy over cells is for memories with 1 to 3 PB units, but this one has {n_pb}")
        self._cells, self.n_pb = cells_of(space, n_pb), n_pb
        self._shape = (N_CELLS,) * n_pb
        line = (torch.arange(N_CELLS) + 0.5) * (2.0 / N_CELLS) - 1.0
        axes = torch.meshgrid(*[line] * n_pb, indexing="ij")[::-1]  # the first unit's index runs fastest
        self.register_buffer("places", torch.stack([*axes, *(axis.abs() for axis in axes)]), persistent=False)
        self.n_channels = 4 + 2 * n_pb
        self.n_others = int(np.prod(space.shape)) - n_pb - N_CELLS**n_pb

    def forward(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the map (n, n_channels, N_CELLS, ...) and the other values (n, n_others)."""
        cells = observations[:, self._cells]
        tried = (cells != 0.0).float()
        last = cells_at(observations[:, : self.n_pb])[:, None] == torch.arange(cells.shape[1])
        maps = torch.stack([tried, (cells < 0.0).float(), cells.clamp(min=0.0), last.float() * tried], dim=1)
        places = self.places.expand(len(cells), *self.places.shape)
        others = torch.cat([observations[:, self.n_pb : self._cells.start], observations[:, self._cells.stop :]], dim=1)
        return torch.cat([maps.unflatten(2, self._shape), places], dim=1), others


class CellWeights(nn.Module):
    """Scores every cell by convolutions over its neighbourhood and by the rest of what is observed.

    Args:
        features: Turns observations into maps.
        width: Channels of a hidden layer.
        n_layers: Hidden convolutions, each over a neighbourhood of three cells a side.

    Raises:
        SettingsError: If a size is below 1.
    """

    def __init__(self, features: CellFeatures, width: int, n_layers: int) -> None:
        super().__init__()
        for name, value in (("width", width), ("n_layers", n_layers)):
            checked(Count, value, name)
        convolution = _CONVOLUTIONS[features.n_pb]
        sizes = [features.n_channels, *[width] * n_layers]
        self.hidden = nn.ModuleList(convolution(n_in, n_out, 3, padding=1) for n_in, n_out in itertools.pairwise(sizes))
        self.others = nn.Linear(features.n_others, width)
        self.weigh = convolution(width, 1, 1)
        nn.init.zeros_(self.weigh.weight)  # every cell is as good as another before any training
        nn.init.zeros_(self.weigh.bias)

    def forward(self, maps: torch.Tensor, others: torch.Tensor) -> torch.Tensor:
        """Return a score for each cell, (n, N_CELLS ** n_pb), from what `CellFeatures` returns."""
        everywhere = self.others(others)[(..., *[None] * (maps.ndim - 2))]
        for place, layer in enumerate(self.hidden):
            maps = torch.relu(layer(maps) + everywhere) if place == 0 else torch.relu(layer(maps))
        return self.weigh(maps).flatten(1)


class CellNetwork(nn.Module):
    """Scores the cells for the policy, and computes features of the value from the maps as a whole."""

    def __init__(self, features: CellFeatures, width: int, n_layers: int) -> None:
        super().__init__()
        self.features = features
        self.weights = CellWeights(features, width, n_layers)
        n_inputs, n_hidden = features.n_channels + features.n_others, 2 * width
        self.value = nn.Sequential(nn.Linear(n_inputs, n_hidden), nn.Tanh(), nn.Linear(n_hidden, n_hidden), nn.Tanh())
        self.latent_dim_pi, self.latent_dim_vf = N_CELLS**features.n_pb, n_hidden

    def forward(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return logits of the cells (n, N_CELLS ** n_pb) and what the value is read from (n, 2 * width)."""
        maps, others = self.features(observations)
        return self.weights(maps, others), self._valued(maps, others)

    def forward_actor(self, observations: torch.Tensor) -> torch.Tensor:
        """Return logits of the cells, (n, N_CELLS ** n_pb)."""
        return self.weights(*self.features(observations))

    def forward_critic(self, observations: torch.Tensor) -> torch.Tensor:
        """Return what the value is read from, (n, 2 * width)."""
        return self._valued(*self.features(observations))

    def _valued(self, maps: torch.Tensor, others: torch.Tensor) -> torch.Tensor:
        return self.value(torch.cat([maps.flatten(2).mean(dim=2), others], dim=1))


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
        self, observation_space: Box, action_space: Box, lr_schedule: Any, width: int = 16, n_layers: int = 2,
        use_sde: bool = False,
    ) -> None:  # fmt: skip
        refuse_sde(use_sde, "CellPolicy")
        self.width, self.n_layers = width, n_layers
        super().__init__(observation_space, action_space, lr_schedule, ortho_init=False)

    def _build(self, lr_schedule: Any) -> None:
        network, self.action_dist = self.make_network(cast("Box", self.observation_space), self.action_space)
        self.mlp_extractor = network  # pyright: ignore[reportAttributeAccessIssue]
        self.action_net = self.action_dist.proba_distribution_net()
        self.value_net = nn.Linear(network.latent_dim_vf, 1)
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)  # pyright: ignore[reportCallIssue]

    def make_network(self, space: Box, actions: Any) -> tuple[Any, CellDistribution]:
        """Return the network from observations to logits and value features, and the distribution of the logits."""
        n_pb = int(np.prod(actions.shape))
        return CellNetwork(CellFeatures(space, n_pb), self.width, self.n_layers), CellDistribution(n_pb)

    def _get_action_dist_from_latent(self, latent_pi: torch.Tensor) -> Distribution:
        return self.action_dist.proba_distribution(latent_pi)


CARRIED = "cell_probabilities"


class CellActor(BasePolicy):
    """Draws points of the PB space; arguments as of `CellSACPolicy`."""

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
        setattr(actions, CARRIED, distribution.categorical.probs)
        return actions, -distribution.entropy()

    def _predict(self, observation: torch.Tensor, deterministic: bool = False) -> torch.Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        return self(observation, deterministic)


class CellCritic(BaseModel):
    """Values every cell, with several networks; arguments as of `CellSACPolicy`."""

    def __init__(self, observation_space: Box, action_space: Box, width: int, n_layers: int, n_critics: int) -> None:
        super().__init__(observation_space, action_space)
        self.features = CellFeatures(observation_space, int(np.prod(action_space.shape)))
        self.values = nn.ModuleList(CellWeights(self.features, width, n_layers) for _ in range(n_critics))

    def forward(self, obs: torch.Tensor, actions: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """Return each network's values (n, 1): of the actions' cells, or of the distribution the actions carry."""
        inputs = self.features(obs)
        maps = [values(*inputs) for values in self.values]
        probabilities = getattr(actions, CARRIED, None)
        if probabilities is not None:
            return tuple((probabilities * one).sum(dim=1, keepdim=True) for one in maps)
        cells = cells_at(actions)[:, None]
        return tuple(one.gather(1, cells) for one in maps)


class CellSACPolicy(SACPolicy):
    """Actor and critics of SAC over the cells of the PB space; name it as `policy` in a file of hyperparameters.

    Arguments and errors are those of `CellPolicy`; of `n_critics` networks that value cells the lowest counts.
    """

    def __init__(
        self, observation_space: Box, action_space: Box, lr_schedule: Any, width: int = 16, n_layers: int = 2,
        n_critics: int = 2, use_sde: bool = False,
    ) -> None:  # fmt: skip
        refuse_sde(use_sde, "CellSACPolicy")
        self.width, self.n_layers = width, n_layers
        super().__init__(observation_space, action_space, lr_schedule, n_critics=n_critics)

    def make_actor(self, features_extractor: Any = None) -> CellActor:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return an untrained actor."""
        spaces = cast("tuple[Box, Box]", (self.observation_space, self.action_space))
        return CellActor(*spaces, self.width, self.n_layers).to(self.device)

    def make_critic(self, features_extractor: Any = None) -> CellCritic:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return untrained critics."""
        spaces = cast("tuple[Box, Box]", (self.observation_space, self.action_space))
        return CellCritic(*spaces, self.width, self.n_layers, self.critic_kwargs["n_critics"]).to(self.device)
