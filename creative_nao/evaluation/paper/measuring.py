"""One network, measured: every figure of the reproduction that a single memory has, as plain values.

Also here:
- The shape of a map as numbers: how many regions, how long their borders, how rugged and how even.
- Is an action a combination of two basic ones? The paper shows two such (Fig. 3c, 5b) without measuring them.
"""

from __future__ import annotations

import itertools
import json
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao import storage
from creative_nao.demonstrations import Demonstrations
from creative_nao.errors import CreativeNaoError
from creative_nao.evaluation.paper.bank import Entry, PaperSettings
from creative_nao.evaluation.paper.comparisons import epochs_to_level, unsteadiness
from creative_nao.maps import PBMap, pb_map
from creative_nao.maps.landscape import landscape
from creative_nao.measures import Criteria, dtw_matrix, dtw_pairs, score, table
from creative_nao.measures.outcome import Scores
from creative_nao.model import Memory, reproduction
from creative_nao.storage import as_json, read_text


def terrain_figures(charted: PBMap, demos: Demonstrations) -> dict[str, Any]:
    """Return the figures of a map's shape.

    Args:
        charted: The map, with trajectories.
        demos: The basic actions.

    Returns:
        `n_regions`, `border_length`, `ruggedness`, `evenness`: see `pb_space.landscape`, its nearest regions, the
        borders of all colours, the mean over all pairs of neighbours and the evenness of the learned regions.
        `steep_step_pct`: of the steps between two neighbouring grid points that both give a usable action, the share
        over which the action changes by more than the smallest distance between two basic actions [%].
    """
    shape = landscape(charted)
    return {
        "n_regions": shape.n_nearest_regions,
        "border_length": shape.border_length,
        "ruggedness": None if shape.ruggedness is None else shape.ruggedness.mean,
        "evenness": shape.learned_evenness,
        "steep_step_pct": steep_step_pct(charted, demos),
    }


def steep_step_pct(charted: PBMap, demos: Demonstrations) -> float:
    """Return the share of steep steps [%]; 0 when no two neighbours are usable."""
    assert charted.trajectories is not None
    between = dtw_matrix(list(demos.trajectories))
    smallest = float(between[np.triu_indices(len(between), 1)].min())
    place = np.arange(charted.resolution**2).reshape(charted.resolution, -1)
    first = np.concatenate([place[:, :-1].ravel(), place[:-1].ravel()])
    second = np.concatenate([place[:, 1:].ravel(), place[1:].ravel()])
    usable = charted.appropriate[first] & charted.appropriate[second]
    if not usable.any():
        return 0.0
    return 100.0 * float(np.mean(dtw_pairs(charted.trajectories, first[usable], second[usable]) > smallest))


SWITCH_EVERY = 5
"""Ticks between two places where one action may give way to the other."""

N_SAMPLED = 300
"""Most unlearned points of a map that are compared with all mixtures."""

N_BETWEEN = 19
"""Points on the straight line between two learned PB values, ends left out."""


@dataclass(frozen=True, eq=False)
class Mixture:
    """A combination of two basic actions.

    Attributes:
        first: Place of the one that begins, or that gives the right arm.
        second: Place of the one that ends, or that gives the left arm.
        kind: `in time` or `of arms`.
        trajectory: Joint angles [rad], shape (n_steps, n_joints).
    """

    first: int
    second: int
    kind: str
    trajectory: np.ndarray


def mixtures(demos: Demonstrations, first: int, second: int) -> list[Mixture]:
    """Return the combinations of two basic actions in this order."""
    one, other = demos.trajectories[first], demos.trajectories[second]
    n_steps = min(len(one), len(other))
    made = [
        Mixture(first, second, "in time", np.concatenate([one[:tick], other[tick:]]))
        for tick in range(SWITCH_EVERY, n_steps, SWITCH_EVERY)
    ]
    right = np.array([joint.startswith("R") for joint in demos.joints])
    if right.any() and not right.all():
        made.append(Mixture(first, second, "of arms", np.where(right, one[:n_steps], other[:n_steps])))
    return made


def combination_figures(memory: Memory, charted: PBMap, rng: np.random.Generator) -> dict[str, object]:
    """Return how many unlearned actions of a map are combinations, and between which basic actions they lie.

    Args:
        memory: The memory.
        charted: Its map, with trajectories.
        rng: Draws the points that are looked at.

    Returns:
        `combination_pct`: share of the unlearned actions that are a combination, None without unlearned ones;
        `n_pairs_between`: of the pairs of basic actions, how many have a combination of just these two on the straight
        line between their learned PB values; `clearest_combination`: the nearest one of those drawn, or None.
    """
    assert charted.trajectories is not None
    demos, threshold = memory.demonstrations, Criteria().learned_threshold
    pairs = list(itertools.permutations(range(demos.n_actions), 2))
    made = [mixture for pair in pairs for mixture in mixtures(demos, *pair)]
    found: dict[str, object] = {"combination_pct": None, "clearest_combination": None}
    unlearned = np.flatnonzero(charted.outcome == "unlearned")
    if len(unlearned):
        drawn = np.sort(rng.choice(unlearned, size=min(N_SAMPLED, len(unlearned)), replace=False))
        distances = dtw_matrix([charted.trajectories[k] for k in drawn], [mixture.trajectory for mixture in made])
        found["combination_pct"] = 100.0 * float(np.mean(distances.min(axis=1) <= threshold))
        row, column = np.unravel_index(int(distances.argmin()), distances.shape)
        if distances[row, column] <= threshold:
            nearest = made[column]
            found["clearest_combination"] = {
                "pb": charted.pb[drawn[row]].tolist(),
                "first": demos.names[nearest.first],
                "second": demos.names[nearest.second],
                "kind": nearest.kind,
                "distance": float(distances[row, column]),
            }
    found["n_pairs_between"] = sum(
        _lies_between(memory, *pair) for pair in itertools.combinations(range(demos.n_actions), 2)
    )
    return found


def _lies_between(memory: Memory, first: int, second: int) -> bool:
    share = np.linspace(0.0, 1.0, N_BETWEEN + 2)[1:-1, None]
    generated = memory.generate((1.0 - share) * memory.pb[first] + share * memory.pb[second])
    unlearned = score(generated, memory.demonstrations).outcome == "unlearned"
    if not unlearned.any():
        return False
    both = mixtures(memory.demonstrations, first, second) + mixtures(memory.demonstrations, second, first)
    distances = dtw_matrix(generated[unlearned], [mixture.trajectory for mixture in both])
    return bool((distances <= Criteria().learned_threshold).any())


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
    storage.write_text(path, json.dumps({"job": job, "figures": figures}, indent=2, allow_nan=False) + "\n")
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
