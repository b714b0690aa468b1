"""A map that is there at once: coarse first, fine when it has been computed beside."""

from __future__ import annotations

import dataclasses
import threading

from creative_nao.explorer.maps import cached_map, kept_map
from creative_nao.model import Memory
from creative_nao.pb_space import PAPER_RESOLUTION, PBMap, pb_map

COARSE = 40


class Charting:
    """The best map of a memory so far.

    Args:
        memory: The memory.
        resolution: Points along each axis of the fine map.

    Attributes:
        chart: The map to show now.
        finished: Set when it is the fine one.
    """

    def __init__(self, memory: Memory, resolution: int = PAPER_RESOLUTION) -> None:
        self._memory, self._resolution = memory, resolution
        self.finished = threading.Event()
        known = kept_map(memory, resolution)
        self.chart: PBMap = _lean(pb_map(memory, min(COARSE, resolution))) if known is None else known
        if known is not None:
            self.finished.set()

    def start(self) -> None:
        """Compute the fine map in a thread, unless it is there."""
        if not self.finished.is_set():
            threading.Thread(target=self._compute, name="fine map", daemon=True).start()

    def _compute(self) -> None:
        self.chart = _lean(cached_map(self._memory, self._resolution))
        self.finished.set()


def _lean(chart: PBMap) -> PBMap:
    """Return a map without its movements: 128 MB of a fine one, and the memory makes them again when needed."""
    return dataclasses.replace(chart, trajectories=None, dt_s=None)
