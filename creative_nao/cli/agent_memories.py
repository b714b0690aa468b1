"""`creative-nao agent memories`: train memories, and score spread points of each, for agents that learn from them."""

from __future__ import annotations

import dataclasses
import threading
from pathlib import Path
from typing import Annotated

from creative_nao.agents.learned_map.truth import N_POINTS, kept_truth, truth_file
from creative_nao.cli.terminal import Display, changed_flags, print_result, refuse_leftovers, stopped_by_signals
from creative_nao.cli.train import file_stem
from creative_nao.demonstrations import load_demonstrations
from creative_nao.errors import SettingsError
from creative_nao.evaluation.runner import in_threads
from creative_nao.model import CONDITIONS, SPLITS, NetworkSettings, TrainingSettings, checkpoint_of, train_many
from creative_nao.runtime import usable_cores
from creative_nao.schema import Count, Field, Index, checked

FIRST_SEED = max(seeds.stop for seeds in SPLITS.values())
"""Seeds below are those of the bank, its test memories among them."""


@dataclasses.dataclass(frozen=True)
class AgentMemoriesSettings:
    """Train memories on the six shipped actions, and score spread points of each: what `agent train` calls its truth.

    The closed-loop ratios of the paper, 0, 0.5 and 1, take turns; after the three the seed goes on by one. The folder
    --out gets files such as open-2000.safetensors and open-2000.truth.safetensors. After Ctrl-C the same command with
    --resume goes on, and ends with the same bits as an uninterrupted run.
    """

    out: Path
    """Folder to write."""
    n_memories: int = 300
    """How many."""
    seed: int = 2000
    """Seed of the first three; seeds below 16 are the bank's."""
    n_epochs: int = 100_000
    """Passes over all actions in the training of a memory; the epoch with the lowest loss is kept."""
    n_pb: int = 2
    """PB units."""
    n_points: int = N_POINTS
    """PB points scored in each: with two PB units a square grid, else a Sobol sequence."""
    n_segments: int = 1
    """PB vectors of a movement scored, held in turn: 5 for a map of CreativeNao/BoxingModulation-v1."""
    n_workers: int | None = None
    """Memories made at the same time, without influence on the results; default: the number of cores."""
    resume: bool = False
    """Go on from checkpoints and finished memories, if there are any."""
    json: bool = False
    """Print the figures as JSON."""


def run(settings: AgentMemoriesSettings) -> int:
    """Train and score, print how many memories there are."""
    checked(Count, settings.n_memories, "--n-memories")
    checked(Annotated[int, Field(ge=4, le=10_000)], settings.n_points, "--n-points")
    checked(Annotated[int, Field(ge=1, le=10)], settings.n_segments, "--n-segments")
    n_workers = usable_cores() if settings.n_workers is None else checked(Count, settings.n_workers, "--n-workers")
    if checked(Index, settings.seed, "--seed") < FIRST_SEED:
        raise SettingsError(f"--seed should be at least {FIRST_SEED}, after the bank's, but is {settings.seed}")
    if settings.out.is_file():
        raise SettingsError(f"--out should name a folder, but {settings.out} is a file")
    ratios = [*CONDITIONS.values()]
    wanted = [
        TrainingSettings(closed_loop_ratio=ratios[k % 3], seed=settings.seed + k // 3, n_epochs=settings.n_epochs)
        for k in range(settings.n_memories)
    ]
    if not settings.resume:
        for one in wanted:
            path = _path(one, settings)
            refuse_leftovers([path, checkpoint_of(path), truth_file(settings.out, path.stem)])
    with Display({"memories": settings.n_memories}) as display, stopped_by_signals() as stop:
        made = in_threads(
            wanted,
            lambda one: _make(one, settings, stop),
            n_workers,
            lambda n_done, one: display.show("memories", n_done, file_stem(one)),
        )
    figures = {"out": str(settings.out), "n_memories": sum(made), "n_failed": len(made) - sum(made)}
    line = f"{settings.out}: {sum(made)} memories with their truth, {figures['n_failed']} failed in training"
    print_result(figures, [line], as_json=settings.json)
    return 0


def _path(training: TrainingSettings, settings: AgentMemoriesSettings) -> Path:
    return settings.out / f"{file_stem(training)}.safetensors"


def _make(training: TrainingSettings, settings: AgentMemoriesSettings, stop: threading.Event) -> bool:
    """Make one memory and its truth, whatever of them is missing; return whether the training succeeded."""
    if stop.is_set():
        raise KeyboardInterrupt
    flags = changed_flags(settings, ("n_memories", "seed", "n_epochs", "n_pb", "n_points", "n_segments"))
    (trained,) = train_many(
        load_demonstrations(), [training], NetworkSettings(n_pb=settings.n_pb), out=lambda one: _path(one, settings),
        resume=settings.resume, stop=stop, n_workers=1,
        command=" ".join(["creative-nao agent memories", *flags, f"--out {settings.out.name}"]),
    )  # fmt: skip
    if trained.memory is not None:
        name = file_stem(training)
        kept_truth(trained.memory, truth_file(settings.out, name), name, settings.n_points, settings.n_segments)
    return trained.memory is not None
