"""`results.json` and `networks.csv`: means over seeds with intervals, and every network's own figures."""

from __future__ import annotations

import csv
import io
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from creative_nao.evaluation.paper.reference import CONDITION_NAMES, FURTHER, TABLE_I
from creative_nao.evaluation.statistics import estimate
from creative_nao.model import CONDITIONS

Figures = Mapping[str, Any]
"""What `measuring.measure_entry` returns."""

WHY_NONE = {"novelty": "no appropriate action to measure", "diversity": "fewer than two appropriate actions to compare"}
NOT_HERE = {
    "reward": "the whole grid is scored as in the paper, nothing is searched",
    "oracle_share": "the whole grid is scored as in the paper, nothing is searched",
}


def values_of(networks: Sequence[Figures], field: str) -> dict[str, np.ndarray]:
    """Return a figure of all networks by condition, one value per seed; networks without it are left out."""
    return {
        condition: np.array(
            [one[field] for one in networks if one["condition"] == condition and one[field] is not None], dtype=float
        )
        for condition in CONDITION_NAMES
    }


def make_results(networks: Sequence[Figures], *, resolution: int, seed: int) -> dict[str, Any]:
    """Return the content of `results.json`: one row per condition.

    Args:
        networks: Figures of every network.
        resolution: Points along each axis of the maps.
        seed: Decides the bootstrap samples.
    """
    rows = []
    for condition in CONDITION_NAMES:
        mine = [one for one in networks if one["condition"] == condition]
        row: dict[str, Any] = {
            "agent": "supervised",
            "env": "grid",
            "memory": condition,
            "closed_loop_ratio": CONDITIONS[condition],
            "n_seeds": len(mine),
            "n_actions": resolution**2,
            "spread": {},
        }
        for measure in (*TABLE_I, *FURTHER):
            values = values_of(mine, measure.field)[condition]
            row[measure.field] = mean_with_interval(values, [seed, condition, measure.field])
            if row[measure.field] is None:
                row[f"{measure.field}_reason"] = WHY_NONE.get(measure.field, "no network of this condition")
                continue
            row["spread"][measure.field] = {"smallest": float(values.min()), "largest": float(values.max())}
            if len(values) < 2:
                row[f"{measure.field}_reason"] = "no interval from a single seed"
        for field, reason in NOT_HERE.items():
            row[field], row[f"{field}_reason"] = None, reason
        rows.append(row)
    return {"suite": "paper", "rows": rows}


def mean_with_interval(values: np.ndarray, stream: Sequence[int | str]) -> dict[str, float | None] | None:
    """Return mean, low and high over seeds; None without values. `stream` names the random draws."""
    if not len(values):
        return None
    rng = np.random.default_rng([part if isinstance(part, int) else zlib.crc32(part.encode()) for part in stream])
    found = estimate(values, rng=rng)
    return {"mean": found.value, "low": found.low, "high": found.high}


def networks_csv(networks: Sequence[Figures]) -> str:
    """Return every figure of every network as CSV, a row each; figures per basic action get a column each."""
    rows = [_flat(one) for one in networks]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(dict.fromkeys(key for row in rows for key in row)), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _flat(figures: Figures) -> dict[str, Any]:
    row: dict[str, Any] = {}
    for key, value in figures.items():
        if isinstance(value, dict) and all(isinstance(one, int | float) for one in value.values()):
            row |= {f"{key}/{name}": one for name, one in value.items()}
        elif not isinstance(value, dict | list):
            row[key] = value
    return row
