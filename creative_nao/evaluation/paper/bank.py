"""What is reproduced, and its networks: the shipped bank, or networks trained in the run folder."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from creative_nao.demonstrations import load_demonstrations
from creative_nao.errors import NotFoundError, SettingsError, TrainingError
from creative_nao.model import CONDITIONS, Memory, NetworkSettings, TrainingSettings, shipped_memories, train_many
from creative_nao.model.memory import content_sha256, shipped_file
from creative_nao.model.training import TrainingState
from creative_nao.schema import Count, Field, Index, record

CONDITION_NAMES = tuple(CONDITIONS)  # `open`, `half`, `closed`: closed-loop ratio 0, 0.5 and 1

Report = Callable[[str, int, str], None]
"""Takes the name of a piece of work, how many of its units are done, and a note."""


@record
class PaperSettings:
    """What is reproduced."""

    source: Literal["shipped", "retrain", "quick"] = "shipped"
    """`shipped`: the bank of the package; `retrain`: networks trained in the run folder; `quick`: few and short."""
    seed: Index = 0
    """Seed of all draws; networks that are trained have this seed and those after it."""
    n_seeds: Count = 10
    """Networks trained per condition; has no meaning for the shipped ones."""
    n_epochs: Count = 100_000
    """Epochs of each; has no meaning for the shipped ones."""
    resolution: Annotated[int, Field(ge=2)] = 200
    """Points along each axis of a map."""
    network: NetworkSettings = field(default_factory=NetworkSettings)
    """Network that is trained; has no meaning for the shipped ones."""


def paper_settings(*, quick: bool = False, retrain: bool = False, seed: int = 0) -> PaperSettings:
    """Return the settings that the command's flags ask for; SettingsError if they are both `quick` and `retrain`."""
    if quick and retrain:
        raise SettingsError("--quick trains its own few networks; leave out --retrain, or --quick")
    if quick:
        return PaperSettings("quick", seed, n_seeds=3, n_epochs=20_000)
    return PaperSettings("retrain" if retrain else "shipped", seed)


@dataclass(frozen=True)
class Entry:
    """A network of the reproduction: its condition, the seed of its initial weights, and its memory file."""

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
        """Hash of the memory file without the digests in its header, as release 0.1.0 wrote it."""
        return content_sha256(self.path)

    def load(self) -> Memory:
        """Read the memory."""
        return Memory.read(self.path, name=self.name)


def shipped_bank() -> list[Entry]:
    """Return the memories that ship with the package, by condition and seed; NotFoundError if a condition has none."""
    pairs = [name.split("/") for name in shipped_memories()]
    bank = [Entry(condition, int(seed), shipped_file(f"{condition}/{seed}")) for condition, seed in pairs]
    if missing := _missing_condition(bank):
        raise NotFoundError(f"no memory of the condition `{missing}` ships with this installation; add --retrain")
    return bank


def wanted_networks(n_seeds: int, n_epochs: int, seed: int) -> list[TrainingSettings]:
    """Return the settings of `n_seeds` networks to be trained in each condition, with `seed` and those after it.

    Those of one seed begin with the same weights.
    """
    return [
        TrainingSettings(closed_loop_ratio=ratio, n_epochs=n_epochs, seed=seed + place)
        for place in range(n_seeds)
        for ratio in CONDITIONS.values()
    ]


def entry_of(training: TrainingSettings, folder: Path) -> Entry:
    """Return the entry of a network to be trained, whose memory is to be written into `folder`."""
    condition = next(name for name, ratio in CONDITIONS.items() if ratio == training.closed_loop_ratio)
    return Entry(condition, training.seed, folder / f"{condition}-{training.seed}.safetensors")


def train_bank(
    folder: Path,
    settings: PaperSettings,
    *,
    n_workers: int | None = None,
    report: Report = lambda *_: None,
    stop: threading.Event | None = None,
) -> tuple[list[Entry], dict[str, str]]:
    """Train the networks of a run folder, or continue those begun there.

    Memories and checkpoints go to the subfolder `memories`. Up to `n_workers` networks train at a time, by default the
    number of cores. When `stop` is set, checkpoints are saved and KeyboardInterrupt is raised.
    Returned are the networks in order of condition and seed, and why others failed, by name.

    Raises:
        TrainingError: If every network of a condition failed.
    """
    wanted = wanted_networks(settings.n_seeds, settings.n_epochs, settings.seed)
    entries = {training: entry_of(training, folder / "memories") for training in wanted}

    def show(training: TrainingSettings, state: TrainingState) -> None:
        report(entries[training].name, state.epoch, f"loss {state.loss_history[-1]:.3g}")

    trained = train_many(
        load_demonstrations(), wanted, settings.network, out=lambda training: entries[training].path, resume=True,
        progress=show, stop=stop, n_workers=n_workers,
        command=f"creative-nao evaluate paper --{settings.source} --seed {settings.seed}",
    )  # fmt: skip
    failures = {entries[one.training].name: one.failure for one in trained if one.failure is not None}
    bank = [entries[one.training] for one in trained if one.memory is not None]
    if missing := _missing_condition(bank):
        raise TrainingError(f"no network of the condition {missing} could be trained: {next(iter(failures.items()))}")
    return sorted(bank, key=lambda entry: (CONDITION_NAMES.index(entry.condition), entry.seed)), failures


def _missing_condition(bank: list[Entry]) -> str | None:
    return next((name for name in CONDITION_NAMES if name not in {entry.condition for entry in bank}), None)
