"""The memories that the page can show, each with its map, its measures and its physical map."""

from __future__ import annotations

import dataclasses
import hashlib
import os
import threading
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from creative_nao import __version__
from creative_nao.envs.physical_map import PhysicalMap, fingerprint
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError, nearest_name
from creative_nao.explorer.colours import Measurements
from creative_nao.explorer.memory_service import MemoryService
from creative_nao.maps import PAPER_RESOLUTION, PBMap, pb_map
from creative_nao.model import Memory, load_memory, shipped_memories

CACHE_VARIABLE = "CREATIVE_NAO_CACHE"
"""Environment variable that names another cache folder."""


def cache_folder() -> Path:
    """Return the folder of everything that can be computed again."""
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".cache"
    return Path(base) / "creative_nao"


def content_hash(memory: Memory) -> str:
    """Return a name for what a memory does: equal for equal weights, settings, tick, joints and basic actions.

    Files of favourites hold it, so it stays as it is; physical maps have another (`envs.physical_map.fingerprint`).
    """
    digest = hashlib.sha256(repr((memory.network, memory.dt_s, memory.joints, memory.demonstrations.names)).encode())
    arrays = [memory.parameters[name] for name in sorted(memory.parameters)]
    for array in (*arrays, *memory.demonstrations.trajectories):
        digest.update(repr((array.shape, array.dtype.str)).encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:24]


def cache_path(memory: Memory, resolution: int = PAPER_RESOLUTION) -> Path:
    """Return where the map of a memory is kept; another release of the package may score otherwise and has its own."""
    return cache_folder() / "maps" / f"{content_hash(memory)}-{resolution}-{__version__}.npz"


def kept_map(memory: Memory, resolution: int = PAPER_RESOLUTION) -> PBMap | None:
    """Return the map if it was computed before; a torn file counts as none."""
    path = cache_path(memory, resolution)
    try:
        return PBMap.load(path) if path.is_file() else None
    except FileFormatError:
        return None


def cached_map(memory: Memory, resolution: int = PAPER_RESOLUTION) -> PBMap:
    """Return the scored map of a memory, from the cache or computed now and kept.

    A cache that cannot be written is no error: the map is then computed each time.

    Raises:
        SettingsError: If the memory does not have two PB units or `resolution` is below 2.
    """
    known = kept_map(memory, resolution)
    if known is not None:
        return known
    chart = pb_map(memory, resolution)
    try:
        chart.save(cache_path(memory, resolution))
    except OSError:
        return chart
    return chart


COARSE = 40


class ProgressiveMap:
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


def physical_map_of(memory: Memory, files: Iterable[Path]) -> PhysicalMap | None:
    """Return the physical map of a memory among files, the last if there are several; None if there is none.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If it is torn, foreign or unfinished.
    """
    own = fingerprint(memory)
    found = None
    for path in files:
        chart = PhysicalMap.load(path)
        if _settings(chart).get("sha256") == own:
            found = chart
    return found


def check_physical(files: Iterable[Path], memories: Iterable[Memory]) -> None:
    """Make sure that every file is the physical map of one of the memories.

    Raises:
        SettingsError: If one is not.
        NotFoundError: If there is no such file.
        FileFormatError: If it is torn, foreign or unfinished.
    """
    shown = {fingerprint(memory): memory.name for memory in memories}
    for path in files:
        settings = _settings(PhysicalMap.load(path))
        if settings.get("sha256") not in shown:
            names = list(shown.values())
            raise SettingsError(
                f"{path} is a physical map of the memory {settings.get('memory', '')!s:.60}, with other weights or "
                f"basic actions than {' or '.join(names)}; make one with "
                f"`creative-nao map {names[0]} --physical --out FILE`"
            )


def _settings(chart: PhysicalMap) -> dict[str, object]:
    found = chart.record.get("settings")
    return found if isinstance(found, dict) else {}


class LoadedMemory:
    """One memory, shared by all tabs that show it.

    Args:
        memory: The memory.
        resolution: Points along each axis of its map.
        physical: What the robot's body makes of it, if that was worked out.

    Attributes:
        name: What the page calls it: a shipped name, or the path it was given by.
        key: Its content hash.
        service: Asked for movements.
        progressive_map: Its map of the whole PB space.
        measurements: The numbers of the map in its colourings.
        physical: Its physical map, or None.
    """

    def __init__(self, memory: Memory, resolution: int = PAPER_RESOLUTION, physical: PhysicalMap | None = None) -> None:
        self.name = memory.name
        self.key = content_hash(memory)
        self.service = MemoryService(memory)
        self.progressive_map = ProgressiveMap(memory, resolution)
        self.measurements = Measurements(memory)
        self.physical = physical


NONE = "none"
"""What an address says when there shall be no second memory."""


class MemoryRegistry:
    """Memories by name, each loaded when it is first asked for and then shared by all tabs.

    Args:
        memories: Those the page was started with: the one it shows, and perhaps one beside it.
        resolution: Points along each axis of their maps.
        physical: Files of physical maps; each is used with the memory that it belongs to.

    Attributes:
        first: The memory that the page is about.
        beside: Name of the one shown beside it from the start, or empty.
        names: All that may be asked for.
    """

    def __init__(
        self, memories: Sequence[Memory], resolution: int = PAPER_RESOLUTION, physical: Sequence[Path] = ()
    ) -> None:
        self._resolution, self._physical = resolution, tuple(physical)
        self._lock = threading.Lock()
        self._loaded = {memory.name: self._load(memory) for memory in memories}
        started = list(self._loaded)
        self.first = self._loaded[started[0]]
        self.beside = started[1] if len(started) > 1 else ""
        self.names = tuple(dict.fromkeys([*started, *shipped_memories()]))

    def get(self, name: str) -> LoadedMemory:
        """Return a memory, loaded now if it was not asked for before; its fine map is then computed beside.

        Raises:
            NotFoundError: If it is none of `names`; an address never names a file of its own choice.
        """
        if name not in self.names:
            raise NotFoundError(f"no memory `{name:.60}` here{nearest_name(name, self.names)}")
        with self._lock:
            if name not in self._loaded:
                self._loaded[name] = self._load(load_memory(name))
                self._loaded[name].progressive_map.start()
            return self._loaded[name]

    def start(self) -> None:
        """Compute the fine maps of the memories that the page was started with."""
        for loaded in self._loaded.values():
            loaded.progressive_map.start()

    def _load(self, memory: Memory) -> LoadedMemory:
        return LoadedMemory(memory, self._resolution, physical_map_of(memory, self._physical))
