"""The learned map as a convolutional network on a grid, beside the attentive one on sets, which is the one that ships.

    python studies/convolutional_map.py --memories runs/memories --validation-memories runs/held-out --out runs/forms

Every form is trained by the same `train_map` with the same recipe, draws and memories: the bank's train part and the
first of the folder (those of `creative-nao agent memories`). All play greedy episodes over the points of the same
validation memories; their last weights play, so that nothing was chosen there. What is finished in --out is not done
again, and a training that was stopped goes on. `convolutional` reads the grid alone; `hybrid` is the attentive form
that reads the grid too; a sum such as `attentive+convolutional` plays by the mean of what both expect.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from gymnasium.spaces import Box
from learned_map_scaling import ENV, in_order
from torch import Tensor, nn
from torch.nn.functional import gelu, grid_sample, interpolate

from creative_nao import storage
from creative_nao.agents.learned_map.network import SCALES, AttentiveMap, expected, squares
from creative_nao.agents.learned_map.training import SupervisedMap, judge, train_map
from creative_nao.agents.learned_map.truth import MemoryTruth, bank_truths, read_truths
from creative_nao.agents.settings import read_hyperparameters
from creative_nao.agents.training import TrainingPlan
from creative_nao.cli.terminal import Display
from creative_nao.errors import SettingsError
from creative_nao.evaluation.statistics import resample
from creative_nao.maps import pb_grid
from creative_nao.model import split_memories
from creative_nao.runtime import versions
from creative_nao.schema import dump, load_json, record

NAME = "convolutional_map"
PLAYED_SEEDS = range(10, 14)
"""Of the episodes played: each turns the PB space in its own way."""
N_SPREAD = 3
"""At so many of `SCALES`, the narrowest, what is told of a try is spread over the grid; at all, how many there are."""


class GridNetwork(nn.Module):
    """A U-Net on square grids (b, n_in, r, r); it gives its features at any point, read by bilinear interpolation.

    Args:
        n_in: Channels of the grid.
        channels: At full resolution; 1.5 times as many at a half, twice as many at a quarter of it.
        n_blocks: Residual blocks at a quarter of the resolution.
    """

    def __init__(self, n_in: int, channels: int, n_blocks: int = 4) -> None:
        super().__init__()
        middle, coarse = channels * 3 // 2, channels * 2
        self.n_out = channels + middle
        self.enter, self.fine = nn.Conv2d(n_in, channels, 1), nn.Conv2d(channels, channels, 3, padding=1)
        self.halve = nn.Conv2d(channels, middle, 3, stride=2, padding=1)
        self.quarter = nn.Conv2d(middle, coarse, 3, stride=2, padding=1)
        self.norms = nn.ModuleList(nn.GroupNorm(1, coarse) for _ in range(n_blocks))
        self.blocks = nn.ModuleList(nn.Conv2d(coarse, coarse, 3, padding=1) for _ in range(n_blocks))
        self.everywhere = nn.ModuleList(nn.Linear(coarse, coarse) for _ in range(n_blocks))
        self.merge = nn.Conv2d(coarse + middle, middle, 3, padding=1)

    def forward(self, grid: Tensor) -> tuple[Tensor, Tensor]:
        """Return the features at full and at half resolution, (b, channels, r, r) and (b, 1.5 channels, r/2, r/2)."""
        full = gelu(self.enter(grid))
        full = full + gelu(self.fine(full))
        half = gelu(self.halve(full))
        coarse = gelu(self.quarter(half))
        for norm, block, everywhere in zip(self.norms, self.blocks, self.everywhere, strict=True):
            read = norm(coarse)
            coarse = coarse + gelu(block(read) + everywhere(read.mean((-1, -2)))[..., None, None])
        return full, half + gelu(self.merge(torch.cat([interpolate(coarse, scale_factor=2.0), half], 1)))

    @staticmethod
    def read(levels: Sequence[Tensor], pb: Tensor) -> Tensor:
        """Return the features at points (b, q, 2), all levels beside each other, (b, q, n_out)."""
        where = pb[:, :, None]  # the first PB unit runs along the last axis of the grid
        read = [grid_sample(one, where, align_corners=True, padding_mode="border")[..., 0] for one in levels]
        return torch.cat(read, 1).transpose(1, 2)


class ConvolutionalMap(AttentiveMap):
    """A learned map on a grid: what each try tells is spread over a grid of the PB space, and a U-Net reads it.

    Channels of the grid: how densely members of each kind lie (as the attentive form tells of a query), and at the
    narrowest `N_SPREAD` of the same widths the mean of the tries' tokens, weighted by normal kernels (a convolutional
    conditional neural process: Gordon et al. 2020). With `n_layers` above 0 the tokens have read each other before, and
    a query reads the set after the grid: the hybrid form.

    Args:
        observation_space: As of `AttentiveMap`; with two PB units.
        action_space: PB vectors.
        lr_schedule: Of Stable-Baselines3; not used.
        channels: Of the U-Net.
        resolution: Cells along each axis of the grid; a multiple of 4.
        told: Numbers of a token that are spread at each width.
        settings: Those of `AttentiveMap`.
    """

    places: Tensor

    def __init__(
        self, observation_space: Box, action_space: Box, lr_schedule: Any = None, *,
        channels: int = 32, resolution: int = 32, told: int = 16, **settings: Any,
    ) -> None:  # fmt: skip
        super().__init__(observation_space, action_space, lr_schedule, **settings)
        if action_space.shape != (2,) or resolution % 4:
            form = f"{action_space.shape[0]} PB units and {resolution} cells"
            raise SettingsError(f"a grid needs two PB units and a multiple of 4 cells along each, but has {form}")
        width = self.embed_point[-1].out_features  # pyright: ignore[reportIndexIssue]
        self.told, self.resolution = nn.Linear(width, told), resolution
        self.grid = GridNetwork(4 * len(SCALES) + N_SPREAD * told, channels)
        self.enter = nn.Linear(self.grid.n_out, width)
        self.mix = nn.Sequential(
            nn.LayerNorm(width), nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, width)
        )
        self.register_buffer("places", torch.from_numpy(pb_grid(resolution)).float(), persistent=False)

    def encode(self, points: Tensor, rows: Tensor, performed: Tensor) -> Any:
        """Return what is known as a set, as `AttentiveMap` does, and the levels of features on the grid."""
        known = super().encode(points, rows, performed)
        tokens, _, _, where, kinds = known
        kernels = self.kernels(squares(self.places.expand(len(where), -1, -1), where))
        here, told = kinds.sum(-1, keepdim=True), self.told(tokens)
        parts = [torch.log(kernel @ kinds + 0.01) for kernel in kernels]
        parts += [(kernel @ (told * here)) / (kernel @ here + 1e-3) for kernel in kernels[:N_SPREAD]]
        channels = torch.cat(parts, -1).transpose(1, 2).unflatten(-1, (self.resolution, self.resolution))
        return *known, self.grid(channels)

    def decode(self, known: Any, pb: Tensor) -> Tensor:
        """Return what is told of each PB point asked, (b, q, 2) into (b, q, 3 + n_basic)."""
        _, keys_values, empty, where, kinds, levels = known
        far, waves = squares(pb, where), pb @ self.waves
        density = [torch.log(kernel @ kinds + 0.01) for kernel in self.kernels(far)]
        asked = self.embed_point(torch.cat([pb, waves.sin(), waves.cos(), *density], -1))
        asked = asked + self.enter(self.grid.read(levels, pb))
        asked = asked + self.mix(asked)
        for layer, told in zip(self.decoder, keys_values, strict=True):
            asked = layer(asked, told, far, empty)
        return self.head(asked)

    @staticmethod
    def kernels(far: Tensor) -> list[Tensor]:
        """Return exp(-d^2 / 2 s^2) of squared distances for each of `SCALES`, each half as wide as the one after it."""
        found = [torch.exp(far / (-2.0 * SCALES[-1] ** 2))]
        while len(found) < len(SCALES):
            found.append(found[-1] ** 4)
        return found[::-1]


class MeanMap:
    """Several maps as one: means of their probabilities and of their expected rewards. It plays and does not learn."""

    def __init__(self, members: Sequence[AttentiveMap]) -> None:
        self.members = members

    def encode(self, points: Tensor, rows: Tensor, performed: Tensor) -> list[Any]:
        """Return what each member keeps of what is known."""
        return [one.encode(points, rows, performed) for one in self.members]

    def decode(self, known: list[Any], pb: Tensor) -> Tensor:
        """Return the logit of the probability, the distance that gives the mean of the rewards, and no spread."""
        told = [expected(one.decode(mine, pb)) for one, mine in zip(self.members, known, strict=True)]
        usable = torch.stack([probability for probability, _, _ in told]).mean(0).clamp(1e-6, 1.0 - 1e-6)
        reward = torch.stack([probability * distance for probability, distance, _ in told]).mean(0)
        return torch.stack([usable.logit(), reward / usable, torch.zeros_like(usable)], -1)


FORMS: dict[str, tuple[type[AttentiveMap], dict[str, Any]]] = {
    "attentive": (AttentiveMap, {}),
    "convolutional": (ConvolutionalMap, {"n_layers": 0}),
    "hybrid": (ConvolutionalMap, {"n_layers": 1}),
}
"""The forms, and what differs from the shipped settings of the policy; their trainings take about as long."""


@record
class Played:
    """What one form, or several together, earned on each memory, and what its training took."""

    described: dict[str, Any]
    n_weights: int
    milliseconds_a_step: float | None
    """Of CPU time in training; None of several together, and where a finished training was read."""
    rewards: dict[str, list[float]]


@dataclass(frozen=True)
class FormsSettings:
    """The learned map as a convolutional network on a grid, beside the attentive one on sets."""

    out: Path
    """Folder of what is finished; `convolutional_map.json` is written there."""
    memories: Path
    """Folder to train on, beside the bank's train part."""
    validation_memories: Path
    """Folder to play on, beside the bank's validation part."""
    forms: tuple[str, ...] = ("attentive", "convolutional", "hybrid", "attentive+convolutional", "attentive+hybrid")
    """What is trained; joined by + what plays together."""
    n_memories: int = 141
    """How many memories are trained on."""
    seed: int = 0
    """Of the trainings."""
    timesteps: int = 64_000
    """Simulated episodes of each training."""
    conf_file: Path | None = None
    """Hyperparameters; default: the shipped ones."""
    docs: Path | None = None
    """Folder of the documentation to write the result to as well."""


def trained(
    form: str, truths: list[MemoryTruth], judged: list[MemoryTruth], settings: FormsSettings
) -> tuple[AttentiveMap, float | None]:
    """Train a form, or read one whose training has ended; return it and the CPU time of a step in milliseconds."""
    kind, changes = FORMS[form]
    SupervisedMap.policy_aliases[kind.__name__] = kind
    shipped = read_hyperparameters("learned_map", ENV, settings.conf_file)
    chosen = dataclasses.replace(
        shipped,
        n_timesteps=settings.timesteps,
        policy=kind.__name__,
        policy_kwargs={**shipped.policy_kwargs, **changes},
    )
    plan = TrainingPlan(
        chosen, env=ENV, judged_env=ENV, seed=settings.seed, judged_seeds=(0,), evaluation_interval=settings.timesteps
    )
    at: list[tuple[int, float]] = []

    def show(_: Any, done: int) -> None:
        at.append((done // chosen.arguments["batch_size"], time.process_time()))
        display.show(form, min(done, chosen.n_timesteps))

    with Display({form: chosen.n_timesteps}) as display:
        policy, _ = train_map(
            plan, truths, judged, checkpoint=settings.out / f"{form}-{settings.seed}.checkpoint", resume=True,
            progress=show,
        )  # fmt: skip
    steps = at[-1][0] - at[0][0] if at else 0
    return policy, 1000.0 * (at[-1][1] - at[0][1]) / steps if steps else None


def run(settings: FormsSettings) -> dict[str, Any]:
    """Train and play what is not finished, write the result and return it."""
    for name in settings.forms:
        if unknown := [form for form in name.split("+") if form not in FORMS]:
            raise SettingsError(f"`forms` should be {', '.join(FORMS)} or sums of these, but has {unknown[0]}")
    truths = in_order(bank_truths(split_memories("train"), settings.out / "truths"))
    truths = [*truths, *in_order(read_truths(settings.memories))][: settings.n_memories]
    judged = bank_truths(split_memories("validation"), settings.out / "truths")
    judged += read_truths(settings.validation_memories)
    shared = {"timesteps": settings.timesteps, "seed": settings.seed, "seeds": [*PLAYED_SEEDS]}
    shared |= {"recipe": dump(read_hyperparameters("learned_map", ENV, settings.conf_file))}
    shared |= {"truths": [one.name for one in truths], "judged": [one.name for one in judged]}
    found = {name: once(name, shared, truths, judged, settings) for name in settings.forms}
    rows = []
    for name, one in found.items():
        means = np.array([np.mean(rewards) for rewards in one.rewards.values()])
        row = {"form": name, "n_weights": one.n_weights, "milliseconds_a_step": one.milliseconds_a_step}
        row |= {"mean": float(means.mean()), "interval_95": over_memories(means)}
        if (first := found[settings.forms[0]]) is not one:
            more = means - np.array([np.mean(rewards) for rewards in first.rewards.values()])
            row |= {f"more_than_{settings.forms[0]}": float(more.mean()), "more_interval_95": over_memories(more)}
        rows.append({**row, "rewards": one.rewards})
    result = {"env": ENV, "versions": versions(), "n_memories": len(truths), **shared, "rows": rows}
    for folder in filter(None, (settings.out, settings.docs)):
        storage.write_json(folder / f"{NAME}.json", result, 1)
    return result


def once(
    name: str, shared: dict[str, Any], truths: list[MemoryTruth], judged: list[MemoryTruth], settings: FormsSettings
) -> Played:
    """Return what a form or several together earned, read from --out where it was finished with the same settings."""
    path, described = settings.out / f"{name}-{settings.seed}.json", {"form": name, **shared}
    if path.is_file() and (done := load_json(Played, path, "result of a form")).described == described:
        return done
    members = [trained(form, truths, judged, settings) for form in name.split("+")]
    maps: Any = [policy for policy, _ in members]
    rewards = np.reshape(judge(maps[0] if len(maps) == 1 else MeanMap(maps), judged, PLAYED_SEEDS), (len(judged), -1))
    played = Played(
        described,
        sum(one.numel() for policy in maps for one in policy.parameters()),
        members[0][1] if len(members) == 1 else None,
        {one.name: mine for one, mine in zip(judged, rewards.tolist(), strict=True)},
    )
    storage.write_json(path, dump(played), None)
    return played


def over_memories(means: np.ndarray) -> list[float]:
    """Return the 95 % bootstrap interval of the mean over memories of shape (n,)."""
    drawn = resample(means[:, None], 10_000, np.random.default_rng(0)).mean(axis=(1, 2))
    return np.quantile(drawn, [0.025, 0.975]).tolist()


def main() -> None:
    """Run the study of the command line and print a line for each form."""
    for row in run(tyro.cli(FormsSettings, description=__doc__))["rows"]:
        low, high = row["interval_95"]
        print(f"{row['form']}: {row['mean']:.2f} ({low:.2f} to {high:.2f})")


if __name__ == "__main__":
    main()
