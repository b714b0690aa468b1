"""A memory that the page shows, with all that is known of it: its map, its numbers, what the body makes of it."""

from __future__ import annotations

from creative_nao.envs.physical_chart import PhysicalMap
from creative_nao.explorer.charting import Charting
from creative_nao.explorer.maps import content_hash
from creative_nao.explorer.measuring import Measurements
from creative_nao.explorer.mind import Mind
from creative_nao.model import Memory
from creative_nao.pb_space import PAPER_RESOLUTION


class Subject:
    """One memory, shared by all tabs that show it.

    Args:
        memory: The memory.
        resolution: Points along each axis of its map.
        physical: What the robot's body makes of it, if that was worked out.

    Attributes:
        name: What the page calls it: a shipped name, or the path it was given by.
        key: Its content hash.
        mind: Asked for movements.
        charting: Its map of the whole PB space.
        measurements: The numbers of the map in its colourings.
        physical: Its physical map, or None.
    """

    def __init__(self, memory: Memory, resolution: int = PAPER_RESOLUTION, physical: PhysicalMap | None = None) -> None:
        self.name = memory.name
        self.key = content_hash(memory)
        self.mind = Mind(memory)
        self.charting = Charting(memory, resolution)
        self.measurements = Measurements(memory)
        self.physical = physical
