"""The memories that the page can show, and what is computed of each in threads: maps, measures, finer cells."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import os
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from creative_nao import __version__, maps, storage
from creative_nao.envs.physical_map import PhysicalMap, fingerprint
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError, nearest_name
from creative_nao.explorer.colours import is_number, is_physical, needs_movements
from creative_nao.explorer.memory_service import MemoryService
from creative_nao.explorer.view import View
from creative_nao.maps import PAPER_RESOLUTION, PBMap, colour_values
from creative_nao.measures import OUTCOMES, score, unexpectedness
from creative_nao.model import Memory, load_memory, shipped_memories

CACHE_VARIABLE = "CREATIVE_NAO_CACHE"  # environment variable that names another cache folder


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
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".cache"
    own, chosen = Path(base) / "creative_nao", os.environ.get(CACHE_VARIABLE)
    if not chosen:
        with contextlib.suppress(OSError):
            storage.own_folder(own)
    folder = Path(chosen or own) / "maps"
    return folder / f"{content_hash(memory)}-{resolution}-{__version__}.safetensors"


def cached_map(memory: Memory, resolution: int = PAPER_RESOLUTION) -> PBMap:
    """Return the scored map of a memory, from the cache or computed now and kept.

    A torn file counts as none. A cache that cannot be written is no error: the map is then computed each time.
    SettingsError if the memory does not have two PB units or `resolution` is below 2.
    """
    path = cache_path(memory, resolution)
    with contextlib.suppress(FileFormatError, NotFoundError):
        return PBMap.load(path)
    pb_map = maps.pb_map(memory, resolution)
    with contextlib.suppress(OSError):
        pb_map.save(path)
    return pb_map


class Computation:
    """A computation in a thread: its share done, 0 to 1; once cancelled it ends at its next step, with None."""

    share = 0.0
    cancelled = False

    def rows(self, n: int, end: float) -> Iterator[slice]:
        """Give the rows of n things block by block until all are done or it is cancelled; `end` is the share then."""
        for start in range(0, n, BLOCK):
            if self.cancelled:
                return
            yield slice(start, min(start + BLOCK, n))
            self.share = end * min(start + BLOCK, n) / n


BLOCK = 512  # movements generated at a time: few enough that a click in between is answered at once


def measured(memory: Memory, pb_map: PBMap, colour: str, whole: PBMap, work: Computation) -> np.ndarray | None:
    """Return the number of each cell, shape (n,), as `maps.colour_values` defines it; None if cancelled.

    The memory generates movements that the map lacks; unexpected ones are compared with those of the `whole` space.
    """
    if colour == "unexpectedness":
        usable = whole.distance[whole.appropriate]
        return unexpectedness(pb_map.distance, usable if len(usable) else whole.distance)
    if needs_movements(colour) and pb_map.trajectories is None:
        generated = np.empty((len(pb_map.pb), memory.n_steps, len(memory.joints)))
        for rows in work.rows(len(generated), end=0.5):  # what is left is comparing them
            generated[rows] = memory.generate(pb_map.pb[rows])
        pb_map = dataclasses.replace(pb_map, trajectories=generated, dt_s=memory.dt_s)
    if work.cancelled:
        return None
    values = colour_values(pb_map, colour)[0]
    work.share = 1.0
    return values


LEVELS = (50, 200)
"""Cells along each side of the window, one after the other: the first is there at once, the last as fine as the map."""


@dataclasses.dataclass(frozen=True, eq=False)
class FinerMap:
    """The scored cells of a window, without movements, and their numbers by colouring."""

    view: View
    pb_map: PBMap
    values: dict[str, np.ndarray]


def finer_map(memory: Memory, whole: PBMap, view: View, n: int, colour: str, work: Computation) -> FinerMap | None:
    """Generate and score `n` x `n` cells of a window within [-1, 1], `whole` being the memory's map; None if cancelled.

    The number of `colour` is worked out from the same movements.
    """
    pb = view.grid(n)
    kept = np.empty((n * n, memory.n_steps, len(memory.joints))) if needs_movements(colour) else None
    outcome = np.empty(n * n, dtype=f"<U{max(map(len, OUTCOMES))}")
    nearest, distance = np.empty(n * n, dtype=np.int64), np.empty(n * n)
    for rows in work.rows(n * n, end=0.8):
        generated = memory.generate(pb[rows])
        scores = score(generated, memory.demonstrations)
        outcome[rows], nearest[rows], distance[rows] = scores.outcome, scores.nearest, scores.novelty
        if kept is not None:
            kept[rows] = generated
    if work.cancelled:
        return None
    settings = {"memory": memory.name, "resolution": n, "view": [view.left, view.bottom, view.width]}
    cells = PBMap(
        n, pb, outcome, nearest, distance, whole.learned_pb, whole.names, {"settings": settings}, kept, memory.dt_s
    )
    values = {}
    if is_number(colour) and not is_physical(colour):
        number = measured(memory, cells, colour, whole, work)
        if number is None:
            return None
        values[colour] = number
    work.share = 1.0
    return FinerMap(view, dataclasses.replace(cells, trajectories=None), values)


def load_physical(files: Iterable[Path], memories: Iterable[Memory]) -> dict[str, PhysicalMap]:
    """Return the physical maps of memories by their `fingerprint`; of several of one memory the last.

    SettingsError if a file belongs to none of the memories, NotFoundError if there is no such file, FileFormatError if
    it is torn, foreign or unfinished.
    """
    shown = {fingerprint(memory): memory.name for memory in memories}
    physical = {}
    for path in files:
        pb_map = PhysicalMap.load(path)
        settings = pb_map.record.get("settings", {})
        own = settings.get("sha256")
        if own not in shown:
            names = list(shown.values())
            raise SettingsError(
                f"{path} is a physical map of the memory {settings.get('memory', '')!s:.60}, with other weights or "
                f"basic actions than {' or '.join(names)}; make one with "
                f"`creative-nao map {names[0]} --physical --out FILE`"
            )
        physical[own] = pb_map
    return physical


COARSE = 40


class LoadedMemory:
    """One memory, its content hash as key, and what was computed of it, shared by all tabs that show it."""

    def __init__(self, memory: Memory, resolution: int = PAPER_RESOLUTION, physical: PhysicalMap | None = None) -> None:
        self.name, self.key, self.physical = memory.name, content_hash(memory), physical
        self.service = MemoryService(memory)
        self.finished = threading.Event()  # set when `pb_map`, the best map so far, is the fine one
        self._resolution = resolution
        self._numbers: dict[tuple[str, int], np.ndarray] = {}
        self._lock = threading.Lock()
        try:
            self.pb_map = PBMap.load(cache_path(memory, resolution))
            self.finished.set()
        except (FileFormatError, NotFoundError):
            self.pb_map = _without_movements(maps.pb_map(memory, min(COARSE, resolution)))

    def start(self) -> None:
        """Compute the fine map in a thread, unless it is there."""
        if not self.finished.is_set():
            threading.Thread(target=self._compute, name="fine map", daemon=True).start()

    def _compute(self) -> None:
        self.pb_map = _without_movements(cached_map(self.service.memory, self._resolution))
        self.finished.set()

    def known(self, pb_map: PBMap, colour: str) -> np.ndarray | None:
        """Return the numbers of a map of the whole PB space, shape (n,), if they were worked out before."""
        return self._numbers.get((colour, pb_map.resolution))

    def numbers(self, pb_map: PBMap, colour: str, work: Computation) -> np.ndarray | None:
        """Return these numbers, worked out once for all tabs; None if cancelled."""
        with self._lock:
            values = self.known(pb_map, colour)
            if values is None and not work.cancelled:
                values = measured(self.service.memory, pb_map, colour, pb_map, work)
                if values is not None:
                    self._numbers[colour, pb_map.resolution] = values
            return values


def _without_movements(pb_map: PBMap) -> PBMap:
    """Return a map without its movements: 128 MB of a fine one, and the memory makes them again when needed."""
    return dataclasses.replace(pb_map, trajectories=None, dt_s=None)


NONE = "none"  # what an address says when there shall be no second memory


class MemoryRegistry:
    """Memories by name, each loaded when it is first asked for and then shared by all tabs.

    It starts with one of them or two; `physical` is what `load_physical` returns.
    """

    def __init__(
        self,
        memories: Sequence[Memory],
        resolution: int = PAPER_RESOLUTION,
        physical: Mapping[str, PhysicalMap] | None = None,
    ) -> None:
        self._resolution, self._physical = resolution, physical or {}
        self._lock = threading.Lock()
        self._loaded = {memory.name: self._load(memory) for memory in memories}
        started = list(self._loaded)
        self.first = self._loaded[started[0]]
        self.beside = started[1] if len(started) > 1 else ""  # name of the one shown beside it from the start
        self.names = tuple(dict.fromkeys([*started, *shipped_memories()]))

    def get(self, name: str) -> LoadedMemory:
        """Return one of `names`, loaded when first asked for; else NotFoundError: an address never names a file."""
        if name not in self.names:
            raise NotFoundError(f"no memory `{name:.60}` here{nearest_name(name, self.names)}")
        with self._lock:
            if name not in self._loaded:
                self._loaded[name] = self._load(load_memory(name))
                self._loaded[name].start()
            return self._loaded[name]

    def start(self) -> None:
        """Compute the fine maps of the memories that the page was started with."""
        for loaded in self._loaded.values():
            loaded.start()

    def _load(self, memory: Memory) -> LoadedMemory:
        return LoadedMemory(memory, self._resolution, self._physical.get(fingerprint(memory)))
