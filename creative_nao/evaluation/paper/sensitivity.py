"""Which conclusions depend on which open choice: one choice changed at a time, everything else as it is.

Ways to score are tried on all networks of the reproduction. Ways to train need networks of their own: few and shorter
ones, compared with a default trained just as few and as short, not with the reproduction.
"""

from __future__ import annotations

import dataclasses
import json
import threading
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from creative_nao import atomic
from creative_nao.demonstrations import Demonstrations, load_demonstrations
from creative_nao.errors import CreativeNaoError
from creative_nao.evaluation.paper.bank import Entry, Report, label
from creative_nao.evaluation.paper.claims import CLAIMS, Order, compare
from creative_nao.evaluation.paper.reference import CONDITION_NAMES
from creative_nao.evaluation.paper.rescoring import FIGURES, learned_threshold, rescore
from creative_nao.evaluation.paper.summary import mean_with_interval, values_of
from creative_nao.evaluation.paper.threads import in_threads
from creative_nao.evaluation.paper.variants import SCORINGS, TRAININGS, Scoring, Training
from creative_nao.model import CONDITIONS, Memory, NetworkSettings, TrainingSettings, reproduction, train_many
from creative_nao.pb_space import pb_grid
from creative_nao.untrusted import as_json, read_text

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
    for field in FIGURES:
        values = values_of(networks, field)
        figures[field] = {name: mean_with_interval(values[name], [seed, key, field, name]) for name in CONDITION_NAMES}
        orders[field] = order_of({name: one["mean"] if one else None for name, one in figures[field].items()})
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
    atomic.write_text(path, json.dumps({"job": described, "figures": figures}, allow_nan=False) + "\n")
    return figures
