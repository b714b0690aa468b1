"""The map of a memory: every point of a grid over its PB space generated and scored, or a slice through it."""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from creative_nao.arrays import load_tensors, npz_header, only_arrays, read_npz, save_npz, save_tensors, take
from creative_nao.errors import NotFoundError, SettingsError, ShapeError, shown
from creative_nao.maps.figure_style import write_figure
from creative_nao.maps.grid import PAPER_RESOLUTION, GridMap, pb_grid
from creative_nao.maps.picture import draw_map
from creative_nao.measures import OUTCOMES, Criteria, score
from creative_nao.measures.dtw import as_numbers
from creative_nao.model import Memory
from creative_nao.runtime import record as record_of_making
from creative_nao.schema import (
    AfterValidator,
    Field,
    JsonObject,
    Names,
    Version1,
    checked,
    checked_path,
    dump,
    parse,
    record,
)

KIND = "PB map"
MAX_RESOLUTION = 4000
MAX_DISTANCE = 1e30  # largest distance of a file; float32 ends at 3e38
ARRAYS = ("outcome", "nearest", "distance", "learned_pb")  # of a map file
CODES = tuple(sorted(OUTCOMES))  # outcomes in the order of their codes in a file

Resolution = Annotated[int, Field(ge=2, le=MAX_RESOLUTION)]


def _has_settings(made_by: dict[str, Any]) -> dict[str, Any]:
    if not isinstance(made_by.get("settings", {}), dict):
        raise ValueError("a JSON object whose `settings`, if there are any, are an object")
    return made_by


Provenance = Annotated[JsonObject, AfterValidator(_has_settings)]  # what a file says of its making


@record
class MapHeader:
    """What a map file says of itself, beside its arrays."""

    format_version: Version1
    resolution: Resolution
    names: Names
    record: Provenance


def grid_fields(source: Path, header: MapHeader, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    """Return the fields that all maps have alike of what a map file holds; a wrong array raises FileFormatError."""
    n, n_actions = (header.resolution**2,), len(header.names)
    return {
        "resolution": header.resolution,
        "pb": pb_grid(header.resolution),
        "nearest": take(source, arrays, "nearest", n, kinds="iu", least=0, most=n_actions - 1).astype(np.int64),
        "distance": take(source, arrays, "distance", n, least=0.0, most=MAX_DISTANCE),
        "learned_pb": take(source, arrays, "learned_pb", (n_actions, 2), least=-1.0, most=1.0),
        "names": header.names,
        "record": header.record,
    }


@dataclass(frozen=True, eq=False, repr=False)
class PBMap(GridMap):
    """A scored grid over the PB space of a memory: a `GridMap` that can be saved, read back and drawn."""

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the map, without trajectories, in one step and return its path.

        A path that ends in ``.npz`` gets an NPZ file, every other one a safetensors file; `load` reads both.
        """
        header = dump(MapHeader(format_version=1, resolution=self.resolution, names=self.names, record=self.record))
        arrays = {
            "outcome": np.searchsorted(CODES, self.outcome).astype(np.int8),
            "nearest": self.nearest.astype(np.int16),
            "distance": self.distance,
            "learned_pb": self.learned_pb,
        }
        if checked_path(path).suffix != ".npz":
            return save_tensors(path, kind=KIND, header=header, tensors=arrays)
        return save_npz(path, header, arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> PBMap:
        """Read a map back; a torn or foreign file is a FileFormatError that names the part."""
        source = checked_path(path)
        if not source.is_file():
            raise NotFoundError(f"no PB map at {source}; make one with `creative-nao map MEMORY --out {source}`")
        if source.suffix == ".npz":
            arrays = read_npz(source, KIND, largest=16 * MAX_RESOLUTION**2)
            values = npz_header(source, arrays, KIND)
            del arrays["header"]
        else:
            values, arrays = load_tensors(source, kind=KIND)
        only_arrays(source, arrays, ARRAYS)
        header = parse(MapHeader, values, f"{source}: `header`")
        codes = take(source, arrays, "outcome", (header.resolution**2,), kinds="iu", least=0, most=len(CODES) - 1)
        return cls(outcome=np.array(CODES)[codes], **grid_fields(source, header, arrays))

    def plot(self, path: str | os.PathLike[str] | None = None, **options: Any) -> Any:
        """Draw the map and return the matplotlib figure; the options are those of `draw_map`: ``colour="speed"``."""
        return draw_map(self, path, **options)

    def _repr_png_(self) -> bytes:
        """Return the picture that a notebook shows."""
        stream = io.BytesIO()
        self.plot().savefig(stream, format="png", dpi=90)
        return stream.getvalue()


def pb_map(memory: Memory, resolution: int = PAPER_RESOLUTION, criteria: Criteria | None = None) -> PBMap:
    """Generate and score a grid of `resolution` x `resolution` PB points, by default by the criteria of the paper.

    Raises:
        SettingsError: If the memory does not have two PB units, or `resolution` is below 2 or above 4000.
    """
    if (n_pb := _pb_units(memory)) != 2:
        hint = "; `pb_slice` maps two of them" if n_pb > 2 else ""
        raise SettingsError(f"a PB map needs a memory with n_pb = 2, but this one has {n_pb}{hint}")
    resolution = checked(Resolution, resolution, "resolution")
    settings = {"memory": getattr(memory, "name", ""), "resolution": resolution}
    return PBMap(learned_pb=memory.pb, **_scored(memory, resolution, pb_grid(resolution), criteria, settings))


def _pb_units(memory: Memory) -> int:
    if not (hasattr(memory, "pb") and hasattr(memory, "generate")):
        raise SettingsError(f'`memory` should be a memory, such as `load_memory("half/0")`, but is {shown(memory)}')
    return memory.pb.shape[1]


def _scored(
    memory: Memory, resolution: int, pb: np.ndarray, criteria: Criteria | None, settings: dict[str, Any]
) -> dict[str, Any]:
    """Generate and score the PB points (n, n_pb) of a grid; return the fields that a map and a slice have alike."""
    trajectories = memory.generate(pb)
    scores = score(trajectories, memory.demonstrations, Criteria() if criteria is None else criteria)
    return {
        "resolution": resolution,
        "pb": pb_grid(resolution),
        "outcome": scores.outcome,
        "nearest": scores.nearest,
        "distance": scores.novelty,
        "names": memory.demonstrations.names,
        "record": record_of_making(settings=settings),
        "trajectories": trajectories,
        "dt_s": memory.demonstrations.dt_s,
    }


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class PBSlice(PBMap):
    """A scored grid over two PB units. Everything a `PBMap` has, and where the slice lies.

    `pb` and `learned_pb` are seen in the plane of the slice, shape (..., 2): a basic action whose other PB values
    differ from `at` lies before or behind it. Read back from a file it is a `PBMap`, its place in the record.

    Attributes:
        axes: The two PB units, counted from 0: the horizontal and the vertical one.
        at: PB value of all units, shape (n_pb,); the two of `axes` do not count.
    """

    axes: tuple[int, int]
    at: np.ndarray

    @property
    def full_pb(self) -> np.ndarray:
        """The points with all their PB values, shape (n, n_pb)."""
        return _filled(self.pb, self.axes, self.at)

    def plot(self, path: str | os.PathLike[str] | None = None, **options: Any) -> Any:
        """Draw the slice as `PBMap.plot` draws a map, its two PB units at the axes."""
        held = ", ".join(f"PB {k + 1} = {v:.3g}" for k, v in enumerate(self.at) if k not in self.axes)
        figure = draw_map(self, **{"title": f"Slice at {held}" if held else None, **options})
        figure.axes[0].set(xlabel=f"PB {self.axes[0] + 1}", ylabel=f"PB {self.axes[1] + 1}")
        if path is not None:
            write_figure(figure, path)
        return figure


def pb_slice(
    memory: Memory,
    axes: Sequence[int] = (0, 1),
    at: ArrayLike | None = None,
    resolution: int = PAPER_RESOLUTION,
    criteria: Criteria | None = None,
) -> PBSlice:
    """Generate and score a grid over two PB units of a memory with two or more.

    Args:
        memory: The memory.
        axes: Two different PB units, counted from 0.
        at: PB value of every unit in [-1, 1], shape (n_pb,), those of `axes` being ignored; for example
            ``memory.pb[2]``, to cut through the third basic action. Default: 0.
        resolution: Points along each axis.
        criteria: Where the lines between the outcomes are drawn; default: the paper's.

    Raises:
        SettingsError: If `axes` are not two different units of the memory or `resolution` is out of range.
        ShapeError: If `at` is not (n_pb,) in [-1, 1].
    """
    n_pb = _pb_units(memory)
    pair = tuple(axes) if isinstance(axes, Sequence) else ()
    known = [k for k in pair if isinstance(k, int | np.integer) and 0 <= k < n_pb]
    if len(pair) != 2 or len(set(known)) != 2:
        raise SettingsError(
            f"`axes` should be two different PB units of this memory, from 0 to {n_pb - 1}, but is {shown(axes)}"
        )
    pair = (int(pair[0]), int(pair[1]))
    resolution = checked(Resolution, resolution, "resolution")
    place = np.zeros(n_pb) if at is None else as_numbers(at, "at").copy()
    if place.shape != (n_pb,) or not (np.abs(place) <= 1).all():
        raise ShapeError(f"`at` should hold {n_pb} PB values in [-1, 1], but is {place.tolist()}")
    settings = {"memory": memory.name, "resolution": resolution, "axes": list(pair), "at": place.tolist()}
    scored = _scored(memory, resolution, _filled(pb_grid(resolution), pair, place), criteria, settings)
    return PBSlice(learned_pb=memory.pb[:, list(pair)], axes=pair, at=place, **scored)


def _filled(pb: np.ndarray, axes: tuple[int, int], at: np.ndarray) -> np.ndarray:
    full = np.repeat(at[None], len(pb), axis=0)
    full[:, list(axes)] = pb
    return full
