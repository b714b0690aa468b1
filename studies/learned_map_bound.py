"""What a learned map loses to memories that it has never seen: its reward on those it was trained on and on others.

    python studies/learned_map_bound.py BUNDLE ... --memories runs/memories --validation-memories runs/held-out

The folders are those of `creative-nao agent memories`. Every map plays greedily over the points of each memory's truth,
without imagining, in `--copies` copies whose axes are flipped and swapped; what it earns is divided by what uniform
sampling earns on the same memories, for some memories are richer than others. More memories to learn from can bring the
second ratio up to the first at most, as long as the first does not rise too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from creative_nao.agents import load_agent
from creative_nao.agents.learned_map.episodes import N_ACTIONS, SimulatedEpisode, random_warp
from creative_nao.agents.learned_map.training import judge
from creative_nao.agents.learned_map.truth import MemoryTruth, read_truths
from creative_nao.errors import SettingsError


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
    folders = {"trained on": settings.memories, "others": settings.validation_memories}
    found: dict[str, dict[str, float]] = {name: {} for name in settings.maps}
    print("| memories | map | reward | of uniform sampling |\n| --- | --- | ---: | ---: |")
    for kind, folder in folders.items():
        truths = read_truths(folder)
        truths = truths[:: -(-len(truths) // settings.most)]
        uniform = random_reward(truths)
        print(f"| {len(truths)} {kind} | uniform sampling | {uniform:.2f} | 1 |")
        for name in settings.maps:
            policy = load_agent(name).policy  # pyright: ignore[reportAttributeAccessIssue]
            rewards = np.reshape(judge(policy, truths, range(settings.copies)), (len(truths), -1)).mean(axis=1)
            error = rewards.std(ddof=1) / np.sqrt(len(truths)) if len(truths) > 1 else np.nan
            found[name][kind] = float(rewards.mean() / uniform)
            print(f"| {len(truths)} {kind} | {name} | {rewards.mean():.2f} +- {error:.2f} | {found[name][kind]:.3f} |")
    return found


if __name__ == "__main__":
    run(tyro.cli(BoundSettings, description=__doc__))
