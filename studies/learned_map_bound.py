"""What a learned map loses to memories that it has never seen: its reward on those it was trained on and on others.

    python studies/learned_map_bound.py BUNDLE ... --memories runs/memories --validation-memories runs/held-out

The folders are those of `creative-nao agent memories`. Every map plays greedily over the points of each memory's truth,
without imagining, in `--copies` copies whose axes are flipped and swapped; what it earns is divided by what uniform
sampling earns on the same memories, for some memories are richer than others. More memories to learn from can bring the
second ratio up to the first at most, as long as the first does not rise too. Beside it stand two terms of its loss in
simulated episodes: the cross-entropy of being appropriate and the negative log-likelihood of the distance.

With `--power` a it plays where p^a m is largest, of the probability p and the distance m that it expects. Last comes
the correlation of what two points earn at the start of an episode, by their distance on the truth's grid of 32 x 32.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from torch import Tensor

from creative_nao.agents import load_agent
from creative_nao.agents.learned_map.episodes import N_ACTIONS, SimulatedEpisode, random_warp
from creative_nao.agents.learned_map.network import AttentiveMap, expected
from creative_nao.agents.learned_map.training import Simulator, SupervisedMap, judge, losses
from creative_nao.agents.learned_map.truth import MemoryTruth, read_truths
from creative_nao.errors import SettingsError

CELLS = 1, 2, 3, 4, 6, 8
"""Distances of two points, in cells of the grid, which are 2 / 31 wide."""


@dataclass(frozen=True)
class BoundSettings:
    """What a learned map loses to memories that it has never seen."""

    maps: tyro.conf.Positional[tuple[str, ...]]
    """Bundles of `agent train learned_map`, or names of shipped ones."""
    memories: Path
    """Folder of the memories that they were trained on."""
    validation_memories: Path
    """Folder of memories that they were not trained on."""
    most: int = 60
    """So many memories of a folder are played at most, evenly over it."""
    copies: int = 2
    """Symmetric copies of each memory that are played."""
    power: float = 1.0
    """To which the probability is raised where the map chooses."""


class RaisedProbability:
    """A learned map that chooses by probability ^ `power` x distance."""

    def __init__(self, policy: AttentiveMap, power: float) -> None:
        self.policy, self.power, self.encode = policy, power, policy.encode

    def decode(self, known: tuple[Any, ...], pb: Tensor) -> Tensor:
        """Return what `AttentiveMap.decode` returns, with the logit of the power."""
        told = self.policy.decode(known, pb).clone()
        told[..., 0] = (expected(told)[0] ** self.power).logit()
        return told


def rewards(policy: Any, truths: Sequence[MemoryTruth], copies: int) -> np.ndarray:
    """Return the mean reward of greedy episodes in each memory, (n_memories,)."""
    return np.reshape(judge(policy, truths, range(copies)), (len(truths), copies)).mean(axis=1)


def standard_error(values: np.ndarray) -> float:
    """Return the standard error of the mean; of a single value, nan."""
    return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else np.nan


def mean_losses(policy: AttentiveMap, truths: Sequence[MemoryTruth], n_batches: int = 40) -> tuple[float, ...]:
    """Return cross-entropy and negative log-likelihood in simulated episodes without imagining or warps."""
    simulator, found = Simulator(truths, SupervisedMap(imagined_share=0.0, warp=0.0)), []
    with torch.inference_mode():
        for seed in range(n_batches):
            known, (queries, *truth) = simulator.batch(np.random.default_rng(seed))
            found.append([term.item() for term in losses(policy(*known, queries), *truth)[:2]])
    return tuple(np.mean(found, axis=0))


def correlations(truths: Sequence[MemoryTruth]) -> list[float]:
    """Return the correlation of what two points earn at the start, `CELLS` apart along an axis; mean over memories."""
    found = []
    for truth in truths:
        grid = np.where(truth.appropriate, truth.distances.min(axis=1), 0.0).reshape(32, 32)
        grid = (grid - grid.mean()) / grid.std()
        found.append([((grid[n:] * grid[:-n]).mean() + (grid[:, n:] * grid[:, :-n]).mean()) / 2.0 for n in CELLS])
    return np.mean(found, axis=0).tolist()


def random_reward(truths: Sequence[MemoryTruth], n_episodes: int = 20) -> float:
    """Return what points drawn uniformly earn over an episode, the mean over memories."""
    rng, earned = np.random.default_rng(0), []
    for truth in truths:
        for _ in range(n_episodes):
            episode = SimulatedEpisode(truth, random_warp(truth.form[0], rng), np.arange(truth.form[1]))
            episode.perform_best(N_ACTIONS, 1, rng)
            earned.append(sum(episode.earned))
    return float(np.mean(earned))


def run(settings: BoundSettings) -> dict[str, dict[str, float]]:
    """Print a table; return what each map earns on both folders in multiples of uniform sampling."""
    if settings.most < 1 or settings.copies < 1:
        raise SettingsError(f"`most` and `copies` should be at least 1, but are {settings.most} and {settings.copies}")
    if not settings.power >= 0.0:
        raise SettingsError(f"`power` should be at least 0, but is {settings.power}")
    folders = {"trained on": settings.memories, "others": settings.validation_memories}
    found: dict[str, dict[str, float]] = {name: {} for name in settings.maps}
    print("| memories | map | reward | of uniform sampling | cross-entropy | of the distance |")
    print("| --- | --- | ---: | ---: | ---: | ---: |")
    for kind, folder in folders.items():
        truths = read_truths(folder)
        truths = truths[:: -(-len(truths) // settings.most)]
        uniform = random_reward(truths)
        print(f"| {len(truths)} {kind} | uniform sampling | {uniform:.2f} | 1 | | |")
        for name in settings.maps:
            policy: Any = load_agent(name).policy  # pyright: ignore[reportAttributeAccessIssue]
            earned = rewards(RaisedProbability(policy, settings.power), truths, settings.copies)
            found[name][kind] = float(earned.mean() / uniform)
            told = f"| {len(truths)} {kind} | {name} | {earned.mean():.2f} +- {standard_error(earned):.2f}"
            told += f" | {found[name][kind]:.3f} |"
            print(told, " | ".join(f"{one:.3f}" for one in mean_losses(policy, truths)), "|", flush=True)
        if truths[0].n_units == 2:
            told = (f"{n * 2 / 31:.2f}: {one:.2f}" for n, one in zip(CELLS, correlations(truths), strict=True))
            print(f"Correlation of what points earn at first, by their distance in PB space: {', '.join(told)}.")
    return found


if __name__ == "__main__":
    run(tyro.cli(BoundSettings, description=__doc__))
