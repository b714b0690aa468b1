"""`creative-nao train`: turn basic actions into a memory."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import threading
from pathlib import Path
from typing import Literal

from creative_nao.cli.progress import Display
from creative_nao.demonstrations import load_demonstrations
from creative_nao.errors import SettingsError
from creative_nao.measures import Criteria, dtw
from creative_nao.model import Memory, NetworkSettings, TrainingSettings, train_network
from creative_nao.model.engine import TrainingState


@dataclasses.dataclass(frozen=True)
class TrainSettings:
    """Train a network on basic actions and write it as a memory file.

    A checkpoint stands beside the memory while training runs; after Ctrl-C or a crash, the same command with --resume
    goes on from it and ends with the same bits as an uninterrupted run.
    """

    out: Path
    """Memory file to write, usually ending in .safetensors."""
    demonstrations: Path | None = None
    """Folder of CSV recordings, one basic action each; default: the six shipped boxing actions."""
    closed_loop_ratio: float = 0.5
    """Share of its own prediction in the network's input: 0 open, 0.5 half closed, 1 closed loop."""
    n_epochs: int = 100_000
    """Passes over all actions; the epoch with the lowest loss is kept."""
    learning_rate: float = 0.001
    """Step size of Adam."""
    seed: int = 0
    """Seed of the initial weights."""
    engine: Literal["fused", "reference"] = "fused"
    """`fused`: compiled; `reference`: torch autograd, written to be read, many times slower."""
    checkpoint_interval: int = 5000
    """Epochs from one checkpoint to the next."""
    resume: bool = False
    """Go on from the checkpoint beside --out, if there is one."""
    json: bool = False
    """Print the figures as JSON."""
    network: NetworkSettings = dataclasses.field(default_factory=NetworkSettings)
    """Sizes and initial values of the network; the defaults are the paper's."""


def run(settings: TrainSettings) -> int:
    """Train, write the memory, print how well each basic action comes back in closed loop."""
    training = TrainingSettings(
        closed_loop_ratio=settings.closed_loop_ratio,
        n_epochs=settings.n_epochs,
        learning_rate=settings.learning_rate,
        seed=settings.seed,
        engine=settings.engine,
    )
    if settings.out.is_dir():
        raise SettingsError(f"--out should name a file, but {settings.out} is a folder")
    demonstrations = load_demonstrations(settings.demonstrations)
    checkpoint = settings.out.with_name(f"{settings.out.name}.checkpoint")
    if checkpoint.exists() and not settings.resume:
        raise SettingsError(
            f"{checkpoint} is left from an earlier run; go on from it with --resume, or remove it to begin anew"
        )
    stop = threading.Event()
    with Display(f"ratio {training.closed_loop_ratio:g}, seed {training.seed}", training.n_epochs) as display:

        def show(_: TrainingSettings, state: TrainingState) -> None:
            display.show(state.epoch, f"loss {state.loss_history[-1]:.3g}, best {state.best_loss:.3g}")

        with _stopped_by_signals(stop):
            memory = train_network(
                demonstrations,
                training,
                settings.network,
                checkpoint=checkpoint,
                checkpoint_interval=settings.checkpoint_interval,
                resume=settings.resume,
                progress=show,
                stop=stop,
                command=_command(settings),
            )
    memory.save(settings.out)
    checkpoint.unlink(missing_ok=True)
    _report(memory, settings)
    return 0


class _stopped_by_signals:  # noqa: N801 - used like a function
    """While inside, SIGINT and SIGTERM set an event, so that training ends between two epochs with a checkpoint."""

    def __init__(self, stop: threading.Event) -> None:
        self._stop = stop

    def __enter__(self) -> None:
        self._before = {
            number: signal.signal(number, lambda *_: self._stop.set()) for number in (signal.SIGINT, signal.SIGTERM)
        }

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)


def _command(settings: TrainSettings) -> str:
    """Return the command that makes this memory again, without the places of this machine."""
    words = ["creative-nao train"]
    if settings.demonstrations is not None:
        words.append(f"--demonstrations {settings.demonstrations.name}")
    words += [f"--closed-loop-ratio {settings.closed_loop_ratio:g}", f"--n-epochs {settings.n_epochs}"]
    words += [f"--seed {settings.seed}", f"--out {settings.out.name}"]
    return " ".join(words)


def _report(memory: Memory, settings: TrainSettings) -> None:
    basic = memory.demonstrations
    distances = [dtw(a, b) for a, b in zip(memory.generate(memory.pb), basic.trajectories, strict=True)]
    threshold = Criteria().learned_threshold
    n_back = sum(distance <= threshold for distance in distances)
    if settings.json:
        figures = {
            "out": os.fspath(settings.out),
            "best_loss": memory.best_loss,
            "best_epoch": memory.best_epoch,
            "pb": dict(zip(basic.names, memory.pb.tolist(), strict=True)),
            "reproduction_dtw": dict(zip(basic.names, distances, strict=True)),
        }
        print(json.dumps(figures))  # noqa: T201 - the command's output
        return
    print(f"{settings.out}: loss {memory.best_loss:.3f} at epoch {memory.best_epoch}")  # noqa: T201
    for name, pb, distance in zip(basic.names, memory.pb, distances, strict=True):
        place = ", ".join(f"{value:+.3f}" for value in pb)
        print(f"  {name:<16} PB ({place})   comes back within DTW {distance:.2f}")  # noqa: T201
    print(f"{n_back} of {len(distances)} basic actions come back within DTW {threshold:g} in closed loop")  # noqa: T201
