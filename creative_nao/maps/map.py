"""Evenly spaced points of the two-dimensional PB space.

Also here:
- The PB map: every point of a grid over the PB space, performed in the mind and scored.
- A chart over two of several PB units, the others held: a slice through a PB space that no sheet of paper holds.
"""

from __future__ import annotations

import io
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from creative_nao.arrays import read_npz
from creative_nao.arrays import take as take_array
from creative_nao.errors import NotFoundError, SettingsError, ShapeError
from creative_nao.fields import only_arrays, take_header, take_record
from creative_nao.measures import OUTCOMES, Criteria, score
from creative_nao.measures.outcome import APPROPRIATE
from creative_nao.model import Memory
from creative_nao.runtime import record
from creative_nao.storage import write_bytes

PAPER_RESOLUTION = 200
"""Points along each axis in the paper: 40,000 in all."""


def pb_grid(resolution: int = PAPER_RESOLUTION) -> np.ndarray:
    """Return `resolution` x `resolution` PB points evenly spaced in [-1, 1]^2, ends included.

    Args:
        resolution: Points along each axis, at least 2.

    Returns:
        Shape (resolution^2, 2), float64. The first PB unit changes fastest: point k lies in column k % resolution of
        the row k // resolution, rows going up with the second unit.

    Raises:
        SettingsError: If `resolution` is below 2.
    """
    if resolution < 2:
        raise SettingsError(f"`resolution` should be at least 2, but is {resolution}")
    axis = np.linspace(-1.0, 1.0, resolution)
    first, second = np.meshgrid(axis, axis, indexing="xy")
    return np.stack([first, second], axis=-1).reshape(-1, 2)


def neighbour_pairs(resolution: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the pairs of neighbours in `pb_grid(resolution)`, each once: first members and second ones, as indices.

    Returns:
        Twice shape (2 * resolution * (resolution - 1),): neighbours in a row, then those above each other.
    """
    cells = np.arange(resolution**2).reshape(resolution, resolution)
    first = np.concatenate([cells[:, :-1].ravel(), cells[:-1].ravel()])
    second = np.concatenate([cells[:, 1:].ravel(), cells[1:].ravel()])
    return first, second


def nearest_cell(pb: np.ndarray, resolution: int = PAPER_RESOLUTION) -> np.ndarray:
    """Return the index in `pb_grid(resolution)` nearest to each PB point: (n, 2) in [-1, 1] into (n,)."""
    cell = np.rint((np.asarray(pb) + 1.0) / 2.0 * (resolution - 1)).astype(np.int64)
    return cell[:, 1] * resolution + cell[:, 0]


FORMAT_VERSION = 1
MAX_RESOLUTION = 4000
MAX_DISTANCE = 1e30
"""Largest distance of a file; float32 ends at 3e38."""
ARRAYS = ("header", "outcome", "nearest", "distance", "learned_pb")
"""Of a map file."""


@dataclass(frozen=True, eq=False)
class PBMap:
    """A scored grid over the PB space of a memory.

    Attributes:
        resolution: Points along each axis; there are n = resolution^2.
        pb: The points, shape (n, 2), in the order of `grid.pb_grid`.
        outcome: `learned`, `unlearned`, `fluctuating` or `non_moving` each, shape (n,) of str.
        nearest: Which basic action each is nearest to, shape (n,) of int.
        distance: DTW distance to it [rad], shape (n,).
        learned_pb: Where the basic actions themselves lie, shape (n_actions, 2).
        names: Names of the basic actions.
        record: Memory, settings and versions that made the map.
        trajectories: What the network generates at each point [rad], shape (n, n_steps, n_joints); None in a map read
            from a file, since the memory gives the same bits again.
        dt_s: Tick of the trajectories [s]; None in a map read from a file.
    """

    resolution: int
    pb: np.ndarray
    outcome: np.ndarray
    nearest: np.ndarray
    distance: np.ndarray
    learned_pb: np.ndarray
    names: tuple[str, ...]
    record: dict[str, Any]
    trajectories: np.ndarray | None = None
    dt_s: float | None = None

    @property
    def appropriate(self) -> np.ndarray:
        """Whether each point's movement can be used, shape (n,) of bool."""
        return np.isin(self.outcome, APPROPRIATE)

    def share_pct(self, outcome: str) -> float:
        """Return the share of the map with this outcome [%]."""
        return 100.0 * float(np.mean(self.outcome == outcome))

    def learned_region_pct(self) -> np.ndarray:
        """Return the share of the map where each basic action comes back (outcome learned) [%], shape (n_actions,)."""
        mine = self.nearest[None, :] == np.arange(len(self.names))[:, None]
        return 100.0 * np.mean(mine & (self.outcome == "learned"), axis=1)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the map, without trajectories, to an NPZ file in one step and return its path."""
        header = {
            "format_version": FORMAT_VERSION,
            "resolution": self.resolution,
            "names": list(self.names),
            "record": self.record,
        }
        arrays: dict[str, Any] = {
            "outcome": np.searchsorted(sorted(OUTCOMES), self.outcome).astype(np.int8),
            "nearest": self.nearest.astype(np.int16),
            "distance": self.distance,
            "learned_pb": self.learned_pb,
            "header": np.frombuffer(json.dumps(header, allow_nan=False).encode(), dtype=np.uint8),
        }
        # In memory first: on a full disk, an archive that is being written complains once more when it is dropped.
        content = io.BytesIO()
        np.savez_compressed(content, **arrays)  # plain numbers only: nothing is pickled
        return write_bytes(path, content.getvalue())

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> PBMap:
        """Read a map back.

        Raises:
            NotFoundError: If there is no such file.
            FileFormatError: If it is torn or foreign; the message names the part.
        """
        source = Path(path)
        if not source.is_file():
            raise NotFoundError(f"no PB map at {source}; make one with `creative-nao map MEMORY --out {source}`")
        arrays = read_npz(source, "PB map", largest=16 * MAX_RESOLUTION**2)
        only_arrays(source, arrays, ARRAYS)
        header = take_header(source, arrays, "PB map")
        header.version("format_version", FORMAT_VERSION)
        resolution, names = header.whole("resolution", 2, MAX_RESOLUTION), header.names("names")
        n = (resolution**2,)
        codes = take_array(source, arrays, "outcome", n, kinds="iu", least=0, most=len(OUTCOMES) - 1)
        nearest = take_array(source, arrays, "nearest", n, kinds="iu", least=0, most=len(names) - 1)
        distance = take_array(source, arrays, "distance", n, kinds="f", least=0.0, most=MAX_DISTANCE)
        learned_pb = take_array(source, arrays, "learned_pb", (len(names), 2), kinds="f", least=-1.0, most=1.0)
        outcome = np.array(sorted(OUTCOMES))[codes]
        return cls(
            resolution, pb_grid(resolution), outcome, nearest.astype(np.int64), distance, learned_pb, names,
            take_record(header),
        )  # fmt: skip

    def plot(self, path: str | os.PathLike[str] | None = None, **options: Any) -> Any:
        """Draw the map in the manner of the paper's Fig. 4, or coloured by a measure.

        Args:
            path: PNG or SVG to write; with None nothing is written.
            **options: Handed to `picture.draw_map`, such as ``colour="speed"``.

        Returns:
            The matplotlib figure.
        """
        from creative_nao.maps.picture import draw_map

        return draw_map(self, path, **options)


def pb_map(memory: Memory, resolution: int = PAPER_RESOLUTION, criteria: Criteria | None = None) -> PBMap:
    """Generate and score a whole grid of PB points.

    Args:
        memory: A memory with two PB units.
        resolution: Points along each axis; the paper has 200.
        criteria: Where the lines between the outcomes are drawn; default: the paper's.

    Raises:
        SettingsError: If the memory does not have two PB units or `resolution` is below 2.
    """
    if memory.network.n_pb != 2:
        hint = "; `pb_slice` charts two of them" if memory.network.n_pb > 2 else ""
        raise SettingsError(f"a PB map needs a memory with n_pb = 2, but this one has {memory.network.n_pb}{hint}")
    if resolution > MAX_RESOLUTION:
        raise SettingsError(f"`resolution` should be at most {MAX_RESOLUTION}, but is {resolution}")
    criteria = Criteria() if criteria is None else criteria
    pb = pb_grid(resolution)
    trajectories = memory.generate(pb)
    scores = score(trajectories, memory.demonstrations, criteria)
    return PBMap(
        resolution=resolution,
        pb=pb,
        outcome=scores.outcome,
        nearest=scores.nearest,
        distance=scores.novelty,
        learned_pb=memory.pb,
        names=memory.demonstrations.names,
        record=record(settings={"memory": memory.name, "resolution": resolution}),
        trajectories=trajectories,
        dt_s=memory.dt_s,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
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
        from creative_nao.maps.picture import draw_map, write_figure

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
    n_pb = memory.network.n_pb
    pair = tuple(int(k) for k in axes)
    if len(pair) != 2 or pair[0] == pair[1] or not all(0 <= k < n_pb for k in pair):
        raise SettingsError(
            f"`axes` should be two different PB units of this memory, from 0 to {n_pb - 1}, but is {tuple(axes)}"
        )
    if resolution > MAX_RESOLUTION:
        raise SettingsError(f"`resolution` should be at most {MAX_RESOLUTION}, but is {resolution}")
    place = np.zeros(n_pb) if at is None else np.array(at, dtype=np.float64)
    if place.shape != (n_pb,) or not (np.abs(place) <= 1).all():
        raise ShapeError(f"`at` should hold {n_pb} PB values in [-1, 1], but is {place.tolist()}")
    pb = pb_grid(resolution)
    trajectories = memory.generate(_filled(pb, pair, place))
    scores = score(trajectories, memory.demonstrations, Criteria() if criteria is None else criteria)
    settings = {"memory": memory.name, "resolution": resolution, "axes": list(pair), "at": place.tolist()}
    return PBSlice(
        resolution=resolution,
        pb=pb,
        outcome=scores.outcome,
        nearest=scores.nearest,
        distance=scores.novelty,
        learned_pb=memory.pb[:, list(pair)],
        names=memory.demonstrations.names,
        record=record(settings=settings),
        trajectories=trajectories,
        dt_s=memory.dt_s,
        axes=pair,
        at=place,
    )


def _filled(pb: np.ndarray, axes: tuple[int, int], at: np.ndarray) -> np.ndarray:
    full = np.repeat(at[None], len(pb), axis=0)
    full[:, list(axes)] = pb
    return full
