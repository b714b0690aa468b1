"""Policies of PPO and SAC over the cells of the PB space, and data augmentation by the symmetries of its axes.

The usual policy, a normal distribution around one point, cannot say "any cell that is still empty" or "beside one of
the two good ones". Here every cell of the coverage map gets a probability from a small convolutional network over its
neighbourhood, and a point is drawn uniformly within the cell. What the network learns about a neighbourhood in one
place holds in every place, and on every memory.

What a PB unit's sign means, and which unit is the first, is an accident of a memory's training. With augmentation each
training episode flips and swaps the axes by one of 2^n_pb n_pb! symmetries, actions and observations alike, so that
the agent meets a consistent world. Only training does this: agents are evaluated on the memories as they are.

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
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.sac.policies import SACPolicy
from torch import nn
from torch.distributions import Categorical

from creative_nao.envs.observation import N_CELLS, cells_of
from creative_nao.envs.state import generator_from, generator_state
from creative_nao.errors import SettingsError
from creative_nao.schema import Count, checked

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
    """Refuse Stable-Baselines3's state-dependent exploration: cells are drawn, no noise is added."""
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


_CARRIED = "cell_probabilities"


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
        setattr(actions, _CARRIED, distribution.categorical.probs)
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
        probabilities = getattr(actions, _CARRIED, None)
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


class FlippedSwappedAxes(VecEnvWrapper):
    """Draws a symmetry of the PB axes for every episode of each sub-environment.

    The agent's PB vector a becomes the environment's b with b[i] = signs[i] * a[order[i]]; `pb` and `cells` of its
    observations are transformed back. `info` stays the environment's.

    Args:
        venv: A vector environment of this project.

    Attributes:
        symmetry: Index of each sub-environment's symmetry, shape (num_envs,); 0 is the identity.

    Raises:
        SettingsError: If observations hold no cells of the PB space.
    """

    def __init__(self, venv: VecEnv) -> None:
        super().__init__(venv)
        if not isinstance(venv.observation_space, Box) or not isinstance(venv.action_space, Box):
            raise SettingsError(f"`venv` should have Box spaces, but has {venv.observation_space}")
        self._n_pb = int(np.prod(venv.action_space.shape))
        table = symmetries(self._n_pb)
        self._orders = np.array([order for order, _ in table])
        self._signs = np.array([signs for _, signs in table], np.float32)
        self._cells = cells_of(venv.observation_space, self._n_pb)
        self._cell_tables = np.array([_cell_table(order, signs) for order, signs in table])
        self._random = np.random.default_rng(0)
        self.symmetry = np.zeros(self.num_envs, np.int64)

    @property
    def n_symmetries(self) -> int:
        """Symmetries of the axes: 8 with two PB units."""
        return len(self._orders)

    def seed(self, seed: int | None = None) -> Any:
        """Seed the environments and the draw of symmetries."""
        self._random = np.random.default_rng(None if seed is None else [seed, self.n_symmetries])
        return super().seed(seed)

    def reset(self) -> np.ndarray:
        """Begin all episodes, each with a symmetry of its own."""
        observations = self.venv.reset()
        self.symmetry = self._random.integers(self.n_symmetries, size=self.num_envs)
        return self.to_agent(np.asarray(observations), self.symmetry)

    def step_async(self, actions: np.ndarray) -> None:
        """Take the agent's PB vectors, shape (num_envs, n_pb)."""
        self.venv.step_async(self.to_env(actions, self.symmetry))

    def step_wait(self) -> Any:
        """Step; a sub-environment whose episode has ended gets another symmetry for its next one."""
        stepped: Any = self.venv.step_wait()
        observations, rewards, dones, infos = stepped
        ended = np.flatnonzero(dones)
        for k in ended:
            last = self.to_agent(infos[k]["terminal_observation"][None], self.symmetry[k : k + 1])[0]
            infos[k] = {**infos[k], "terminal_observation": last}
        if len(ended):
            self.symmetry = self.symmetry.copy()
            self.symmetry[ended] = self._random.integers(self.n_symmetries, size=len(ended))
        return self.to_agent(observations, self.symmetry), rewards, dones, infos

    def to_env(self, pb: np.ndarray, symmetry: np.ndarray) -> np.ndarray:
        """Return the environment's PB vectors for the agent's, both (n, n_pb); symmetry: (n,)."""
        return self._signs[symmetry] * np.take_along_axis(pb, self._orders[symmetry], axis=1)

    def to_agent(self, observations: np.ndarray, symmetry: np.ndarray) -> np.ndarray:
        """Return the agent's observations for the environment's, both (n, n_values); symmetry: (n,)."""
        mapped = observations.copy()
        pb = self._signs[symmetry] * observations[:, : self._n_pb]
        np.put_along_axis(mapped, self._orders[symmetry], pb, axis=1)
        mapped[:, self._cells] = np.take_along_axis(observations[:, self._cells], self._cell_tables[symmetry], axis=1)
        return mapped

    def get_state(self) -> tuple[dict[str, Any], np.ndarray]:
        """Return the generator's state as plain values, and each sub-environment's symmetry."""
        values = generator_state(self._random)
        assert values is not None
        return values, self.symmetry.copy()

    def set_state(self, values: dict[str, Any], symmetry: np.ndarray) -> None:
        """Take over what `get_state` returned.

        Raises:
            SettingsError: If it is no such state.
        """
        rng, symmetry = generator_from(values), np.array(symmetry, dtype=np.int64)
        in_range = ((symmetry >= 0) & (symmetry < self.n_symmetries)).all()
        if rng is None or symmetry.shape != (self.num_envs,) or not in_range:
            raise SettingsError(f"`symmetry` should hold {self.num_envs} numbers from 0 to {self.n_symmetries - 1}")
        self._random, self.symmetry = rng, symmetry


def symmetries(n_pb: int) -> tuple[tuple[tuple[int, ...], tuple[float, ...]], ...]:
    """Return every way to swap and flip `n_pb` axes as (order, signs); the first is the identity.

    Example:
        >>> len(symmetries(2)), symmetries(2)[0]
        (8, ((0, 1), (1.0, 1.0)))
    """
    swaps = itertools.permutations(range(n_pb))
    return tuple(itertools.product(swaps, itertools.product((1.0, -1.0), repeat=n_pb)))


def _cell_table(order: tuple[int, ...], signs: tuple[float, ...]) -> np.ndarray:
    """Return, for each of the agent's cells, the index of the environment's cell it is."""
    n_pb = len(order)
    strides = N_CELLS ** np.arange(n_pb)
    agents = np.arange(N_CELLS**n_pb)[:, None] // strides % N_CELLS
    environments = agents[:, order]
    environments = np.where(np.array(signs) > 0.0, environments, N_CELLS - 1 - environments)
    return environments @ strides
