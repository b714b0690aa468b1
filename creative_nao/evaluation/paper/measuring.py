"""One network, measured: every figure of the reproduction that a single memory has, as plain values."""

from __future__ import annotations

import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao import atomic
from creative_nao.errors import CreativeNaoError
from creative_nao.evaluation.paper.bank import Entry
from creative_nao.evaluation.paper.combinations import combination_figures
from creative_nao.evaluation.paper.learning import epochs_to_level, unsteadiness
from creative_nao.evaluation.paper.settings import PaperSettings
from creative_nao.evaluation.paper.terrain import terrain_figures
from creative_nao.measures import Criteria, table
from creative_nao.measures.score import Scores
from creative_nao.model import Memory, reproduction
from creative_nao.pb_space import PBMap, pb_map
from creative_nao.untrusted import as_json, read_text

FORMAT = 1
"""Raised when the meaning of a figure changes, so that a run folder of another release is not continued."""


def measure(memory: Memory, name: str, settings: PaperSettings) -> tuple[dict[str, Any], PBMap]:
    """Return all figures of a memory and its map.

    Args:
        memory: The memory.
        name: Its name; it decides the random draws, together with the seed.
        settings: Seed and resolution.
    """
    charted = pb_map(memory, settings.resolution)
    assert charted.trajectories is not None
    rng = np.random.default_rng([settings.seed, zlib.crc32(name.encode())])
    figures = table(charted.trajectories, memory.demonstrations, rng=rng, scores=_scores(charted))
    back = reproduction(memory)
    return {
        "n_epochs": memory.training.n_epochs,
        "first_loss": float(memory.loss_history[0]),
        "best_loss": memory.best_loss,
        "best_epoch": memory.best_epoch,
        "epochs_to_level": epochs_to_level(memory),
        "unsteadiness": unsteadiness(memory),
        "reproduction_dtw": dict(zip(memory.demonstrations.names, back, strict=True)),
        "n_reproduced": sum(distance <= Criteria().learned_threshold for distance in back),
        "unlearned_pct": figures.unlearned_pct,
        "learned_pct": figures.learned_pct,
        "appropriateness_pct": figures.appropriate_pct,
        "fluctuating_pct": figures.fluctuating_pct,
        "non_moving_pct": figures.non_moving_pct,
        "novelty": figures.novelty.mean if figures.novelty else None,
        "diversity": figures.diversity.mean if figures.diversity else None,
        "region_pct": dict(zip(charted.names, charted.learned_region_pct().tolist(), strict=True)),
        **terrain_figures(charted, memory.demonstrations),
        **combination_figures(memory, charted, rng),
    }, charted


def measure_entry(entry: Entry, folder: Path, settings: PaperSettings) -> dict[str, Any]:
    """Return the figures of a network of a run folder; those that are there already are not worked out again.

    The figures go to `measured/CONDITION-SEED.json` and the map to `maps/CONDITION-SEED.npz`.
    """
    path, chart = result_path(folder, entry), chart_path(folder, entry)
    job = {"format": FORMAT, "memory": entry.sha256, "seed": settings.seed, "resolution": settings.resolution}
    try:
        found = as_json(read_text(path, "figures of a network"), str(path))
    except CreativeNaoError:
        found = None
    if isinstance(found, dict) and found.get("job") == job and "figures" in found and chart.is_file():
        return found["figures"]
    figures, charted = measure(entry.load(), entry.name, settings)
    figures = {"name": entry.name, "condition": entry.condition, "seed": entry.seed, **figures}
    charted.save(chart)
    atomic.write_text(path, json.dumps({"job": job, "figures": figures}, indent=2, allow_nan=False) + "\n")
    return figures


def result_path(folder: Path, entry: Entry) -> Path:
    """Return where the figures of a network stand."""
    return folder / "measured" / f"{entry.stem}.json"


def chart_path(folder: Path, entry: Entry) -> Path:
    """Return where the map of a network stands."""
    return folder / "maps" / f"{entry.stem}.npz"


def _scores(charted: PBMap) -> Scores:
    """Return what the map says of its points, in the form that `table` takes; it needs no distances to all actions."""
    return Scores(
        charted.outcome, charted.distance, charted.nearest, charted.distance[:, None], charted.appropriate
    )  # fmt: skip
