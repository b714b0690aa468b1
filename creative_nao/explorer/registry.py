"""The memories that the page can show, and what is computed of each in threads: maps, measures, finer cells."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import os
import threading
import zlib
from base64 import b64encode
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao import __version__, maps, storage
from creative_nao.envs.physical_map import FIGURES, PhysicalMap, fingerprint
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError, ShapeError, nearest_name
from creative_nao.joints import JOINTS, LIMITS_RAD
from creative_nao.maps import COLOURINGS, PAPER_RESOLUTION, PBMap, colour_values
from creative_nao.maps.picture import HALF_DISTANCE, NEAREST, measure_span
from creative_nao.measures import OUTCOMES, Criteria, excursion_limit, score, speed_limits, unexpectedness
from creative_nao.measures.outcome import ALL_OUTCOMES
from creative_nao.model import Memory, load_memory, shipped_memories

OUTCOME, PHYSICAL = "outcome", "physical"
_PHYSICAL_FIGURES = {f"{PHYSICAL}_{name}": name for name in FIGURES if name != "fell"}
COLOURS: dict[str, str] = {
    NEAREST: "most similar taught movement",
    OUTCOME: "new, taught or unusable",
    "novelty": "difference from the nearest taught movement [rad]",
    "unexpectedness": "how rare it is on this map [bit]",
    "speed": "largest speed of a joint [rad/s]",
    "excursion": "how far the most moving joint goes [rad]",
    "ruggedness": "difference from the neighbours on the map [rad]",
    PHYSICAL: "on the robot: what happens",
    **{key: f"on the robot: {FIGURES[name]}" for key, name in _PHYSICAL_FIGURES.items()},
}
"""Every colouring as the page calls it. The physical ones need a physical map of the memory."""
SMALLEST_VIEW = 0.002
"""Width of the narrowest window of the PB space: a thousand times nearer than the whole map."""


@dataclasses.dataclass(frozen=True)
class View:
    """A square of the PB space: the lowest values of the first and the second PB unit, and the length of its sides.

    SettingsError unless it lies in [-1, 1] and is at least `SMALLEST_VIEW` wide.
    """

    left: float
    bottom: float
    width: float

    def __post_init__(self) -> None:
        inside = all(-1 <= low <= 1 - self.width + 1e-9 for low in (self.left, self.bottom))
        if not (inside and SMALLEST_VIEW <= self.width <= 2):
            raise SettingsError(f"a window should be {SMALLEST_VIEW} to 2 wide and lie in [-1, 1], but is {self}")

    def grid(self, n: int) -> np.ndarray:
        """Return the middles of `n` x `n` cells, shape (n^2, 2), in the order of `maps.pb_grid`."""
        steps = (np.arange(n) + 0.5) * (self.width / n)
        first, second = np.meshgrid(self.left + steps, self.bottom + steps, indexing="xy")
        return np.clip(np.stack([first, second], axis=-1).reshape(-1, 2), -1.0, 1.0)


def needs_movements(colour: str) -> bool:
    """Tell whether a colouring is worked out from the movements themselves."""
    return colour in COLOURINGS and COLOURINGS[colour].needs_trajectories


def spoken(name: str) -> str:
    """Return the name of a basic action as it is read aloud: `left_jab` is left jab."""
    return name.replace("_", " ")


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


def finer_cells(
    memory: Memory, whole: PBMap, view: View, n: int, colour: str, work: Computation
) -> dict[str, Any] | None:
    """Generate and score `n` x `n` cells of a window, `whole` being the memory's map, as `cells_json` returns them.

    The number of `colour` is worked out from the same movements. None if cancelled.
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
    record = {"settings": {"memory": memory.name, "resolution": n}}
    cells = PBMap(n, pb, outcome, nearest, distance, whole.learned_pb, whole.names, record, kept, memory.dt_s)
    values = measured(memory, cells, colour, whole, work) if colour in COLOURINGS else None
    return cells_json(cells, {} if values is None else {colour: values}, view)


def cells_json(pb_map: PBMap, values: Mapping[str, np.ndarray], view: View | None = None) -> dict[str, Any]:
    """Return scored cells as the page takes them; JSON values.

    `n` cells along each side of the square from `left` and `bottom` on, `width` wide; a byte a cell, row 0 at the
    lowest PB 2, deflated, of `outcome` (place in `ALL_OUTCOMES`), `nearest` and `similarity` to it (255 is equal); of
    each of the `values` its byte `plane`, 0 at `low` and 255 at `high`.
    """
    n = pb_map.resolution
    half_cell = 1 / (n - 1) if view is None else 0.0
    square = {"left": -1 - half_cell, "bottom": -1 - half_cell, "width": 2 + 2 * half_cell}
    if view is not None:
        square = dataclasses.asdict(view)
    codes = {name: code for code, name in enumerate(ALL_OUTCOMES)}
    return {
        "n": n, **square,
        "outcome": _plane(np.array([codes[str(name)] for name in pb_map.outcome])),
        "nearest": _plane(np.minimum(pb_map.nearest, 255)),
        "similarity": _plane(np.round(255 * 2.0 ** (-pb_map.distance / HALF_DISTANCE))),
        "values": {name: _number(pb_map, numbers) for name, numbers in values.items()},
    }  # fmt: skip


def _number(pb_map: PBMap, values: np.ndarray) -> dict[str, Any]:
    low, high = measure_span(pb_map, values)
    share = (values - low) / (high - low) if high > low else np.zeros(len(values))
    return {"plane": _plane(np.round(255 * np.clip(share, 0, 1))), "low": low, "high": high}


def _plane(values: np.ndarray) -> str:
    return _text(zlib.compress(np.asarray(values).astype(np.uint8).tobytes(), 9))


def _text(content: bytes) -> str:
    return b64encode(content).decode()


def _packed(array: np.ndarray) -> str:
    return _text(np.ascontiguousarray(array, dtype="<f4").tobytes())


def memory_json(memory: Memory) -> dict[str, Any]:
    """Return what the page needs of a memory: weights, code, basic actions and thresholds; JSON values."""
    network, first = memory.network, memory.demonstrations.initial_posture
    rates = 1 / np.repeat(np.array(network.time_constants, np.float32), network.layer_sizes)
    return {
        "name": memory.name,
        "names": [spoken(name) for name in memory.demonstrations.names],
        "joints": list(memory.joints),
        "dt": memory.dt_s,
        "nSteps": memory.n_steps,
        "nUnits": network.n_softmax_units,
        "nFast": network.layer_sizes[0],
        "pb": memory.pb.tolist(),
        "demonstrations": [trajectory.tolist() for trajectory in memory.demonstrations.trajectories],
        "weights": {name: _packed(array) for name, array in memory.parameters.items() if name != "rho"},
        "references": _packed(memory.encoding.references),
        "rate": _packed(rates),
        "firstPosture": np.asarray(first).tolist(),
        "firstCode": _packed(memory.encoding.encode(first)),
        "limits": [list(LIMITS_RAD[joint]) for joint in memory.joints],
        "speedLimit": speed_limits(memory.demonstrations).tolist(),
        "travelLimit": excursion_limit(memory.demonstrations),
        "learnedThreshold": Criteria().learned_threshold,
    }


def check_shown(memory: Memory) -> Memory:
    """Return a memory that the page can show; SettingsError if it has other than the eight arm joints or two PB."""
    if memory.network.n_pb != 2:
        raise SettingsError(f"the explorer shows memories with n_pb = 2, but {memory.name} has {memory.network.n_pb}")
    if memory.joints != JOINTS:
        raise SettingsError(
            f"the explorer shows memories of the eight arm joints {', '.join(JOINTS)}, "
            f"but {memory.name} has {', '.join(memory.joints)}"
        )
    return memory


MAX_POINTS = 200


def movement(memory: Memory, points: np.ndarray) -> np.ndarray:
    """Generate the movement at a PB point or along several, shape (n_steps, 8) [rad].

    ShapeError unless the points are (n, 2) in [-1, 1], at most `MAX_POINTS`.
    """
    points = np.asarray(points, dtype=np.float64)
    fits = points.ndim == 2 and points.shape[1] == 2 and 0 < len(points) <= MAX_POINTS
    if not fits or not (np.abs(points) <= 1).all():
        raise ShapeError(f"`points` should have shape (n, 2) and lie in [-1, 1], but has {points.shape}")
    return memory.generate(points)[0] if len(points) == 1 else memory.generate_path(points)


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
        self.memory, self.key, self.physical = check_shown(memory), content_hash(memory), physical
        self.name = memory.name
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
            threading.Thread(target=self.compute, name="fine map", daemon=True).start()

    def compute(self) -> None:
        """Compute the fine map."""
        self.pb_map = _without_movements(cached_map(self.memory, self._resolution))
        self.finished.set()

    def numbers(self, pb_map: PBMap, colour: str) -> dict[str, np.ndarray]:
        """Return the numbers of a colouring of the whole map by its name, worked out once; none if it is no number."""
        if colour not in COLOURINGS:
            return {}
        with self._lock:
            key = colour, pb_map.resolution
            if key not in self._numbers:
                values = measured(self.memory, pb_map, colour, pb_map, Computation())
                assert values is not None  # only a cancelled computation gives none
                self._numbers[key] = values
            return {colour: self._numbers[key]}

    def cells(self, colour: str = NEAREST) -> dict[str, Any]:
        """Return the whole map as `cells_json` does, with the numbers of a colouring; of the robot if it is physical.

        NotFoundError if there is no such colouring, or no physical map.
        """
        if colour not in COLOURS:
            raise NotFoundError(
                f"no colouring `{colour}`{nearest_name(colour, COLOURS)}; there are {', '.join(COLOURS)}"
            )
        if not colour.startswith(PHYSICAL):
            pb_map = self.pb_map  # a finer one may take its place
            return cells_json(pb_map, self.numbers(pb_map, colour))
        if self.physical is None:
            raise NotFoundError(f"no physical map of {self.name} was given; start with --physical FILE")
        figure = _PHYSICAL_FIGURES.get(colour)
        values = {} if figure is None else {colour: self.physical.figures[figure].astype(np.float64)}
        return cells_json(self.physical, values)

    def page_json(self) -> dict[str, Any]:
        """Return all that the page needs to show the memory."""
        return {
            "memory": memory_json(self.memory), "key": self.key, "fine": self.finished.is_set(), "cells": self.cells(),
            "colours": {name: text for name, text in COLOURS.items() if self.physical or not name.startswith(PHYSICAL)},
        }  # fmt: skip


def _without_movements(pb_map: PBMap) -> PBMap:
    """Return a map without its movements: 128 MB of a fine one, and the memory makes them again when needed."""
    return dataclasses.replace(pb_map, trajectories=None, dt_s=None)


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
