"""`creative-nao train`: turn basic actions into a memory, or into many."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

import tyro

from creative_nao import storage
from creative_nao.cli.terminal import Display, changed_flags, print_result, refuse_leftovers, remark, stopped_by_signals
from creative_nao.demonstrations import Demonstrations, load_demonstrations
from creative_nao.errors import SettingsError, TrainingError
from creative_nao.exchange import NOTHING_SAID, Reading
from creative_nao.model import (
    CONDITIONS,
    NetworkSettings,
    RecallReport,
    Trained,
    TrainingSettings,
    checkpoint_of,
    condition_settings,
    train_many,
)
from creative_nao.model.config import attempts
from creative_nao.model.training import TrainingState
from creative_nao.runtime import record
from creative_nao.schema import Count, checked


@dataclasses.dataclass(frozen=True)
class TrainSettings:
    """Train a network on basic actions and write it as a memory file; with several seeds or ratios, a folder of them.

    A checkpoint stands beside a memory while training runs; after Ctrl-C or a crash, the same command with --resume
    goes on from it and ends with the same bits as an uninterrupted run.
    """

    out: Path
    """Memory file to write, usually ending in .safetensors; with several networks, a folder for files such as
    half-0.safetensors and training.json."""
    demonstrations: Path | None = None
    """Folder of recordings in any known format, one basic action each; default: the six shipped boxing actions."""
    condition: tuple[Literal["open", "half", "closed", "auto"], ...] = ()
    """Instead of --closed-loop-ratio: `open`, `half` or `closed`, the paper's ratios; or `auto`, for recordings of any
    length, which trains again from other weights until every action comes back. Several: a network each."""
    closed_loop_ratio: tuple[float, ...] = (0.5,)
    """Share of its own prediction in the network's input: 0 open, 0.5 half closed, 1 closed loop. Several: a network
    each."""
    schedule: Literal["constant", "annealed", "random"] = "constant"
    """Ratio over the epochs: constant; annealed from 0 up; or random for each epoch, between 0 and the ratio."""
    anneal_epochs: int = 50_000
    """Epochs over which an annealed ratio rises."""
    n_epochs: int = 100_000
    """Passes over all actions, of `auto` in all attempts together; the epoch with the lowest loss is kept."""
    learning_rate: float = 0.001
    """Step size of Adam."""
    seed: tuple[int, ...] = (0,)
    """Seed of the initial weights. Several: a network each, for each ratio."""
    engine: Literal["fused", "reference"] = "fused"
    """`fused`: compiled; `reference`: torch autograd, written to be read, many times slower."""
    checkpoint_interval: int = 5000
    """Epochs from one checkpoint to the next."""
    n_workers: int | None = None
    """Networks trained at the same time, without influence on the results; default: the number of cores."""
    resume: bool = False
    """Go on from checkpoints and finished memories, if there are any."""
    json: bool = False
    """Print the figures as JSON."""
    network: NetworkSettings = dataclasses.field(default_factory=NetworkSettings)
    """Sizes and initial values of the network; the defaults are the paper's."""
    reading: Annotated[Reading, tyro.conf.OmitArgPrefixes] = NOTHING_SAID
    """What the recordings do not say about themselves."""


def run(settings: TrainSettings) -> int:
    """Train, write the memories, print how well each basic action comes back in closed loop."""
    wanted = _wanted(settings)
    many = len(wanted) > 1
    paths = {one: settings.out / f"{file_stem(one)}.safetensors" if many else settings.out for one in wanted}
    if many and settings.out.is_file():
        raise SettingsError(f"--out should name a folder for several networks, but {settings.out} is a file")
    if not many and settings.out.is_dir():
        raise SettingsError(f"--out should name a file, but {settings.out} is a folder")
    refuse_leftovers([] if settings.resume else map(checkpoint_of, paths.values()))
    demonstrations = load_demonstrations(settings.demonstrations, reading=settings.reading)
    for name, notes in demonstrations.record["notes"].items():
        remark(f"{name}: {'; '.join(notes)}")
    with Display({_label(one): one.n_epochs for one in wanted}) as display:

        def show(training: TrainingSettings, state: TrainingState) -> None:
            note = f"loss {state.loss_history[-1]:.3g}, best {state.best_loss:.3g}"
            asked = next(one for one in wanted if training in attempts(one))
            before = sum(one.n_epochs for one in attempts(asked)[: training.attempt - 1])
            display.show(_label(asked), before + state.epoch, note)

        with stopped_by_signals() as stop:
            trained = train_many(
                demonstrations,
                wanted,
                settings.network,
                out=paths.__getitem__,
                checkpoint_interval=settings.checkpoint_interval,
                resume=settings.resume,
                progress=show,
                stop=stop,
                command=_command(settings),
                n_workers=settings.n_workers,
            )
    if not many and trained[0].failure is not None:
        raise TrainingError(trained[0].failure)
    figures = [_figures(one, demonstrations) for one in trained]
    if many:
        whole = {**record(settings=dataclasses.asdict(wanted[0]), command=_command(settings)), "networks": figures}
        storage.write_text(settings.out / "training.json", json.dumps(whole, indent=2) + "\n")
    found = figures if many else {"out": os.fspath(settings.out), **figures[0]}
    lines = _lines_of_many(figures, settings) if many else _lines_of_one(figures[0], settings)
    print_result(found, lines, as_json=settings.json)
    return 0


def file_stem(training: TrainingSettings) -> str:
    """Return the name of a network's file without ending: condition and seed, such as ``half-0``."""
    if training.condition == "auto":
        return f"auto-{training.seed}"
    names = {ratio: name for name, ratio in CONDITIONS.items()}
    return f"{names.get(training.closed_loop_ratio, f'ratio{training.closed_loop_ratio:g}')}-{training.seed}"


def _label(training: TrainingSettings) -> str:
    return f"{_condition(training)}, seed {training.seed}"


def _condition(training: TrainingSettings) -> str:
    return "auto" if training.condition == "auto" else f"ratio {training.closed_loop_ratio:g}"


def _wanted(settings: TrainSettings) -> list[TrainingSettings]:
    names = ("schedule", "anneal_epochs", "n_epochs", "learning_rate", "engine")
    shared = {name: getattr(settings, name) for name in names}
    if settings.condition and settings.closed_loop_ratio != (0.5,):
        raise SettingsError("--condition and --closed-loop-ratio say the same thing: leave out one of them")
    chosen = [condition_settings(name, {}) for name in settings.condition]
    chosen = chosen or [{"closed_loop_ratio": ratio} for ratio in settings.closed_loop_ratio]
    wanted = [TrainingSettings(seed=seed, **one, **shared) for seed in settings.seed for one in chosen]
    if not wanted:
        raise SettingsError("--seed and --closed-loop-ratio should name at least one value each")
    if len(set(wanted)) < len(wanted):
        raise SettingsError("--seed, --condition and --closed-loop-ratio should not repeat a value")
    checked(Count | None, settings.n_workers, "--n-workers")
    return wanted


def _command(settings: TrainSettings) -> str:
    """Return the command that makes these memories again, without the places of this machine."""
    words = ["creative-nao train"]
    if settings.demonstrations is not None:
        words.append(f"--demonstrations {settings.demonstrations.name}")
    if settings.condition:
        words.append("--condition " + " ".join(settings.condition))
    else:
        words.append("--closed-loop-ratio " + " ".join(f"{ratio:g}" for ratio in settings.closed_loop_ratio))
    if settings.schedule != "constant":
        words.append(f"--schedule {settings.schedule}")
    words += [f"--n-epochs {settings.n_epochs}", "--seed " + " ".join(map(str, settings.seed))]
    words += changed_flags(settings, ("anneal_epochs", "learning_rate", "engine"))
    words += changed_flags(settings.network, group="network.") + changed_flags(settings.reading)
    return " ".join([*words, f"--out {settings.out.name}"])


def _figures(trained: Trained, demonstrations: Demonstrations) -> dict[str, object]:
    found: dict[str, object] = {
        "name": file_stem(trained.training),
        "condition": _condition(trained.training),
        "closed_loop_ratio": trained.training.closed_loop_ratio,
        "seed": trained.training.seed,
        "succeeded": trained.succeeded(),
        "failure": trained.failure,
    }
    if trained.memory is not None:
        recall = RecallReport.of(trained.memory)
        found |= {
            "closed_loop_ratio": trained.memory.closed_loop_ratio,
            "verdict": str(recall),
            "attempts": trained.memory.record.get("attempts", []),
            "best_loss": trained.memory.best_loss,
            "best_epoch": trained.memory.best_epoch,
            "pb": dict(zip(demonstrations.names, trained.memory.pb.tolist(), strict=True)),
            "reproduction_dtw": recall.distances,
        }
    return found


def _lines_of_one(figures: dict, settings: TrainSettings) -> Iterator[str]:
    yield f"{settings.out}: loss {figures['best_loss']:.3f} at epoch {figures['best_epoch']}"
    for name, distance in figures["reproduction_dtw"].items():
        pb = ", ".join(f"{value:+.3f}" for value in figures["pb"][name])
        yield f"  {name:<16} PB ({pb})   comes back within DTW {distance:.2f}"
    yield from _told(figures)
    yield figures["verdict"]


def _told(figures: dict) -> Iterator[str]:
    """Tell the attempts of `auto` that came before the last."""
    for one in figures["attempts"][:-1]:
        worst = one.get("failure") or f"worst DTW {max(one['reproduction_dtw'].values()):.2f}"
        yield f"  attempt {one['attempt']} of {one['n_epochs']:,} epochs: {worst}"


def _lines_of_many(figures: list[dict], settings: TrainSettings) -> Iterator[str]:
    yield f"{'network':<16} {'loss':>8} {'worst DTW':>10}  all come back"
    for row in figures:
        if row["failure"] is not None:
            yield f"{row['name']:<16} failed: {row['failure']}"
            continue
        worst = max(row["reproduction_dtw"].values())
        back = "yes" if row["succeeded"] else "no"
        yield f"{row['name']:<16} {row['best_loss']:>8.3f} {worst:>10.2f}  {back}"
    for name in dict.fromkeys(row["condition"] for row in figures):
        succeeded = [row["succeeded"] for row in figures if row["condition"] == name]
        yield f"{name}: {sum(succeeded)} of {len(succeeded)} networks give every basic action back"
    for row in figures:
        if not row["succeeded"] and row["failure"] is None:
            yield f"{row['name']}: {row['verdict']}"
    yield f"written: {settings.out}/"
