"""The network of the learned map: attention from any PB point to the tries so far and the learned points."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box
from torch import Tensor, nn

from creative_nao.agents.learned_map.agent import LearnedMapSettings, refined
from creative_nao.agents.learned_map.truth import spread_points
from creative_nao.envs.observation import N_APPROPRIATE, split, tries_of
from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures.outcome import ALL_OUTCOMES, OUTCOME_CODE

N_WAVES = 6
"""Random waves over the PB space that tell the network where a point lies."""
SCALES = (0.05, 0.1, 0.2, 0.4, 0.8)
"""Widths of the Gaussian kernels by which a point asked sees how densely it is surrounded."""
LOG_SPREAD = -4.0, 2.0
"""Bounds of the logarithm of the spread."""
DRAWN_AT = 0.1
"""Temperature at which actions that are not deterministic are drawn."""


class _Attention(nn.Module):
    """Attention from points to a set of tries; a head's weights decay with the squared distance, at a learned rate."""

    def __init__(self, width: int, n_heads: int, dropout: float) -> None:
        super().__init__()
        self.n_heads, self.dropout = n_heads, nn.Dropout(dropout)
        self.query, self.key_value = nn.Linear(width, width), nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)
        self.norm_query, self.norm_tries, self.norm = nn.LayerNorm(width), nn.LayerNorm(width), nn.LayerNorm(width)
        self.feed_forward = nn.Sequential(nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, width))
        self.log_decay = nn.Parameter(torch.linspace(-1.0, 5.0, n_heads))

    def keys_values(self, tries: Tensor) -> tuple[Tensor, ...]:
        """Return keys and values of tries (b, n, width), (b, n_heads, n, width / n_heads) each."""
        key_value = self.key_value(self.norm_tries(tries)).unflatten(-1, (2, self.n_heads, -1))
        return key_value.permute(2, 0, 3, 1, 4).unbind()

    def forward(self, points: Tensor, read: tuple[Tensor, ...], squares: Tensor, padding: Tensor | None) -> Tensor:
        """Return points (b, q, width) after reading the `keys_values` of n tries that are no `padding` (b, n)."""
        b, q, width = points.shape
        query = self.query(self.norm_query(points)).view(b, q, self.n_heads, -1).transpose(1, 2)
        key, value = read
        decay = squares[:, None] * self.log_decay.exp()[None, :, None, None]
        weight = query @ key.transpose(-1, -2) / query.shape[-1] ** 0.5 - decay
        if padding is not None:
            weight = weight.masked_fill(padding[:, None, None, :], -1e9)
        weight = weight.softmax(-1)
        points = points + self.dropout(self.out((weight @ value).transpose(1, 2).reshape(b, q, width)))
        return points + self.dropout(self.feed_forward(self.norm(points)))


class AttentiveMap(nn.Module):
    """A learned map as a policy: `predict` returns the PB point where it expects the largest reward.

    Of each PB point asked it tells the logit of being appropriate, the expected distance to the nearest movement known
    now, the logarithm of its spread, and the distance to each basic action; distances in units of the reward.

    Args:
        observation_space: That of a -v1 environment.
        action_space: PB vectors.
        lr_schedule: Of Stable-Baselines3; not used.
        width: Units of each layer.
        n_heads: Of each layer of attention.
        n_layers: Layers in which tries read each other, and as many in which points read them.
        dropout: Share of units left out in training.
        n_asked, n_refined, first_share, n_expected: As of `LearnedMapSettings`.
        n_segments: PB vectors of a movement, each held for an equal part of it; where there are several, a point is all
            of them and the environment one in which the PB may change during a movement.
    """

    waves: Tensor
    basic_gaps: Tensor
    encoder: Any  # layers of `_Attention`
    decoder: Any

    def __init__(
        self,
        observation_space: Box,
        action_space: Box,
        lr_schedule: Any = None,
        *,
        width: int = 64,
        n_heads: int = 8,
        n_layers: int = 2,
        dropout: float = 0.0,
        n_asked: int = 256,
        n_refined: int = 64,
        first_share: float = 0.0,
        n_expected: int = 9_999,
        n_segments: int = 1,
    ) -> None:
        super().__init__()
        self.settings = LearnedMapSettings(n_asked, n_refined, first_share, n_expected)
        self.observation_space, self.action_space = observation_space, action_space
        n_pb, self.n_segments = action_space.shape[0], n_segments
        self.parts, self.columns = tries_of(observation_space, n_pb)
        self.n_basic = n_basic = self.columns[-1].size
        self.n_decisions = self.columns[1].size // n_pb
        self.segment_starts = [-(-segment * self.n_decisions // n_segments) for segment in range(n_segments)]
        if self.columns[-1].name != "distances" or self.n_decisions < n_segments:
            raise SettingsError(
                f"`observation_space` should tell tries of {n_pb} PB units and their distances to the basic actions, "
                f"as -v1 does, but tells {', '.join(column.name for column in self.columns)}"
            )
        if width % n_heads:
            raise SettingsError(f"`n_heads` should divide `width` {width}, but is {n_heads}")
        n_pb *= n_segments
        self.candidates = spread_points(n_pb, n_asked).astype(np.float32)
        n_told = n_pb + self.columns[-1].stop - self.columns[1].stop  # of a row, all but whether there is one
        self.embed_try = self._embedding(n_told + 3 + n_basic, width)
        self.embed_point = self._embedding(n_pb + 2 * N_WAVES + 4 * len(SCALES), width)
        self.encoder = nn.ModuleList(_Attention(width, n_heads, dropout) for _ in range(n_layers))
        self.decoder = nn.ModuleList(_Attention(width, n_heads, dropout) for _ in range(n_layers))
        self.head = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, 3 + n_basic))
        self.register_buffer("waves", 2.0 * torch.randn(n_pb, N_WAVES))
        self.register_buffer("basic_gaps", torch.zeros(n_basic, n_basic))

    @staticmethod
    def _embedding(n_values: int, width: int) -> nn.Module:
        return nn.Sequential(nn.Linear(n_values, width), nn.GELU(), nn.Linear(width, width))

    def encode(self, points: Tensor, rows: Tensor, performed: Tensor) -> tuple[Any, ...]:
        """Return what is known as a set.

        Its tokens (b, n, width), keys and values for each layer of the decoder, which tokens are padding (None: none
        is), where they lie, and how much of each of four kinds they are, (b, n, 4): learned points, tries performed and
        imagined that can be used, those that cannot.

        Args:
            points: Learned PB points, (b, n_basic, n_pb).
            rows: Tries as rows of the -v1 observation, (b, n, row), zero where there is none.
            performed: 1 where a try was performed, 0 where it was imagined, (b, n).
        """
        b, n_basic, n_pb = points.shape
        here, outcome = rows[..., 0], 1 + n_pb  # of a row
        usable = rows[..., outcome : outcome + N_APPROPRIATE].sum(-1)
        flags = torch.stack([torch.zeros_like(here), performed * here, (1.0 - performed) * here], -1)
        tries = torch.cat([rows[..., 1:], flags, rows.new_zeros(b, rows.shape[1], n_basic)], -1)
        taught = points.new_zeros(b, n_basic, tries.shape[-1])
        taught[..., :n_pb] = points
        taught[..., n_pb + OUTCOME_CODE["learned"]] = 1.0
        far = n_pb + len(ALL_OUTCOMES) + 1
        taught[..., far : far + n_basic] = self.basic_gaps / (self.basic_gaps + 1.0)
        taught[..., -3 - n_basic] = 1.0
        taught[..., -n_basic:] = torch.eye(n_basic)
        kinds = torch.stack([flags[..., 0], flags[..., 1] * usable, flags[..., 2] * usable, here * (1.0 - usable)], -1)
        kinds = torch.cat([kinds.new_tensor([1.0, 0.0, 0.0, 0.0]).expand(b, n_basic, 4), kinds], 1)
        told = torch.cat([taught, tries], 1)
        tokens, where = self.embed_try(told), told[..., :n_pb]
        empty = kinds.sum(-1) == 0.0
        padding, gaps = empty if empty.any() else None, squares(where, where)
        for layer in self.encoder:
            tokens = layer(tokens, layer.keys_values(tokens), gaps, padding)
        return tokens, [layer.keys_values(tokens) for layer in self.decoder], padding, where, kinds

    def decode(self, known: tuple[Any, ...], pb: Tensor) -> Tensor:
        """Return what is told of each PB point asked, (b, q, n_pb) into (b, q, 3 + n_basic)."""
        _, read, padding, where, kinds = known
        far, waves = squares(pb, where), pb @ self.waves
        spans = far.new_tensor([-2.0 * scale**2 for scale in SCALES])[:, None, None]
        density = torch.log(torch.exp(far[:, None] / spans) @ kinds[:, None] + 0.01).transpose(1, 2).flatten(2)
        asked = self.embed_point(torch.cat([pb, waves.sin(), waves.cos(), density], -1))
        for layer, keys_values in zip(self.decoder, read, strict=True):
            asked = layer(asked, keys_values, far, padding)
        return self.head(asked)

    def forward(self, points: Tensor, rows: Tensor, performed: Tensor, pb: Tensor) -> Tensor:
        """Return `decode` of `encode`."""
        return self.decode(self.encode(points, rows, performed), pb)

    def expect(self, points: np.ndarray, rows: np.ndarray, performed: np.ndarray) -> Any:
        """Return a function of PB points (q, n_pb): probability of being appropriate, distance, its spread, (q,) each.

        The arguments are those of `encode`, of one set.
        """
        with torch.inference_mode():
            known = self.encode(*(_tensor(one)[None] for one in (points, rows, performed)))

        def ask(pb: np.ndarray) -> tuple[np.ndarray, ...]:
            with torch.inference_mode():
                return tuple(one[0].numpy() for one in expected(self.decode(known, _tensor(pb)[None])))

        return ask

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
        nothing = np.zeros((len(told["tries"]), *self.action_space.shape), np.float32)
        parts = told["points"], told["tries"], told.get("path", nothing), told.get("phase", nothing)
        # One by one: the same bits in any batch.
        chosen = [self._choose(*one, deterministic) for one in zip(*parts, strict=True)]
        return (np.stack(chosen) if batch.ndim == 2 else chosen[0]), state

    def _choose(
        self, points: np.ndarray, rows: np.ndarray, path: np.ndarray, phase: np.ndarray, deterministic: bool
    ) -> np.ndarray:
        """Return the action for the parts of one observation; within a movement, the best end of what has begun."""
        n_pb, decision = self.action_space.shape[0], round(float(phase[0]) * self.n_decisions)
        path, stop = path.reshape(-1, n_pb), self.columns[1].stop
        if decision not in self.segment_starts:
            return path[decision - 1]
        segment, rows = self.segment_starts.index(decision), rows[rows[:, 0] > 0.0]
        performed = rows[:, 1:stop].reshape(-1, self.n_decisions, n_pb)[:, self.segment_starts]
        size, done = n_pb * self.n_segments, path[self.segment_starts[:segment]].ravel()
        rows = np.concatenate([rows[:, :1], performed.reshape(-1, size), rows[:, stop:]], axis=1)
        learned = np.tile(points.reshape(self.n_basic, n_pb), (1, self.n_segments))
        ask = self.expect(learned, rows, np.ones(len(rows)))

        def begun(pb: np.ndarray) -> np.ndarray:
            return np.concatenate([done[None].repeat(len(pb), axis=0), pb[:, len(done) :]], axis=1)

        pb, value = refined(lambda pb: ask(begun(pb)), self.candidates, self.settings.n_refined, 0.0, self.n_segments)
        value[(begun(pb)[:, None] == rows[:, 1 : 1 + size]).all(-1).any(-1)] = -np.inf  # tried before
        place = value.argmax()
        if not deterministic:
            place = int(torch.multinomial((torch.from_numpy(value) / DRAWN_AT).softmax(0), 1))
        return pb[place, segment * n_pb : (segment + 1) * n_pb]

    def set_training_mode(self, mode: bool) -> None:
        """Switch dropout on or off."""
        self.train(mode)


def expected(told: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return probability, distance and spread of what the network tells (..., 3 + n_basic)."""
    return told[..., 0].sigmoid(), told[..., 1], told[..., 2].clamp(*LOG_SPREAD).exp()


def squares(one: Tensor, other: Tensor) -> Tensor:
    """Return the squared distances of points (..., q, n_pb) and (..., n, n_pb), (..., q, n)."""
    return ((one[..., :, None, :] - other[..., None, :, :]) ** 2).sum(-1)


def _tensor(values: np.ndarray) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(values, np.float32))
