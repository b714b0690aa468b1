"""The network of the learned map: attention from any PB point to the tries so far and the learned points."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box
from torch import Tensor, nn

from creative_nao.agents.learned_map.agent import LearnedMapSettings, pick
from creative_nao.agents.learned_map.truth import spread_points
from creative_nao.envs.observation import layout, split, try_columns
from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures.outcome import ALL_OUTCOMES

N_WAVES = 6
"""Random waves over the PB space that tell the network where a point lies."""
LOG_SPREAD = -4.0, 2.0
"""Bounds of the logarithm of the spread."""
DRAWN_AT = 0.1
"""Temperature of drawn actions where the settings have none."""


class _Attention(nn.Module):
    """A layer in which points read a set of tries; each head prefers near ones by a weight that it learns."""

    def __init__(self, width: int, n_heads: int, dropout: float) -> None:
        super().__init__()
        self.n_heads, self.dropout = n_heads, dropout
        self.ask, self.tell = nn.Linear(width, width), nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)
        self.norm_ask, self.norm_tell, self.norm = nn.LayerNorm(width), nn.LayerNorm(width), nn.LayerNorm(width)
        self.step = nn.Sequential(nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, width))
        self.nearness = nn.Parameter(torch.linspace(-1.0, 4.0, n_heads))

    def forward(self, points: Tensor, tries: Tensor, squares: Tensor, here: Tensor) -> Tensor:
        """Return the points (b, q, width) after reading tries (b, n, width) where `here` (b, n)."""
        b, q, width = points.shape
        ask = self.ask(self.norm_ask(points)).view(b, q, self.n_heads, -1).transpose(1, 2)
        told = self.tell(self.norm_tell(tries)).view(b, tries.shape[1], 2, self.n_heads, -1).permute(2, 0, 3, 1, 4)
        near = -squares[:, None] * self.nearness.exp()[None, :, None, None]
        weight = ask @ told[0].transpose(-1, -2) / ask.shape[-1] ** 0.5 + near
        weight = weight.masked_fill(~here[:, None, None, :], -1e9).softmax(-1)
        read = self.out((weight @ told[1]).transpose(1, 2).reshape(b, q, width))
        points = points + nn.functional.dropout(read, self.dropout, self.training)
        return points + nn.functional.dropout(self.step(self.norm(points)), self.dropout, self.training)


class AttentiveMap(nn.Module):
    """A learned map as a policy: `predict` returns the PB point where it expects the largest reward.

    For each PB point asked it returns three numbers: the logit of being appropriate, the expected distance to the
    nearest movement known now (in units of the reward), and the logarithm of its spread.

    Args:
        observation_space: That of a -v1 environment.
        action_space: PB vectors.
        lr_schedule: Of Stable-Baselines3; not used.
        n_basic: Basic actions of the memories.
        width: Units of each layer.
        n_heads: Of each layer of attention.
        n_layers: Layers in which tries read each other, and as many in which points read them.
        dropout: Share of units left out in training.
        n_candidates, optimism, temperature, spacing, n_at_once, first_share: As of `LearnedMapSettings`.
    """

    def __init__(
        self,
        observation_space: Box,
        action_space: Box,
        lr_schedule: Any = None,
        *,
        n_basic: int = 6,
        width: int = 64,
        n_heads: int = 8,
        n_layers: int = 2,
        dropout: float = 0.0,
        n_candidates: int = 1024,
        optimism: float = 0.0,
        temperature: float = 0.0,
        spacing: float = 0.0,
        n_at_once: int = 16,
        first_share: float = 0.0,
    ) -> None:
        super().__init__()
        self.settings = LearnedMapSettings(n_candidates, optimism, temperature, spacing, n_at_once, first_share)
        self.observation_space, self.action_space, self.n_basic = observation_space, action_space, n_basic
        n_pb = action_space.shape[0]
        self.columns = try_columns(n_basic, n_pb)
        n_rows, rest = divmod(observation_space.shape[0] - 1 - n_basic * n_pb, self.columns[-1].stop)
        if rest or n_rows < 1:
            raise SettingsError(
                f"the learned map reads the -v1 observation of {n_basic} basic actions and {n_pb} PB units, whole "
                f"trajectories among it, but this one has {observation_space.shape[0]} values"
            )
        if width % n_heads:
            raise SettingsError(f"`n_heads` should divide `width` {width}, but is {n_heads}")
        self.parts = layout(n_basic, n_pb, n_rows=n_rows)
        self.candidates = spread_points(n_pb, n_candidates).astype(np.float32)
        self.candidate_gap = 2.0 / (len(self.candidates) ** (1.0 / n_pb) - 1.0)
        n_told = n_pb + len(ALL_OUTCOMES) + 1 + n_basic  # of a row: all but `tried`
        self.read_try = self._reader(n_told + n_basic + 3, width)
        self.read_point = self._reader(n_pb + 2 * N_WAVES, width)
        self.among = nn.ModuleList(_Attention(width, n_heads, dropout) for _ in range(n_layers))
        self.towards = nn.ModuleList(_Attention(width, n_heads, dropout) for _ in range(n_layers))
        self.head = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, 3))
        self.register_buffer("waves", 2.0 * torch.randn(n_pb, N_WAVES))

    @staticmethod
    def _reader(n_values: int, width: int) -> nn.Module:
        return nn.Sequential(nn.Linear(n_values, width), nn.GELU(), nn.Linear(width, width))

    def encode(self, points: Tensor, rows: Tensor, performed: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return what is known as a set: its tokens (b, n, width), where they lie, and which of them are there.

        Args:
            points: Learned PB points, (b, n_basic, n_pb).
            rows: Tries as rows of the -v1 observation, (b, n, row), zero where there is none.
            performed: 1 where a try was performed, 0 where it was imagined, (b, n).
        """
        b, n_basic, n_pb = points.shape
        after = performed.flip(1).cumsum(1).flip(1) * performed / 30.0  # how long ago
        zeros = rows.new_zeros(b, rows.shape[1], n_basic + 1)
        tries = torch.cat([rows[..., 1:], performed[..., None], after[..., None], zeros], -1)
        taught = points.new_zeros(b, n_basic, tries.shape[-1])
        taught[..., :n_pb] = points
        taught[..., -1] = 1.0
        taught[..., -1 - n_basic : -1] = torch.eye(n_basic)
        told = torch.cat([taught, tries], 1)
        where = told[..., :n_pb]
        here = torch.cat([torch.ones(b, n_basic, dtype=torch.bool), rows[..., 0] > 0.0], 1)
        tokens, squares = self.read_try(told), _squares(where, where)
        for layer in self.among:
            tokens = layer(tokens, tokens, squares, here)
        return tokens, where, here

    def decode(self, known: tuple[Tensor, Tensor, Tensor], pb: Tensor) -> Tensor:
        """Return the three numbers of each PB point asked, (b, q, n_pb) into (b, q, 3)."""
        tokens, where, here = known
        waves = pb @ self.waves
        asked, squares = self.read_point(torch.cat([pb, waves.sin(), waves.cos()], -1)), _squares(pb, where)
        for layer in self.towards:
            asked = layer(asked, tokens, squares, here)
        return self.head(asked)

    def forward(self, points: Tensor, rows: Tensor, performed: Tensor, pb: Tensor) -> Tensor:
        """Return `decode` of `encode`."""
        return self.decode(self.encode(points, rows, performed), pb)

    def expected_reward(
        self, points: np.ndarray, rows: np.ndarray, performed: np.ndarray, pb: np.ndarray, optimism: float = 0.0
    ) -> np.ndarray:
        """Return what each PB point (q, n_pb) is expected to earn now, (q,), from what is known: see `encode`."""
        known = (torch.from_numpy(np.ascontiguousarray(one, np.float32))[None] for one in (points, rows, performed, pb))
        with torch.inference_mode():
            return value_of(self(*known), optimism)[0].numpy()

    def predict(
        self, observation: np.ndarray, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return actions for -v1 observations, (size,) or (n, size): (n_pb,) or (n, n_pb), float32; and `state`.

        One that is not deterministic is drawn by the global generator of torch, as those of Stable-Baselines3 are.
        """
        batch = np.asarray(observation, np.float32)
        if batch.shape[-1:] != self.observation_space.shape or batch.ndim > 2:
            raise ShapeError(f"`observation` should end in {self.observation_space.shape}, but has {batch.shape}")
        told = split(np.atleast_2d(batch), self.parts, self.columns)
        temperature = 0.0 if deterministic else self.settings.temperature or DRAWN_AT
        settings = replace(self.settings, temperature=temperature)
        chosen = []
        for taught, rows in zip(told["points"], told["tries"], strict=True):  # one by one: the same bits in any batch
            rows = rows[rows[:, 0] > 0.0]
            points = taught.reshape(self.n_basic, -1)
            values = self.expected_reward(points, rows, np.ones(len(rows)), self.candidates, settings.optimism)
            tried = _squares(torch.from_numpy(self.candidates), torch.from_numpy(rows[:, 1 : 1 + points.shape[1]]))
            values[(tried < 1e-8).any(-1).numpy()] = -np.inf
            rng = np.random.default_rng(int(torch.randint(2**62, ())) if temperature else 0)
            chosen.append(self.candidates[pick(values, self.candidates, 1, settings, rng)[0]])
        return (np.stack(chosen) if batch.ndim == 2 else chosen[0]), state

    def check_form(self, points: np.ndarray) -> None:
        """Refuse the learned points of a memory of another form: a `SettingsError`."""
        if points.shape != (self.n_basic, *self.action_space.shape):
            raise SettingsError(
                f"this learned map is for memories with {self.n_basic} basic actions and "
                f"{self.action_space.shape[0]} PB units, but this one has {points.shape[0]} and {points.shape[1]}"
            )

    def set_training_mode(self, mode: bool) -> None:
        """Switch dropout on or off."""
        self.train(mode)


def value_of(told: Tensor, optimism: float = 0.0) -> Tensor:
    """Return the expected reward of what the network tells (..., 3): probability times distance plus its spread."""
    return told[..., 0].sigmoid() * (told[..., 1] + optimism * told[..., 2].clamp(*LOG_SPREAD).exp())


def _squares(one: Tensor, other: Tensor) -> Tensor:
    """Return the squared distances of points (..., q, n_pb) and (..., n, n_pb), (..., q, n)."""
    return ((one[..., :, None, :] - other[..., None, :, :]) ** 2).sum(-1)
