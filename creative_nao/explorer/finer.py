"""A window of the map in cells finer than the map's own: the network asked and scored anew."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from creative_nao.explorer.colours import is_number, is_of_body, needs_movements
from creative_nao.explorer.measuring import BLOCK, measured
from creative_nao.explorer.view import View
from creative_nao.explorer.work import Work
from creative_nao.measures import OUTCOMES, score
from creative_nao.model import Memory
from creative_nao.pb_space import PBMap

LEVELS = (50, 200)
"""Cells along each side of the window, one after the other: the first is there at once, the last as fine as the map."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """The cells of a window.

    Attributes:
        view: What they cover.
        chart: They, scored, without their movements.
        values: The number of each cell by the colouring that it belongs to.
    """

    view: View
    chart: PBMap
    values: dict[str, np.ndarray]


def finer_sheet(memory: Memory, whole: PBMap, view: View, n: int, colour: str, work: Work) -> Sheet | None:
    """Generate and score `n` x `n` cells of a window; None if called off.

    Args:
        memory: The memory.
        whole: Its map of the whole PB space.
        view: The window, within [-1, 1].
        n: Cells along each side.
        colour: What the colours tell: its number is worked out from the same movements.
        work: The work, to be watched and called off.
    """
    pb = view.grid(n)
    kept = np.empty((n * n, memory.n_steps, len(memory.joints))) if needs_movements(colour) else None
    outcome = np.empty(n * n, dtype=f"<U{max(map(len, OUTCOMES))}")
    nearest, distance = np.empty(n * n, dtype=np.int64), np.empty(n * n)
    for rows in work.rows(n * n, BLOCK, end=0.8):
        made = memory.generate(pb[rows])
        scores = score(made, memory.demonstrations)
        outcome[rows], nearest[rows], distance[rows] = scores.outcome, scores.nearest, scores.novelty
        if kept is not None:
            kept[rows] = made
    if work.called_off:
        return None
    settings = {"memory": memory.name, "resolution": n, "view": [view.left, view.bottom, view.width]}

    def chart(trajectories: np.ndarray | None) -> PBMap:
        return PBMap(
            n, pb, outcome, nearest, distance, whole.learned_pb, whole.names, {"settings": settings},
            trajectories, memory.dt_s,
        )  # fmt: skip

    values = {}
    if is_number(colour) and not is_of_body(colour):
        number = measured(memory, chart(kept), colour, whole, work)
        if number is None:
            return None
        values[colour] = number
    work.share = 1.0
    return Sheet(view, chart(None), values)
