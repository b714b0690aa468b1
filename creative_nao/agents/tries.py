"""PPO's policy over every try of an episode, for the observations of -v1 and of rehearsal.

Tries and learned PB points are a set. Each cell of a grid over the PB space attends to them: the closer in PB space the
more, within reaches that are learned, and by what came out there. What each head gathers scores the cell, and a point
is drawn within the cell chosen. Because attention weighs by distance alone, what is learned holds wherever the points
lie, on every memory. In rehearsal the commit is drawn beside it.

Names of modules are names of weights in bundles.
"""

from __future__ import annotations

from typing import Any

import torch
from gymnasium.spaces import Box
from torch import nn

from creative_nao.agents.cells import CellDistribution, CellPolicy
from creative_nao.envs.observation import split, tries_of
from creative_nao.errors import SettingsError
from creative_nao.measures.outcome import APPROPRIATE
from creative_nao.schema import Count, checked

MAX_GRID = 4096
"""Most cells of a grid."""
N_HEADS = 4


class TryFeatures(nn.Module):
    """Turns observations into tokens of what is known of points, their places, and what is not about a place.

    Args:
        space: Space of the observations.
        resolution: Cells along an axis of the PB space.
    """

    places: torch.Tensor
    line: torch.Tensor

    def __init__(self, space: Box, resolution: int) -> None:
        super().__init__()
        self._parts, self._columns = tries_of(space)
        self._at = {column.name: slice(column.start, column.stop) for column in self._columns}
        self.n_pb = self._columns[1].size
        self.rehearsal = "performed" in self._at
        if checked(Count, resolution, "resolution") ** self.n_pb > MAX_GRID:
            raise SettingsError(
                f"`resolution` {resolution} makes {resolution}^{self.n_pb} cells for {self.n_pb} PB units, expected at "
                f"most {MAX_GRID}"
            )
        line = (torch.arange(resolution) + 0.5) * (2.0 / resolution) - 1.0
        self.register_buffer("line", line, persistent=False)
        axes = torch.meshgrid(*[line] * self.n_pb, indexing="ij")[::-1]  # the first unit's index runs fastest
        self.register_buffer("places", torch.stack([axis.flatten() for axis in axes], dim=1), persistent=False)
        self.n_known = self._columns[-1].stop - self.n_pb + 3
        self.n_others = sum(part.size for part in self._parts if part.name not in ("points", "tries"))
        self.n_others += 4 if self.rehearsal else 0

    def forward(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return tokens (n, m, n_known), their points (n, m, n_pb), mask (n, m), and the rest (n, n_others)."""
        found: Any = split(observations, self._parts, self._columns)  # pyright: ignore[reportArgumentType]
        n_tried = found["tries"][..., 0].sum(dim=1)
        tries = found["tries"][:, : max(int(n_tried.max()), 1)]
        tried = tries[..., 0]
        start = self._at["outcome"].start
        usable = tries[..., start : start + len(APPROPRIATE)].sum(dim=2)
        age = (n_tried[:, None] - torch.arange(tries.shape[1])) / found["tries"].shape[1]
        known = torch.cat([tries[..., :1], tries[..., start:], torch.stack([usable, age * tried], dim=2)], dim=2)
        pb, mask = tries[..., self._at["pb"]], tried > 0.0
        tokens = torch.cat([known, torch.zeros_like(tried)[..., None]], dim=2)
        if "points" in found:
            points = found["points"].unflatten(1, (-1, self.n_pb))
            learned = torch.zeros(*points.shape[:2], self.n_known)
            learned[..., -1] = 1.0
            tokens, pb = torch.cat([learned, tokens], dim=1), torch.cat([points, pb], dim=1)
            mask = torch.cat([torch.ones(points.shape[:2], dtype=torch.bool), mask], dim=1)
        others = [found[part.name] for part in self._parts if part.name not in ("points", "tries")]
        if self.rehearsal:
            others += [self._waiting(tries, found)]
        return tokens, pb, mask, torch.cat(others, dim=1)

    def _waiting(self, tries: torch.Tensor, found: Any) -> torch.Tensor:
        """Return what a commit weighs, (n, 4): worth of the candidate, of the last and best imagined, and its share."""
        reward, candidate = tries[..., self._at["reward"]][..., 0], tries[..., self._at["candidate"]][..., 0]
        worth = (reward * candidate).sum(dim=1)
        left = (1.0 - found["imagined"]) / (1.0 - found["step"]).clamp(min=1e-2) / 2.0
        mean = reward.sum(dim=1) / tries[..., 0].sum(dim=1).clamp(min=1.0)
        return torch.stack([worth, candidate.sum(dim=1), mean, left[:, 0].clamp(max=2.0)], dim=1)


class TryWeights(nn.Module):
    """Scores every cell by attention to what is known, near and far.

    Args:
        features: Turns observations into tokens.
        width: Units of a hidden layer.
        n_layers: Hidden layers of the score.

    Raises:
        SettingsError: If a size is below 1.
    """

    line: torch.Tensor
    where: torch.Tensor

    def __init__(self, features: TryFeatures, width: int, n_layers: int) -> None:
        super().__init__()
        for name, value in (("width", width), ("n_layers", n_layers)):
            checked(Count, value, name)
        n_values = max(width // N_HEADS, 1)
        self.embed = nn.Sequential(nn.Linear(features.n_known, width), nn.ReLU())
        self.values = nn.Linear(width, N_HEADS * n_values)
        self.matter = nn.Linear(width, N_HEADS)  # how much a token matters to a head wherever it is
        self.reach = nn.Parameter(torch.linspace(1.0, 5.5, N_HEADS))  # of exp(-exp(reach) d^2): d of 0.6 to 0.06
        self.nothing = nn.Parameter(torch.full((N_HEADS,), -1.0))  # what a head attends to far from everything
        n_inputs = N_HEADS * n_values + 2 * features.n_pb
        self.others = nn.Linear(width + features.n_others, width)
        layers: list[nn.Module] = [nn.ReLU()]
        for _ in range(n_layers - 1):
            layers += [nn.Linear(width, width), nn.ReLU()]
        self.gathered, self.hidden = nn.Linear(n_inputs, width), nn.Sequential(*layers)
        self.weigh = nn.Linear(width, 1)
        nn.init.zeros_(self.weigh.weight)  # every cell is as good as another before any training
        nn.init.zeros_(self.weigh.bias)
        self.register_buffer("line", features.line, persistent=False)
        self.register_buffer("where", torch.cat([features.places, features.places.abs()], dim=1), persistent=False)

    def forward(
        self, tokens: torch.Tensor, pb: torch.Tensor, mask: torch.Tensor, others: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return a score for each cell (n, n_cells), and a summary of what is known, (n, width + n_others)."""
        embedded = self.embed(tokens)
        n, m, _ = tokens.shape
        matter = self.matter(embedded).clamp(-8.0, 8.0).masked_fill(~mask[..., None], -1e9).exp()  # (n, m, heads)
        values = self.values(embedded).view(n, m, N_HEADS, -1)
        values = torch.cat([values, torch.ones_like(values[..., :1])], dim=3) * matter[..., None]
        gathered = values.transpose(1, 2)  # (n, heads, m, n_values + 1), the last sums the weights
        # exp(-b d^2) is a product over axes, so that a grid needs no distance of every cell to every token.
        near = torch.exp(-self.reach.exp()[:, None, None, None] * (self.line[:, None, None] - pb[:, None, None]) ** 2)
        for unit in range(pb.shape[2] - 1):
            gathered = near[..., unit].mT[..., None] * gathered.flatten(3)[..., None, :]
        gathered = (near[..., -1] @ gathered.flatten(3)).view(n, N_HEADS, -1, values.shape[3])
        gathered = gathered[..., :-1] / (gathered[..., -1:] + self.nothing.exp()[:, None, None])
        gathered = gathered.transpose(1, 2).flatten(2)  # (n, n_cells, heads * n_values)
        known = mask[..., None].float()
        summary = torch.cat([(embedded * known).sum(dim=1) / known.sum(dim=1).clamp(min=1.0), others], dim=1)
        where = self.where.expand(n, *self.where.shape)
        hidden = self.gathered(torch.cat([gathered, where], dim=2)) + self.others(summary)[:, None]
        return self.weigh(self.hidden(hidden))[..., 0], summary


class TryNetwork(nn.Module):
    """Scores the cells for the policy, in rehearsal the commit too, and computes features of the value."""

    def __init__(self, features: TryFeatures, width: int, n_layers: int) -> None:
        super().__init__()
        self.features = features
        self.weights = TryWeights(features, width, n_layers)
        n_inputs, n_hidden = width + features.n_others, 2 * width
        self.value = nn.Sequential(nn.Linear(n_inputs, n_hidden), nn.Tanh(), nn.Linear(n_hidden, n_hidden), nn.Tanh())
        self.commit = None
        if features.rehearsal:
            last = nn.Linear(n_hidden, 1)
            self.commit = nn.Sequential(nn.Linear(n_inputs, n_hidden), nn.Tanh(), last)
            nn.init.zeros_(last.weight)
            nn.init.constant_(last.bias, -2.0)  # about one in eight
        self.latent_dim_pi, self.latent_dim_vf = len(features.places) + features.rehearsal, n_hidden

    def forward(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return logits of the cells, and of the commit, (n, latent_dim_pi), and what the value is read from."""
        logits, summary = self.weights(*self.features(observations))
        if self.commit is not None:
            logits = torch.cat([logits, self.commit(summary)], dim=1)
        return logits, self.value(summary)

    def forward_actor(self, observations: torch.Tensor) -> torch.Tensor:
        """Return logits, (n, latent_dim_pi)."""
        return self(observations)[0]

    def forward_critic(self, observations: torch.Tensor) -> torch.Tensor:
        """Return what the value is read from, (n, 2 * width)."""
        return self(observations)[1]


class TryPolicy(CellPolicy):
    """Policy and value of PPO over every try of an episode; name it as `policy` in a file of hyperparameters.

    Args:
        observation_space: Space of observations of -v1 or of rehearsal.
        action_space: Box(-1, 1, (n_pb,)), in rehearsal (n_pb + 1,).
        lr_schedule: Learning rate by what is left of the training.
        width: Units of a hidden layer.
        n_layers: Hidden layers of the score.
        resolution: Cells along an axis of the PB space, of which one is chosen and a point drawn within it.
        use_sde: Has to be False: cells are drawn, no noise is added.

    Raises:
        SettingsError: If the observations do not tell every try, or a setting is out of range.
    """

    def __init__(
        self, observation_space: Box, action_space: Box, lr_schedule: Any, width: int = 32, n_layers: int = 2,
        resolution: int = 16, use_sde: bool = False,
    ) -> None:  # fmt: skip
        self.resolution = resolution
        super().__init__(observation_space, action_space, lr_schedule, width, n_layers, use_sde)

    def make_network(self, space: Box, actions: Any) -> tuple[Any, CellDistribution]:
        """Return the network and its distribution."""
        features = TryFeatures(space, self.resolution)
        network = TryNetwork(features, self.width, self.n_layers)
        return network, CellDistribution(features.n_pb, self.resolution, features.rehearsal)
