"""The networks of a reproduction: the shipped bank, or networks trained in the run folder.

Also here:
- Settings of a reproduction: where its networks come from and how finely their maps are scored.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from creative_nao.demonstrations import load_demonstrations
from creative_nao.errors import SettingsError, TrainingError
from creative_nao.model import CONDITIONS, Memory, NetworkSettings, TrainingSettings, shipped_memories, train_many
from creative_nao.model.memory import PRETRAINED
from creative_nao.model.training import TrainingState
from creative_nao.runtime import sha256

Source = Literal["shipped", "retrain", "quick"]


@dataclass(frozen=True)
class PaperSettings:
    """What is reproduced.

    Raises:
        SettingsError: If a count is too small; the message names the field.
    """

    source: Source = "shipped"
    """`shipped`: the bank of the package; `retrain`: networks trained in the run folder; `quick`: few and short."""
    seed: int = 0
    """Seed of all draws; networks that are trained have this seed and those after it."""
    n_seeds: int = 10
    """Networks trained per condition; has no meaning for the shipped ones."""
    n_epochs: int = 100_000
    """Epochs of each; has no meaning for the shipped ones."""
    resolution: int = 200
    """Points along each axis of a map."""
    network: NetworkSettings = field(default_factory=NetworkSettings)
    """Network that is trained; has no meaning for the shipped ones."""

    def __post_init__(self) -> None:
        for name, least in {"seed": 0, "n_seeds": 1, "n_epochs": 1, "resolution": 2}.items():
            if getattr(self, name) < least:
                raise SettingsError(f"`{name}` should be at least {least}, but is {getattr(self, name)}")

    @property
    def trains(self) -> bool:
        """Whether networks are trained for it."""
        return self.source != "shipped"


QUICK_SEEDS, QUICK_EPOCHS = 3, 20_000


def paper_settings(*, quick: bool = False, retrain: bool = False, seed: int = 0) -> PaperSettings:
    """Return the settings that the command's flags ask for.

    Raises:
        SettingsError: If both `quick` and `retrain` are asked for.
    """
    if quick and retrain:
        raise SettingsError("--quick trains its own few networks; leave out --retrain, or --quick")
    if quick:
        return PaperSettings("quick", seed, QUICK_SEEDS, QUICK_EPOCHS)
    return PaperSettings("retrain" if retrain else "shipped", seed)


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
