"""The number that each cell of a map has in a colouring, worked out when somebody asks for it."""

from __future__ import annotations

import dataclasses
import threading

import numpy as np

from creative_nao.explorer.colours import needs_movements
from creative_nao.explorer.work import Work
from creative_nao.measures import unexpectedness
from creative_nao.model import Memory
from creative_nao.pb_space import PBMap, colour_values

BLOCK = 512
"""Movements made at a time: few enough that a click in between is answered at once."""
MAKING = 0.5
"""Share of the work after which all movements are made; what is left is comparing them."""


def measured(memory: Memory, chart: PBMap, colour: str, whole: PBMap, work: Work) -> np.ndarray | None:
    """Return the number of each cell, shape (n,), as `pb_space.colour_values` defines it; None if called off.

    Args:
        memory: Makes the movements again where the map does not hold them.
        chart: The cells.
        colour: A name of `pb_space.COLOURINGS`.
        whole: The map of the whole PB space: what an unexpected movement is compared with.
        work: The work, to be watched and called off.
    """
    if colour == "unexpectedness":
        usable = whole.distance[whole.appropriate]
        return unexpectedness(chart.distance, usable if len(usable) else whole.distance)
    if needs_movements(colour) and chart.trajectories is None:
        made = np.empty((len(chart.pb), memory.n_steps, len(memory.joints)))
        for rows in work.rows(len(made), BLOCK, end=MAKING):
            made[rows] = memory.generate(chart.pb[rows])
        chart = dataclasses.replace(chart, trajectories=made, dt_s=memory.dt_s)
    if work.called_off:
        return None
    values = colour_values(chart, colour)[0]
    work.share = 1.0
    return values


class Measurements:
    """The numbers of the whole map that were asked for so far, worked out once for all tabs.

    Args:
        memory: The memory of the map.
    """

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._known: dict[tuple[str, int], np.ndarray] = {}
        self._lock = threading.Lock()

    def known(self, chart: PBMap, colour: str) -> np.ndarray | None:
        """Return the numbers if they were worked out before."""
        return self._known.get((colour, chart.resolution))

    def values(self, chart: PBMap, colour: str, work: Work) -> np.ndarray | None:
        """Return the numbers of the whole map, shape (n,); None if called off."""
        with self._lock:
            found = self.known(chart, colour)
            if found is None and not work.called_off:
                found = measured(self._memory, chart, colour, chart, work)
                if found is not None:
                    self._known[colour, chart.resolution] = found
            return found
