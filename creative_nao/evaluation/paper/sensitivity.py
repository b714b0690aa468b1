"""The open choices of the reproduction, each changed alone: other ways to score, and other ways to train.

Also here:
- The four figures of Table I under another way to score: same movements, same random draws.
- Which conclusions depend on which open choice: one choice changed at a time, everything else as it is.
- What the study of the open choices says: tables, and sentences about what depends on what.
"""

from __future__ import annotations

import dataclasses
import json
import threading
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao import storage
from creative_nao.demonstrations import Demonstrations, load_demonstrations
from creative_nao.demonstrations.resampling import monotone_cubic
from creative_nao.errors import CreativeNaoError
from creative_nao.evaluation.paper.bank import Entry, Report, label
from creative_nao.evaluation.paper.blocks import SIGN, Block, Bullets, Heading, Table, Text, by_condition, listed, order
from creative_nao.evaluation.paper.claims import CLAIMS, Order, compare
from creative_nao.evaluation.paper.comparisons import (
    CONDITION_NAMES,
    FAILS,
    HOLDS,
    UNDECIDED,
    mean_with_interval,
    values_of,
)
from creative_nao.evaluation.paper.threads import in_threads
from creative_nao.maps import pb_grid
from creative_nao.measures import Criteria, is_appropriate
from creative_nao.measures.diversity import N_DRAWS, N_SAMPLES, draw_samples
from creative_nao.measures.dtw import dtw_variant_matrix
from creative_nao.measures.outcome import PAPER_CRITERIA
from creative_nao.model import CONDITIONS, Memory, NetworkSettings, TrainingSettings, reproduction, train_many
from creative_nao.storage import as_json, read_text

WINDOW_TICKS = 5
"""Sakoe-Chiba window of the variant: a tenth of an action's length."""


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


def _same(demos: Demonstrations) -> Demonstrations:
    return demos


@dataclass(frozen=True)
class Training:
    """Another way to train.

    Attributes:
        key: Short name.
        title: What is changed.
        network: Settings of the network.
        demonstrations: Turns the taught actions into those that are learned.
    """

    key: str
    title: str
    network: NetworkSettings = field(default_factory=NetworkSettings)
    demonstrations: Callable[[Demonstrations], Demonstrations] = _same


def retimed(demos: Demonstrations, *, dt_s: float, n_steps: int, slower: float = 1.0) -> Demonstrations:
    """Return the same movements at another tick or another speed.

    The recording is read anew from the monotone cubic through its postures; what lies beyond its end is the last one.

    Args:
        demos: The basic actions.
        dt_s: The tick [s].
        n_steps: Postures of each action.
        slower: How many times as long a movement takes.
    """
    wanted = dt_s * np.arange(n_steps)
    read = [
        monotone_cubic(slower * demos.dt_s * np.arange(len(trajectory)), trajectory, wanted)
        for trajectory in demos.trajectories
    ]
    record = {**demos.record, "retimed": {"dt_s": dt_s, "n_steps": n_steps, "slower": slower}}
    return dataclasses.replace(demos, trajectories=read, dt_s=dt_s, record=record)


def _tick_010(demos: Demonstrations) -> Demonstrations:
    return retimed(demos, dt_s=0.10, n_steps=75)


def _tick_020(demos: Demonstrations) -> Demonstrations:
    return retimed(demos, dt_s=0.20, n_steps=38)


def _slower(demos: Demonstrations) -> Demonstrations:
    return retimed(demos, dt_s=demos.dt_s, n_steps=50, slower=1.5)


TRAININGS = (
    Training("default", "the defaults"),
    Training("rad2", "sigma 0.5 in rad^2", NetworkSettings(sigma_unit="rad2")),
    # What the network sees is the angle from tick to tick: this is also a movement 1.5 times as slow at 0.15 s.
    Training("tick-0.10", "tick 0.10 s, 75 ticks", demonstrations=_tick_010),
    Training("tick-0.20", "tick 0.20 s, 38 ticks", demonstrations=_tick_020),
    Training("slower", "1.5 times as slow, 50 ticks: two punches", demonstrations=_slower),
    Training("pb-weights", "initial PB weights ten times as large", NetworkSettings(pb_weight_scale=1.0)),
    Training("weights", "initial weights twice as large", NetworkSettings(weight_scale=1.0)),
)
"""The first one is what the others are compared with."""


FIGURES = ("appropriateness_pct", "learned_pct", "novelty", "diversity")


def learned_threshold(demos: Demonstrations, scoring: Scoring) -> float:
    """Return the distance up to which an action is learned, in the unit of the scoring's own distance.

    The paper's 10 means nothing in another unit; the same share of the mean distance between two basic actions does.
    """
    several = list(demos.trajectories)
    upper = np.triu_indices(len(several), 1)
    usual, changed = (float(one.distances(several, several)[upper].mean()) for one in (SCORINGS[0], scoring))
    return Criteria().learned_threshold * changed / usual


def rescore(
    trajectories: np.ndarray, demos: Demonstrations, scoring: Scoring, seed: int | list[int]
) -> dict[str, float | None]:
    """Return the four figures.

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


FORMAT = 1
CLAIM_KEYS = ("half-novel", "half-diverse", "closed-appropriate", "closed-like-training")
"""Of the claims, those that Table I decides: one for each of the four figures."""


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


def study_scoring(
    bank: Sequence[Entry],
    folder: Path,
    settings: SensitivitySettings,
    *,
    n_workers: int,
    report: Report = lambda *_: None,
) -> list[dict[str, Any]]:
    """Score the maps of all networks in every way; return a row of results for each way."""

    def one(entry: Entry) -> dict[str, dict[str, Any]]:
        memory = entry.load()
        job = {"memory": entry.sha256, **settings.described()}
        path = folder / "sensitivity" / "scoring" / f"{entry.stem}.json"
        return _kept(path, job, lambda: _score_all(memory, entry.name, settings))

    found = in_threads(bank, one, n_workers, lambda done, entry: report(RESCORE, done, entry.name))
    return [
        _row(
            scoring.key,
            scoring.title,
            [
                {"condition": entry.condition, **figures[scoring.key]}
                for entry, figures in zip(bank, found, strict=True)
            ],
            settings.seed,
            {"learned_threshold": learned_threshold(bank[0].load().demonstrations, scoring)},
        )
        for scoring in settings.scorings
    ]


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

        def path(training: TrainingSettings, place: Path = place) -> Path:
            return place / f"{label(training).replace('/', '-')}.safetensors"

        trained = train_many(
            demos, networks_of(settings), _network(way, settings), out=path, resume=True, stop=stop,
            progress=lambda training, state, way=way: report(f"{way.key}: {label(training)}", state.epoch, ""),
            command="creative-nao evaluate paper --sensitivity", n_workers=n_workers,
        )  # fmt: skip
        done = [one for one in trained if one.memory is not None]

        def figures(one: Any, demos: Demonstrations = demos) -> dict[str, Any]:
            return _figures_of_trained(one.memory, label(one.training), demos, settings)

        networks = in_threads(done, figures, n_workers, lambda *_: None)
        extra = {
            "n_failed": len(trained) - len(done),
            "dt_s": demos.dt_s,
            "n_steps": len(demos.trajectories[0]),
            "n_giving_all_back": {
                name: sum(one["gives_all_back"] for one in networks if one["condition"] == name)
                for name in CONDITION_NAMES
            },
        }
        rows.append(_row(way.key, way.title, networks, settings.seed, extra))
    return rows


RESCORE = "score again"


def epochs_of_training(settings: SensitivitySettings) -> dict[str, int]:
    """Return the epochs of each network that `study_training` trains, by the name under which it is reported."""
    return {
        f"{way.key}: {label(one)}": settings.n_epochs for way in settings.trainings for one in networks_of(settings)
    }


def networks_of(settings: SensitivitySettings) -> list[TrainingSettings]:
    """Return the settings of the networks that each way trains."""
    return [
        TrainingSettings(closed_loop_ratio=ratio, n_epochs=settings.n_epochs, seed=settings.seed + place)
        for place in range(settings.n_seeds)
        for ratio in CONDITIONS.values()
    ]


def order_of(means: Mapping[str, float | None]) -> list[str]:
    """Return the conditions from the largest mean to the smallest; those without one are left out."""
    known = {name: value for name, value in means.items() if value is not None}
    return sorted(known, key=lambda name: -known[name])


def _score_all(memory: Memory, name: str, settings: SensitivitySettings) -> dict[str, Any]:
    trajectories = memory.generate(pb_grid(settings.resolution))
    stream = [settings.seed, zlib.crc32(name.encode())]
    return {one.key: rescore(trajectories, memory.demonstrations, one, stream) for one in settings.scorings}


def _figures_of_trained(
    memory: Memory, name: str, demos: Demonstrations, settings: SensitivitySettings
) -> dict[str, Any]:
    stream = [settings.seed, zlib.crc32(name.encode())]
    figures = rescore(memory.generate(pb_grid(settings.resolution)), demos, SCORINGS[0], stream)
    threshold = SCORINGS[0].criteria.learned_threshold
    return {"condition": name.split("/")[0], "gives_all_back": max(reproduction(memory)) <= threshold, **figures}


def _row(
    key: str, title: str, networks: Sequence[Mapping[str, Any]], seed: int, extra: dict[str, Any]
) -> dict[str, Any]:
    """Return means with intervals per condition, the order of the means and the verdicts on the four claims."""
    figures, orders = {}, {}
    for row in FIGURES:
        values = values_of(networks, row)
        figures[row] = {name: mean_with_interval(values[name], [seed, key, row, name]) for name in CONDITION_NAMES}
        orders[row] = order_of({name: one["mean"] if one else None for name, one in figures[row].items()})
    verdicts = {}
    for claim in CLAIMS:
        if isinstance(claim, Order) and claim.key in CLAIM_KEYS:
            verdict, differences = compare(values_of(networks, claim.field), claim, seed)
            verdicts[claim.key] = {"verdict": verdict, "differences": [dataclasses.asdict(one) for one in differences]}
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


def _kept(path: Path, job: dict[str, Any], work: Any) -> Any:
    """Return what an earlier run kept for the same job, or do the work and keep it."""
    described = json.loads(json.dumps({"format": FORMAT, **job}))
    try:
        found = as_json(read_text(path, "figures of a study"), str(path))
        if found["job"] == described:
            return found["figures"]
    except (CreativeNaoError, KeyError, TypeError):
        pass
    figures = work()
    storage.write_text(path, json.dumps({"job": described, "figures": figures}, allow_nan=False) + "\n")
    return figures


TITLES = {
    "appropriateness_pct": "appropriate [%]",
    "learned_pct": "learned [%]",
    "novelty": "novelty",
    "diversity": "diversity",
}
JUDGED = [claim for claim in CLAIMS if isinstance(claim, Order) and claim.key in CLAIM_KEYS]
SHORT = {
    "half-novel": "half most novel",
    "half-diverse": "half most diverse",
    "closed-appropriate": "closed most appropriate",
    "closed-like-training": "closed most learned",
}


def blocks(study: Mapping[str, Any]) -> list[Block]:
    """Return the part of the page about the study."""
    settings = study["settings"]
    epochs, side, seeds = settings["n_epochs"], settings["resolution"], settings["n_seeds"]
    rule = f"Means of {' / '.join(CONDITION_NAMES)}, {side} x {side} points of each map."
    return [
        Heading("What depends on which open choice"),
        Text(
            "The paper leaves choices open; [decisions.md](decisions.md) lists ours. Here each is changed alone. The "
            "tables give the four figures, the order of the means, and the verdicts on the four claims that Table I "
            "decides, by the same rule as above."
        ),
        Heading("Other ways to score the same movements", 3),
        Text(
            f"All networks of this page. {rule} Where the distance has another unit, so have novelty and diversity, "
            "and an action is learned up to the same share of the mean distance between two basic actions as 10 is by "
            "default."
        ),
        _figures_table(study["scoring"]),
        _verdict_table(study["scoring"]),
        Heading("Other ways to train", 3),
        Text(
            f"{seeds} networks per row and condition, {epochs:,} epochs. {rule} The first row is the default trained "
            "as few and as short; with so few networks only large differences are decided. Another tick and another "
            "speed are read from the same recordings by a monotone cubic; a distance is summed over ticks, so that it "
            "grows with their number while the threshold of 10 stays. A network sees nothing but the change "
            "of angle from tick to tick: movements 1.5 times as slow at 0.15 s are the row of 0.10 s."
        ),
        _figures_table(study["training"]),
        _verdict_table(study["training"], with_back=True),
        Bullets(tuple(findings(study))),
    ]


def findings(study: Mapping[str, Any], only_changing: bool = False) -> list[str]:
    """Return in sentences which conclusions change with which choice.

    Args:
        study: Content of `sensitivity.json`.
        only_changing: Leave out the conclusions whose verdict is the same in every way.
    """
    few = f"{study['settings']['n_seeds']} short networks each"
    return [
        *_told(study["scoring"], "however it is scored", "depends on how it is scored", only_changing),
        *_told(
            study["training"], f"however it is trained ({few})", f"depends on how it is trained ({few})", only_changing
        ),
    ]


def _told(rows: Sequence[Mapping[str, Any]], steady: str, depends: str, only_changing: bool) -> list[str]:
    lines = []
    for claim in JUDGED:
        found = {row["title"]: row["verdicts"][claim.key]["verdict"] for row in rows}
        first = claim.pairs[0][0]
        n_first = sum(row["order"][claim.field][:1] == [first] for row in rows)
        means = f"{first} has the largest mean in {n_first} of {len(rows)} ways"
        if len(set(found.values())) == 1:
            if not only_changing:
                lines.append(f"'{claim.says}' {steady}: {next(iter(found.values()))}; {means}.")
            continue
        parts = [
            f"{verdict} with {listed([title for title, one in found.items() if one == verdict])}"
            for verdict in (HOLDS, FAILS, UNDECIDED)
            if verdict in found.values()
        ]
        lines.append(f"'{claim.says}' {depends}: {'; '.join(parts)}. {means[0].upper()}{means[1:]}.")
    return lines


def _figures_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    body = []
    for row in rows:
        cells = [
            by_condition({name: one["mean"] if one else None for name, one in row["figures"][field].items()})
            for field in FIGURES
        ]
        body.append((row["title"], *cells))
    return Table(("changed", *(TITLES[field] for field in FIGURES)), tuple(body))


def _verdict_table(rows: Sequence[Mapping[str, Any]], with_back: bool = False) -> Table:
    body = []
    for row in rows:
        cells = [
            f"{order(row['order'][field])}<br>{SIGN[row['verdicts'][key]['verdict']]}"
            for field, key in zip(
                ("novelty", "diversity", "appropriateness_pct", "learned_pct"), CLAIM_KEYS, strict=True
            )
        ]
        if with_back:
            cells.append(
                " / ".join(f"{row['n_giving_all_back'][name]} of {row['n_seeds'][name]}" for name in CONDITION_NAMES)
            )
        body.append((row["title"], *cells))
    head = ["changed", *(SHORT[key] for key in CLAIM_KEYS), *(["give all six back"] if with_back else [])]
    return Table(tuple(head), tuple(body), left=tuple(range(len(head))))
