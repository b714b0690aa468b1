"""The figures of each network, and their means over networks: `measured/*.json`, `networks.csv`, `results.json`.

A network's figures are Table I, its learning curve as numbers, the shape of its map, and how many of its new actions
are combinations of two basic ones. The paper shows two such combinations (Fig. 3c, 5b) without measuring them.
"""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao.demonstrations import Demonstrations
from creative_nao.errors import CreativeNaoError
from creative_nao.evaluation.paper.bank import CONDITION_NAMES, Entry, PaperSettings
from creative_nao.evaluation.paper.claims import CONVERGED_LEVEL, FURTHER, TABLE_I, Figures, values_of
from creative_nao.evaluation.statistics import estimate, seed_sequence
from creative_nao.maps import PBMap, landscape, pb_map
from creative_nao.measures import Criteria, dtw_matrix, dtw_pairs, score, table
from creative_nao.measures.outcome import Scores
from creative_nao.model import CONDITIONS, Memory, reproduction
from creative_nao.schema import JsonObject, load_json, record, save_json

WARM_UP = 0.1
"""Share of the training that is left out of the unsteadiness: there the loss falls steeply in every condition."""

SWITCH_EVERY = 5  # ticks between two places where one action may give way to the other
N_SAMPLED = 300  # most unlearned points of a map that are compared with all mixtures
N_BETWEEN = 19  # points on the straight line between two learned PB values, ends left out
FORMAT = 1  # raised when the meaning of a figure changes, so that a run folder of another release is not continued

WHY_NONE = {"novelty": "no appropriate action to measure", "diversity": "fewer than two appropriate actions to compare"}
NOTHING_SEARCHED = dict.fromkeys(
    ("reward", "oracle_share"), "the whole grid is scored as in the paper, nothing is searched"
)


@record(closed=False)
class MeasuredFile:
    """What was measured, and the figures: the content of `measured/CONDITION-SEED.json`."""

    job: JsonObject
    figures: JsonObject


def measure_entry(entry: Entry, folder: Path, settings: PaperSettings) -> dict[str, Any]:
    """Return the figures of a network of a run folder; those that are there already are not worked out again.

    The figures go to `measured/CONDITION-SEED.json` and the map to `maps/CONDITION-SEED.npz`. The network's name and
    the seed decide the random draws.
    """
    path, map_file = folder / "measured" / f"{entry.stem}.json", map_path(folder, entry)
    job = {"format": FORMAT, "memory": entry.sha256, "seed": settings.seed, "resolution": settings.resolution}
    try:
        kept = load_json(MeasuredFile, path, "figures of a network")
    except CreativeNaoError:
        kept = None
    if kept is not None and kept.job == job and map_file.is_file():
        return kept.figures
    memory = entry.load()
    memory_map = pb_map(memory, settings.resolution)
    assert memory_map.trajectories is not None
    rng = np.random.default_rng(seed_sequence(settings.seed, entry.name))
    # What the map knows of its points is enough for the table, which needs no distances to all actions.
    distance = memory_map.distance
    scores = Scores(memory_map.outcome, distance, memory_map.nearest, distance[:, None], memory_map.appropriate)
    shares = table(memory_map.trajectories, memory.demonstrations, rng=rng, scores=scores)
    back, shape = reproduction(memory), landscape(memory_map)
    figures = {
        "name": entry.name,
        "condition": entry.condition,
        "seed": entry.seed,
        "n_epochs": memory.training.n_epochs,
        "first_loss": float(memory.loss_history[0]),
        "best_loss": memory.best_loss,
        "best_epoch": memory.best_epoch,
        "epochs_to_level": epochs_to_level(memory),
        "unsteadiness": unsteadiness(memory),
        "reproduction_dtw": dict(zip(memory.demonstrations.names, back, strict=True)),
        "n_reproduced": sum(distance <= Criteria().learned_threshold for distance in back),
        "unlearned_pct": shares.unlearned_pct,
        "learned_pct": shares.learned_pct,
        "appropriateness_pct": shares.appropriate_pct,
        "fluctuating_pct": shares.fluctuating_pct,
        "non_moving_pct": shares.non_moving_pct,
        "novelty": shares.novelty.mean if shares.novelty else None,
        "diversity": shares.diversity.mean if shares.diversity else None,
        "region_pct": dict(zip(memory_map.names, memory_map.learned_region_pct().tolist(), strict=True)),
        "n_regions": shape.n_nearest_regions,
        "border_length": shape.border_length,
        "ruggedness": None if shape.ruggedness is None else shape.ruggedness.mean,
        "evenness": shape.learned_evenness,
        "steep_step_pct": steep_step_pct(memory_map, memory.demonstrations),
        **combination_figures(memory, memory_map, rng),
    }
    memory_map.save(map_file)
    save_json(path, MeasuredFile(job, figures))
    return figures


def map_path(folder: Path, entry: Entry) -> Path:
    """Return where the map of a network stands in a run folder."""
    return folder / "maps" / f"{entry.stem}.npz"


def epochs_to_level(memory: Memory) -> int | None:
    """Return the first epoch whose loss is at most `CONVERGED_LEVEL` times the first one; None if there is none.

    The curve that a memory keeps has at most 5000 points, so the answer is exact to a spacing of them.
    """
    history = memory.loss_history
    below = np.flatnonzero(history <= CONVERGED_LEVEL * history[0])
    return int(below[0]) * memory.loss_every + 1 if len(below) else None


def unsteadiness(memory: Memory) -> float:
    """Return the mean change of log10(loss) from one kept point of the curve to the next, without the first tenth.

    Curves are compared at the same spacing only, which networks trained for the same number of epochs have.
    """
    history = memory.loss_history[int(WARM_UP * len(memory.loss_history)) :]
    return float(np.abs(np.diff(np.log10(history.astype(np.float64)))).mean()) if len(history) > 1 else 0.0


def steep_step_pct(memory_map: PBMap, demos: Demonstrations) -> float:
    """Return the share of steep steps of a map with trajectories [%]; 0 when no two neighbours are usable.

    Of the steps between two neighbouring grid points that both give a usable action, those are steep over which the
    action changes by more than the smallest distance between two basic actions.
    """
    assert memory_map.trajectories is not None
    between = dtw_matrix(list(demos.trajectories))
    smallest = float(between[np.triu_indices(len(between), 1)].min())
    place = np.arange(memory_map.resolution**2).reshape(memory_map.resolution, -1)
    first = np.concatenate([place[:, :-1].ravel(), place[:-1].ravel()])
    second = np.concatenate([place[:, 1:].ravel(), place[1:].ravel()])
    usable = memory_map.appropriate[first] & memory_map.appropriate[second]
    if not usable.any():
        return 0.0
    return 100.0 * float(np.mean(dtw_pairs(memory_map.trajectories, first[usable], second[usable]) > smallest))


def mixtures(demos: Demonstrations, first: int, second: int) -> list[tuple[str, np.ndarray]]:
    """Return the combinations of two basic actions, given by their places, in this order.

    Returns:
        Of each its kind, `in time` (`first` begins, `second` ends) or `of arms` (`first` gives the right arm, `second`
        the left), and its joint angles [rad], shape (n_steps, n_joints).
    """
    one, other = demos.trajectories[first], demos.trajectories[second]
    n_steps = min(len(one), len(other))
    ticks = range(SWITCH_EVERY, n_steps, SWITCH_EVERY)
    made = [("in time", np.concatenate([one[:tick], other[tick:]])) for tick in ticks]
    right = np.array([joint.startswith("R") for joint in demos.joints])
    if right.any() and not right.all():
        made.append(("of arms", np.where(right, one[:n_steps], other[:n_steps])))
    return made


def combination_figures(memory: Memory, memory_map: PBMap, rng: np.random.Generator) -> dict[str, Any]:
    """Return how many unlearned actions of a map with trajectories are combinations; `rng` draws those looked at.

    Returns:
        `combination_pct`: share of the unlearned actions that are a combination, None without unlearned ones;
        `n_pairs_between`: of the pairs of basic actions, how many have a combination of just these two on the straight
        line between their learned PB values; `clearest_combination`: the nearest one of those drawn, or None.
    """
    assert memory_map.trajectories is not None
    demos, threshold = memory.demonstrations, Criteria().learned_threshold
    share, clearest = None, None
    unlearned = np.flatnonzero(memory_map.outcome == "unlearned")
    if len(unlearned):
        pairs = itertools.permutations(range(demos.n_actions), 2)
        made = [(*pair, *one) for pair in pairs for one in mixtures(demos, *pair)]
        drawn = np.sort(rng.choice(unlearned, size=min(N_SAMPLED, len(unlearned)), replace=False))
        distances = dtw_matrix([memory_map.trajectories[k] for k in drawn], [trajectory for *_, trajectory in made])
        share = 100.0 * float(np.mean(distances.min(axis=1) <= threshold))
        row, column = np.unravel_index(int(distances.argmin()), distances.shape)
        if distances[row, column] <= threshold:
            first, second, kind, _ = made[column]
            clearest = {
                "pb": memory_map.pb[drawn[row]].tolist(),
                "first": demos.names[first],
                "second": demos.names[second],
                "kind": kind,
                "distance": float(distances[row, column]),
            }
    n_between = sum(_lies_between(memory, *pair) for pair in itertools.combinations(range(demos.n_actions), 2))
    return {"combination_pct": share, "clearest_combination": clearest, "n_pairs_between": n_between}


def _lies_between(memory: Memory, first: int, second: int) -> bool:
    share = np.linspace(0.0, 1.0, N_BETWEEN + 2)[1:-1, None]
    generated = memory.generate((1.0 - share) * memory.pb[first] + share * memory.pb[second])
    unlearned = score(generated, memory.demonstrations).outcome == "unlearned"
    if not unlearned.any():
        return False
    both = mixtures(memory.demonstrations, first, second) + mixtures(memory.demonstrations, second, first)
    distances = dtw_matrix(generated[unlearned], [trajectory for _, trajectory in both])
    return bool((distances <= Criteria().learned_threshold).any())


def make_results(networks: Sequence[Figures], *, resolution: int, seed: int) -> dict[str, Any]:
    """Return the content of `results.json`, one row per condition; `seed` decides the bootstrap samples."""
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
            row[measure.field] = mean_with_interval(values, seed, condition, measure.field)
            if row[measure.field] is None:
                row[f"{measure.field}_reason"] = WHY_NONE.get(measure.field, "no network of this condition")
                continue
            row["spread"][measure.field] = {"smallest": float(values.min()), "largest": float(values.max())}
            if len(values) < 2:
                row[f"{measure.field}_reason"] = "no interval from a single seed"
        for field, reason in NOTHING_SEARCHED.items():
            row[field], row[f"{field}_reason"] = None, reason
        rows.append(row)
    return {"suite": "paper", "rows": rows}


def mean_with_interval(values: np.ndarray, *seeds: int | str) -> dict[str, float | None] | None:
    """Return mean, low and high over seeds, shape (n,); None without values. `seeds` decide the bootstrap samples."""
    if not len(values):
        return None
    return estimate(values, rng=np.random.default_rng(seed_sequence(*seeds)))


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
