"""The networks of a reproduction: the shipped bank, or networks trained in the run folder."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from creative_nao.demonstrations import load_demonstrations
from creative_nao.errors import TrainingError
from creative_nao.evaluation.paper.settings import PaperSettings
from creative_nao.model import CONDITIONS, Memory, TrainingSettings, shipped_memories, train_many
from creative_nao.model.engine import TrainingState
from creative_nao.model.shipped import PRETRAINED
from creative_nao.provenance import sha256

Report = Callable[[str, int, str], None]
"""Takes the name of a piece of work, how many of its units are done, and a note."""


@dataclass(frozen=True)
class Entry:
    """A network of the reproduction.

    Attributes:
        condition: `open`, `half` or `closed`.
        seed: Seed of its initial weights.
        path: Its memory file.
    """

    condition: str
    seed: int
    path: Path

    @property
    def name(self) -> str:
        """Condition and seed, such as ``half/0``."""
        return f"{self.condition}/{self.seed}"

    @property
    def stem(self) -> str:
        """The name as it stands in file names, such as ``half-0``."""
        return f"{self.condition}-{self.seed}"

    @property
    def sha256(self) -> str:
        """Hash of the memory file."""
        return sha256(self.path)

    def load(self) -> Memory:
        """Read the memory."""
        return Memory.read(self.path, name=self.name)


def shipped_bank() -> list[Entry]:
    """Return the memories that ship with the package, as many as there are, in order of condition and seed."""
    pairs = [name.split("/") for name in shipped_memories()]
    return [Entry(condition, int(seed), PRETRAINED / f"{condition}-{seed}.safetensors") for condition, seed in pairs]


def wanted_networks(settings: PaperSettings) -> list[TrainingSettings]:
    """Return the settings of all networks to be trained; those of one seed begin with the same weights."""
    return [
        TrainingSettings(closed_loop_ratio=ratio, n_epochs=settings.n_epochs, seed=settings.seed + place)
        for place in range(settings.n_seeds)
        for ratio in CONDITIONS.values()
    ]


def label(training: TrainingSettings) -> str:
    """Return the name of a network to be trained, such as ``half/0``."""
    condition = next(name for name, ratio in CONDITIONS.items() if ratio == training.closed_loop_ratio)
    return f"{condition}/{training.seed}"


def train_bank(
    folder: Path,
    settings: PaperSettings,
    *,
    n_workers: int | None = None,
    report: Report = lambda *_: None,
    stop: threading.Event | None = None,
) -> tuple[list[Entry], dict[str, str]]:
    """Train the networks of a run folder, or go on with those begun there.

    Args:
        folder: Run folder; memories and checkpoints go to its subfolder `memories`.
        settings: How many and how long.
        n_workers: Networks at a time; default: the number of cores.
        report: Called with a network's name, its epoch and its loss.
        stop: When set, checkpoints are saved and KeyboardInterrupt is raised.

    Returns:
        The networks in order of condition and seed, and why others failed, by name.

    Raises:
        TrainingError: If every network of a condition failed.
    """

    def path(training: TrainingSettings) -> Path:
        return folder / "memories" / f"{label(training).replace('/', '-')}.safetensors"

    def show(training: TrainingSettings, state: TrainingState) -> None:
        report(label(training), state.epoch, f"loss {state.loss_history[-1]:.3g}")

    wanted = wanted_networks(settings)
    trained = train_many(
        load_demonstrations(), wanted, settings.network, out=path, resume=True, progress=show, stop=stop,
        command=f"creative-nao evaluate paper --{settings.source} --seed {settings.seed}", n_workers=n_workers,
    )  # fmt: skip
    failures = {label(one.training): one.failure for one in trained if one.failure is not None}
    done = [one.training for one in trained if one.memory is not None]
    entries = [Entry(label(one).split("/")[0], one.seed, path(one)) for one in done]
    missing = [name for name in CONDITIONS if name not in {entry.condition for entry in entries}]
    if missing:
        raise TrainingError(
            f"no network of the condition {missing[0]} could be trained: {next(iter(failures.items()))}"
        )
    return sorted(entries, key=lambda entry: (list(CONDITIONS).index(entry.condition), entry.seed)), failures
