"""A distribution over the cells of the PB space that observations tell about, and a network that weighs every cell.

The usual policy, a normal distribution around one point, cannot say "any cell that is still empty" or "beside one of
the two good ones". Here every cell of the coverage map gets a probability, by a small convolutional network that weighs
each by its surroundings, and a point is drawn uniformly within the cell. What the network learns about a neighbourhood
in one place it knows in every place, and on every memory.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box
from stable_baselines3.common.distributions import Distribution
from torch import nn
from torch.distributions import Categorical

from creative_nao.envs.observation import N_CELLS, cells_of
from creative_nao.errors import SettingsError

_CONVOLUTIONS: dict[int, Any] = {1: nn.Conv1d, 2: nn.Conv2d, 3: nn.Conv3d}


class CellDistribution(Distribution):
    """Draws a cell of [-1, 1]^n_pb, then a point of it, each with the same density.

    Args:
        n_pb: PB units; there are `N_CELLS` ** `n_pb` cells, the first unit's index runs fastest.
    """

    def __init__(self, n_pb: int) -> None:
        super().__init__()
        self.n_pb = n_pb
        self._strides = torch.tensor([N_CELLS**unit for unit in range(n_pb)])
        self._density = n_pb * float(np.log(N_CELLS / 2.0))  # of a point within its cell, as a logarithm

    def proba_distribution_net(self, *args: Any, **kwargs: Any) -> nn.Module:
        """Return the network from latent values to logits: none is needed."""
        return nn.Identity()

    def proba_distribution(self, logits: torch.Tensor) -> CellDistribution:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Take the logits of all cells, shape (n, N_CELLS ** n_pb)."""
        self.categorical = Categorical(logits=logits)
        return self

    def _corner(self, cells: torch.Tensor) -> torch.Tensor:
        """Return the lowest corner of cells (n,) in [-1, 1], shape (n, n_pb)."""
        places = cells[:, None] // self._strides % N_CELLS
        return places.float() * (2.0 / N_CELLS) - 1.0

    def log_prob(self, actions: torch.Tensor) -> torch.Tensor:
        """Return the logarithm of the density at points (n, n_pb), shape (n,)."""
        return self.categorical.log_prob(cells_at(actions)) + self._density

    def entropy(self) -> torch.Tensor:
        """Return the differential entropy, shape (n,)."""
        return self.categorical.entropy() - self._density

    def sample(self) -> torch.Tensor:
        """Draw points, shape (n, n_pb)."""
        corner = self._corner(self.categorical.sample())
        return corner + (2.0 / N_CELLS) * torch.rand_like(corner)

    def mode(self) -> torch.Tensor:
        """Return the centres of the likeliest cells, shape (n, n_pb)."""
        return self._corner(self.categorical.logits.argmax(dim=1)) + 1.0 / N_CELLS

    def actions_from_params(self, logits: torch.Tensor, deterministic: bool = False) -> torch.Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return points of the distribution with these logits, shape (n, n_pb)."""
        return self.proba_distribution(logits).get_actions(deterministic=deterministic)

    def log_prob_from_params(self, logits: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return drawn points (n, n_pb) and the logarithm of the density there (n,)."""
        actions = self.actions_from_params(logits)
        return actions, self.log_prob(actions)


def refuse_sde(use_sde: bool, policy: str) -> None:
    """Refuse Stable-Baselines3's state-dependent exploration: cells are drawn, no noise is added.

    Raises:
        SettingsError: If it is asked for.
    """
    if use_sde:
        raise SettingsError(f"`use_sde` should be false with {policy}: it draws cells and adds no noise")


def cells_at(points: torch.Tensor) -> torch.Tensor:
    """Return the cells in which points of [-1, 1]^n_pb lie, shape (n,), for points (n, n_pb)."""
    places = ((points + 1.0) * (N_CELLS / 2.0)).long().clamp(0, N_CELLS - 1)
    return (places * N_CELLS ** torch.arange(points.shape[1])).sum(dim=1)


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
        told = torch.stack([tried, (cells < 0.0).float(), cells.clamp(min=0.0), last.float() * tried], dim=1)
        places = self.places.expand(len(cells), *self.places.shape)
        others = torch.cat([observations[:, self.n_pb : self._cells.start], observations[:, self._cells.stop :]], dim=1)
        return torch.cat([told.unflatten(2, self._shape), places], dim=1), others


class CellWeights(nn.Module):
    """Weighs every cell by its surroundings and by the rest of what is observed.

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
            if not isinstance(value, int) or value < 1:
                raise SettingsError(f"`{name}` should be a whole number of at least 1, but is {value!r}")
        convolution = _CONVOLUTIONS[features.n_pb]
        sizes = [features.n_channels, *[width] * n_layers]
        self.hidden = nn.ModuleList(convolution(n_in, n_out, 3, padding=1) for n_in, n_out in itertools.pairwise(sizes))
        self.others = nn.Linear(features.n_others, width)
        self.weigh = convolution(width, 1, 1)
        nn.init.zeros_(self.weigh.weight)  # every cell is as good as another before any training
        nn.init.zeros_(self.weigh.bias)

    def forward(self, told: torch.Tensor, others: torch.Tensor) -> torch.Tensor:
        """Return a weight for each cell, (n, N_CELLS ** n_pb), from what `CellFeatures` returns."""
        everywhere = self.others(others)[(..., *[None] * (told.ndim - 2))]
        for place, layer in enumerate(self.hidden):
            told = torch.relu(layer(told) + everywhere) if place == 0 else torch.relu(layer(told))
        return self.weigh(told).flatten(1)
