"""The open choices of the reproduction, each changed alone: other ways to score, and other ways to train.

    creative-nao evaluate paper --out runs/paper
    python studies/sensitivity.py runs/paper

The networks of a finished reproduction are scored in every other way, and a few short networks are trained in every
other way. The result, `sensitivity.json`, and its part of the page go into the same run folder.
"""

from __future__ import annotations

import dataclasses
import json
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from dtw_variants import dtw_variant_matrix

from creative_nao import storage
from creative_nao.cli.terminal import Display
from creative_nao.demonstrations import Demonstrations, load_demonstrations
from creative_nao.errors import CreativeNaoError, SettingsError
from creative_nao.evaluation.paper.bank import CONDITION_NAMES, Entry, Report, entry_of, shipped_bank, wanted_networks
from creative_nao.evaluation.paper.claims import DECIDED_BY_TABLE_I, compare, values_of
from creative_nao.evaluation.paper.page import SENSITIVITY
from creative_nao.evaluation.paper.run import finish
from creative_nao.evaluation.paper.summary import mean_with_interval
from creative_nao.evaluation.run import only_plain_files, read_record
from creative_nao.evaluation.runner import in_threads
from creative_nao.evaluation.statistics import seed_sequence
from creative_nao.exchange.motion import monotone_cubic
from creative_nao.maps import pb_grid
from creative_nao.measures import Criteria, is_appropriate
from creative_nao.measures.diversity import N_DRAWS, N_SAMPLES, draw_samples
from creative_nao.measures.outcome import PAPER_CRITERIA
from creative_nao.model import Memory, NetworkSettings, TrainingSettings, reproduction, train_many
from creative_nao.model.training import TrainingState
from creative_nao.runtime import usable_cores
from creative_nao.storage import as_json, read_text, write_json

WINDOW_TICKS = 5
"""Sakoe-Chiba window of the variant: a tenth of an action's length."""

FORMAT = 1
FIGURES = ("appropriateness_pct", "learned_pct", "novelty", "diversity")
RESCORE = "score again"


@dataclass(frozen=True)
class Scoring:
    """Another way to score the same movements.

    Attributes:
        key: Short name.
        title: What is changed.
        distance: Settings of `dtw_variant_matrix`.
        criteria: Where the lines between outcomes are drawn.
    """

    key: str
    title: str
    distance: dict[str, Any] = field(default_factory=dict)
    criteria: Criteria = PAPER_CRITERIA

    def distances(self, a: Any, b: Any) -> np.ndarray:
        """Return the distance of every trajectory of `a` to every one of `b`."""
        return dtw_variant_matrix(a, b, **self.distance)


SCORINGS = (
    Scoring("default", "the defaults"),
    Scoring("independent", "DTW: a path of its own for each joint", {"dependent": False}),
    Scoring("window", f"DTW: window of {WINDOW_TICKS} ticks", {"window": WINDOW_TICKS}),
    Scoring("normalised", "DTW: divided by the length of the path", {"normalise": True}),
    Scoring("squared", "DTW: squared cost", {"squared": True}),
    Scoring("per-joint", "speed limit: each joint its own", criteria=Criteria(per_joint=True)),
)
"""The first one is what the others are compared with."""


@dataclass(frozen=True)
class Training:
    """Another way to train.

    Attributes:
        key: Short name.
        title: What is changed.
        network: Settings of the network.
        retiming: Arguments of `retimed`, by which the taught actions become those that are learned; none by default.
    """

    key: str
    title: str
    network: NetworkSettings = field(default_factory=NetworkSettings)
    retiming: dict[str, Any] = field(default_factory=dict)

    def demonstrations(self, taught: Demonstrations) -> Demonstrations:
        """Return the actions that are learned."""
        return retimed(taught, **self.retiming) if self.retiming else taught


TRAININGS = (
    Training("default", "the defaults"),
    Training("rad2", "sigma 0.5 in rad^2", NetworkSettings(sigma_unit="rad2")),
    # What the network sees is the angle from tick to tick: this is also a movement 1.5 times as slow at 0.15 s.
    Training("tick-0.10", "tick 0.10 s, 75 ticks", retiming={"dt_s": 0.10, "n_steps": 75}),
    Training("tick-0.20", "tick 0.20 s, 38 ticks", retiming={"dt_s": 0.20, "n_steps": 38}),
    Training("slower", "1.5 times as slow, 50 ticks: two punches", retiming={"n_steps": 50, "slower": 1.5}),
    Training("pb-weights", "initial PB weights ten times as large", NetworkSettings(pb_weight_scale=1.0)),
    Training("weights", "initial weights twice as large", NetworkSettings(weight_scale=1.0)),
)
"""The first one is what the others are compared with."""


def retimed(demos: Demonstrations, *, n_steps: int, dt_s: float | None = None, slower: float = 1.0) -> Demonstrations:
    """Return the same movements at another tick or another speed.

    The recording is read anew from the monotone cubic through its postures; what lies beyond its end is the last one.

    Args:
        demos: The basic actions.
        n_steps: Postures of each action.
        dt_s: The tick [s]; default: that of the recordings.
        slower: How many times as long a movement takes.
    """
    dt_s = demos.dt_s if dt_s is None else dt_s
    wanted = dt_s * np.arange(n_steps)
    read = [
        monotone_cubic(slower * demos.dt_s * np.arange(len(trajectory)), trajectory, wanted)
        for trajectory in demos.trajectories
    ]
    record = {**demos.record, "retimed": {"dt_s": dt_s, "n_steps": n_steps, "slower": slower}}
    return dataclasses.replace(demos, trajectories=read, dt_s=dt_s, record=record)


@dataclass(frozen=True)
class SensitivitySettings:
    """How much the study costs: with these, about ten minutes on two quiet cores."""

    n_seeds: int = 3
    """Networks per way to train and condition."""
    n_epochs: int = 40_000
    """Epochs of each."""
    resolution: int = 100
    """Points along each axis of the maps."""
    seed: int = 0
    """Of the draws; networks have this seed and those after it."""
    scorings: tuple[Scoring, ...] = SCORINGS
    trainings: tuple[Training, ...] = TRAININGS
    network: NetworkSettings | None = None
    """Layers of all networks, for a study of another size; each way to train keeps what it changes."""

    def described(self) -> dict[str, Any]:
        """Return the settings as plain values."""
        return {
            "n_seeds": self.n_seeds,
            "n_epochs": self.n_epochs,
            "resolution": self.resolution,
            "seed": self.seed,
            "scorings": [one.key for one in self.scorings],
            "trainings": [one.key for one in self.trainings],
        }

    def networks(self) -> list[TrainingSettings]:
        """Return the settings of the networks that each way trains."""
        return wanted_networks(self.n_seeds, self.n_epochs, self.seed)


def learned_threshold(demos: Demonstrations, scoring: Scoring) -> float:
    """Return the distance up to which an action is learned, in the unit of the scoring's own distance.

    The paper's 10 means nothing in another unit; the same share of the mean distance between two basic actions does.
    """
    several = list(demos.trajectories)
    upper = np.triu_indices(len(several), 1)
    usual, changed = (float(one.distances(several, several)[upper].mean()) for one in (SCORINGS[0], scoring))
    return Criteria().learned_threshold * changed / usual


def rescore(
    trajectories: np.ndarray, demos: Demonstrations, scoring: Scoring, seed: int | np.random.SeedSequence
) -> dict[str, float | None]:
    """Return the four figures of Table I under another way to score: same movements, same random draws.

    Args:
        trajectories: A whole grid of generated movements [rad], shape (n, n_steps, n_joints).
        demos: The basic actions.
        scoring: The way to score.
        seed: Of the draws of novelty and diversity.

    Returns:
        Shares in %, novelty and diversity in the unit of the scoring's distance; None where nothing can be measured.
    """
    appropriate = is_appropriate(trajectories, demos, scoring.criteria)
    usable = np.flatnonzero(appropriate)
    nearest = np.full(len(trajectories), np.inf)
    if len(usable):
        nearest[usable] = scoring.distances(trajectories[usable], list(demos.trajectories)).min(axis=1)
    found: dict[str, float | None] = {
        "appropriateness_pct": 100.0 * float(appropriate.mean()),
        "learned_pct": 100.0 * float(np.mean(nearest <= learned_threshold(demos, scoring))),
        "novelty": None,
        "diversity": None,
    }
    if len(usable) > 1:
        rng = np.random.default_rng(seed)
        found["novelty"] = float(nearest[draw_samples(appropriate, rng, N_SAMPLES, N_DRAWS)].mean())
        samples = draw_samples(appropriate, rng, N_SAMPLES, N_DRAWS, at_least=2)
        upper = np.triu_indices(samples.shape[1], 1)
        apart = [scoring.distances(trajectories[sample], trajectories[sample])[upper].mean() for sample in samples]
        found["diversity"] = float(np.mean(apart))
    return found


def study_scoring(
    bank: Sequence[Entry],
    folder: Path,
    settings: SensitivitySettings,
    *,
    n_workers: int,
    report: Report = lambda *_: None,
) -> list[dict[str, Any]]:
    """Score the maps of all networks in every way; return a row of results for each way."""

    def score_all(entry: Entry) -> dict[str, dict[str, Any]]:
        memory = entry.load()
        trajectories = memory.generate(pb_grid(settings.resolution))
        return {
            one.key: rescore(trajectories, memory.demonstrations, one, seed_sequence(settings.seed, entry.name))
            for one in settings.scorings
        }

    def kept(entry: Entry) -> dict[str, dict[str, Any]]:
        job = {"memory": entry.sha256, **settings.described()}
        return _kept(folder / "sensitivity" / "scoring" / f"{entry.stem}.json", job, lambda: score_all(entry))

    found = in_threads(bank, kept, n_workers, lambda n_done, entry: report(RESCORE, n_done, entry.name))
    demos = bank[0].load().demonstrations
    rows = []
    for way in settings.scorings:
        networks = [{"condition": entry.condition, **one[way.key]} for entry, one in zip(bank, found, strict=True)]
        extra = {"learned_threshold": learned_threshold(demos, way)}
        rows.append(_row(way.key, way.title, networks, settings.seed, extra))
    return rows


def study_training(
    folder: Path,
    settings: SensitivitySettings,
    *,
    n_workers: int,
    report: Report = lambda *_: None,
    stop: threading.Event | None = None,
) -> list[dict[str, Any]]:
    """Train few networks in every way, score their maps; return a row of results for each way."""
    rows = []
    for way in settings.trainings:
        demos = way.demonstrations(load_demonstrations())
        place = folder / "sensitivity" / "training" / way.key
        entries = {training: entry_of(training, place) for training in settings.networks()}

        def show(training: TrainingSettings, state: TrainingState, key: str = way.key, entries: Any = entries) -> None:
            report(f"{key}: {entries[training].name}", state.epoch, "")

        trained = train_many(
            demos, list(entries), _network(way, settings), out=lambda training, entries=entries: entries[training].path,
            resume=True, stop=stop, progress=show, command="python studies/sensitivity.py", n_workers=n_workers,
        )  # fmt: skip
        done = [(entries[one.training], one.memory) for one in trained if one.memory is not None]

        def figures(one: tuple[Entry, Memory], demos: Demonstrations = demos) -> dict[str, Any]:
            entry, memory = one
            grid = memory.generate(pb_grid(settings.resolution))
            return {
                "condition": entry.condition,
                "gives_all_back": max(reproduction(memory)) <= SCORINGS[0].criteria.learned_threshold,
                **rescore(grid, demos, SCORINGS[0], seed_sequence(settings.seed, entry.name)),
            }

        networks = in_threads(done, figures, n_workers)
        back = {
            name: sum(one["gives_all_back"] for one in networks if one["condition"] == name) for name in CONDITION_NAMES
        }
        extra = {
            "n_failed": len(trained) - len(done),
            "dt_s": demos.dt_s,
            "n_steps": len(demos.trajectories[0]),
            "n_giving_all_back": back,
        }
        rows.append(_row(way.key, way.title, networks, settings.seed, extra))
    return rows


def epochs_of_training(settings: SensitivitySettings) -> dict[str, int]:
    """Return the epochs of each network that `study_training` trains, by the name under which it is reported."""
    names = [entry_of(training, Path()).name for training in settings.networks()]
    return {f"{way.key}: {name}": settings.n_epochs for way in settings.trainings for name in names}


def order_of(means: Mapping[str, float | None]) -> list[str]:
    """Return the conditions from the largest mean to the smallest; those without one are left out."""
    known = {name: value for name, value in means.items() if value is not None}
    return sorted(known, key=lambda name: -known[name])


def _row(
    key: str, title: str, networks: Sequence[Mapping[str, Any]], seed: int, extra: dict[str, Any]
) -> dict[str, Any]:
    """Return means with intervals per condition, the order of the means and the verdicts on the four claims."""
    figures, orders, verdicts = {}, {}, {}
    for name in FIGURES:
        values = values_of(networks, name)
        figures[name] = {
            condition: mean_with_interval(values[condition], seed, key, name, condition)
            for condition in CONDITION_NAMES
        }
        orders[name] = order_of({condition: one["mean"] if one else None for condition, one in figures[name].items()})
    for claim in DECIDED_BY_TABLE_I:
        verdict, differences = compare(values_of(networks, claim.field), claim, seed)
        verdicts[claim.key] = {"verdict": verdict, "differences": differences}
    n_seeds = {name: sum(one["condition"] == name for one in networks) for name in CONDITION_NAMES}
    return {
        "key": key, "title": title, "n_seeds": n_seeds, "figures": figures, "order": orders, "verdicts": verdicts,
        **extra,
    }  # fmt: skip


def _network(way: Training, settings: SensitivitySettings) -> NetworkSettings:
    if settings.network is None:
        return way.network
    return dataclasses.replace(
        way.network, layer_sizes=settings.network.layer_sizes, time_constants=settings.network.time_constants
    )


def _kept(path: Path, job: dict[str, Any], work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return what an earlier run kept for the same job, or do the work and keep it."""
    described = {"format": FORMAT, **job}
    try:
        kept = as_json(read_text(path, "figures of a study"), str(path))
        if kept["job"] == described:
            return kept["figures"]
    except (CreativeNaoError, KeyError, TypeError):
        pass
    figures = work()
    storage.write_text(path, json.dumps({"job": described, "figures": figures}, allow_nan=False) + "\n")
    return figures


def run_study(
    folder: Path, settings: SensitivitySettings, *, n_workers: int | None = None, watch: Any = Display
) -> dict[str, Any]:
    """Study the open choices for a finished reproduction, and add the result and its part of the page to its folder.

    Args:
        folder: Run folder of `creative-nao evaluate paper`; what an interrupted study left there is continued.
        settings: How much is trained and scored.
        n_workers: Networks at a time; default: the number of cores. Has no influence on results.
        watch: Shows progress: a context manager made from the units of work of each piece.

    Returns:
        The content of `sensitivity.json`.

    Raises:
        NotFoundError: If the folder is no finished run, or lacks a network.
        SettingsError: If it is the folder of another evaluation, or a network has changed since.
    """
    run = read_record(folder)
    only_plain_files(folder)
    if run["settings"].get("suite") != {"name": "paper"}:
        raise SettingsError(f"{folder} is no run folder of `creative-nao evaluate paper`")
    if not run.get("hashes"):
        raise SettingsError(f"{folder} is not finished; continue it with `creative-nao evaluate paper --resume`")
    bank = _bank(folder, run)
    cores = usable_cores() if n_workers is None else n_workers
    # Two displays: a network scored again and an epoch of training are no common unit of time.
    with watch({RESCORE: len(bank)}) as display:
        scoring = study_scoring(bank, folder, settings, n_workers=cores, report=display.show)
    with watch(epochs_of_training(settings)) as display:
        training = study_training(folder, settings, n_workers=cores, report=display.show)
    study = {"settings": settings.described(), "scoring": scoring, "training": training}
    write_json(folder / SENSITIVITY, study)
    finish(folder, run)
    return study


def _bank(folder: Path, run: Mapping[str, Any]) -> list[Entry]:
    shipped = {entry.name: entry for entry in shipped_bank()}
    bank = []
    for name, digest in run["memories"].items():
        condition, seed = name.split("/")
        trained = Entry(condition, int(seed), folder / "memories" / f"{condition}-{seed}.safetensors")
        entry = shipped[name] if run["settings"]["source"] == "shipped" else trained
        if entry.sha256 != digest:
            raise SettingsError(f"{folder} was made with other networks ({name} has changed since); reproduce it again")
        bank.append(entry)
    return bank


@dataclass(frozen=True)
class Arguments:
    """Change the open choices of a finished reproduction one at a time; about ten minutes on two cores."""

    folder: tyro.conf.Positional[Path]
    """Run folder of `creative-nao evaluate paper`; an interrupted study is continued there."""
    seed: int = 0
    """Seed of the draws; networks have this seed and those after it."""
    n_workers: int | None = None
    """Networks at a time, without influence on results; default: the available cores."""


def main() -> None:
    """Run the study from the command line."""
    asked = tyro.cli(Arguments, prog="python studies/sensitivity.py")
    try:
        run_study(asked.folder, SensitivitySettings(seed=asked.seed), n_workers=asked.n_workers)
    except CreativeNaoError as error:
        raise SystemExit(f"error: {error}") from None
    print(f"study: {asked.folder / 'sensitivity.json'}, page: {asked.folder / 'reproduction.md'}")


if __name__ == "__main__":
    main()
