"""`creative-nao agent memories`: train memories, and score spread points of each, for agents that learn from them."""

from __future__ import annotations

import dataclasses
import threading
from collections import Counter
from pathlib import Path
from typing import Annotated, Any

from creative_nao.agents.learned_map.truth import N_POINTS, MemoryTruth, kept_truth, truth_file
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
    n_workers = usable_cores() if settings.n_workers is None else checked(Count, settings.n_workers, "--n-workers")
    if checked(Index, settings.seed, "--seed") < FIRST_SEED:
        raise SettingsError(
            f"--seed should be at least {FIRST_SEED}, but is {settings.seed}: lower ones are the bank's"
        )
    if settings.out.is_file():
        raise SettingsError(f"--out should name a folder, but {settings.out} is a file")
    ratios = [*CONDITIONS.values()]
    wanted = [
        TrainingSettings(closed_loop_ratio=ratios[k % 3], seed=settings.seed + k // 3, n_epochs=settings.n_epochs)
        for k in range(settings.n_memories)
    ]
    paths = {one: settings.out / f"{file_stem(one)}.safetensors" for one in wanted}
    truths = {one: truth_file(settings.out, file_stem(one)) for one in wanted}
    if not settings.resume:
        refuse_leftovers([*paths.values(), *map(checkpoint_of, paths.values()), *truths.values()])
    with Display({"memories": settings.n_memories}) as display, stopped_by_signals() as stop:
        found = in_threads(
            wanted,
            lambda one: _make(one, settings, paths[one], truths[one], stop),
            n_workers,
            lambda n_done, one: display.show("memories", n_done, file_stem(one)),
        )
    counts = Counter(one is None for one in found)
    shares = [float(truth.appropriate.mean()) for truth in found if truth is not None]
    figures: dict[str, Any] = {
        "out": str(settings.out),
        "n_memories": counts[False],
        "n_failed": counts[True],
        "appropriate_pct": 100.0 * sum(shares) / len(shares) if shares else None,
    }
    lines = [f"{settings.out}: {counts[False]} memories with their truth, {counts[True]} failed in training"]
    if shares:
        lines.append(f"appropriate on average: {figures['appropriate_pct']:.1f} % of the points")
    print_result(figures, lines, as_json=settings.json)
    return 0


def _command(settings: AgentMemoriesSettings) -> str:
    words = changed_flags(settings, ("n_memories", "seed", "n_epochs", "n_pb", "n_points"))
    return " ".join(["creative-nao agent memories", *words, f"--out {settings.out.name}"])


def _make(
    training: TrainingSettings, settings: AgentMemoriesSettings, path: Path, truth_path: Path, stop: threading.Event
) -> MemoryTruth | None:
    """Make one memory and its truth, whatever of them is missing; None where the training fails."""
    if stop.is_set():
        raise KeyboardInterrupt
    (trained,) = train_many(
        load_demonstrations(), [training], NetworkSettings(n_pb=settings.n_pb), out=lambda _: path,
        resume=settings.resume, stop=stop, command=_command(settings), n_workers=1,
    )  # fmt: skip
    if trained.memory is None:
        return None
    return kept_truth(trained.memory, truth_path, file_stem(training), settings.n_points)
