"""Is an action a combination of two basic ones? The paper shows two such (Fig. 3c, 5b) without measuring them.

A combination of two basic actions is made here in two ways: *in time*, one up to a tick and the other from there on,
and *of arms*, the right arm of one and the left arm of the other at once. An action that is none of the basic ones
(more than the threshold of 10 away from each) counts as a combination when it lies within that threshold of such a
mixture.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from creative_nao.demonstrations import Demonstrations
from creative_nao.measures import Criteria, dtw_matrix, score
from creative_nao.model import Memory
from creative_nao.pb_space import PBMap

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
