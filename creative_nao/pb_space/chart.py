"""The PB map: every point of a grid over the PB space, performed in the mind and scored."""

from __future__ import annotations

import io
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao.atomic import write_bytes
from creative_nao.errors import NotFoundError, SettingsError
from creative_nao.fields import only_arrays
from creative_nao.measures import OUTCOMES, Criteria, score
from creative_nao.measures.score import APPROPRIATE
from creative_nao.model import Memory
from creative_nao.npz import read_npz, take_array, take_header, take_record
from creative_nao.pb_space.grid import PAPER_RESOLUTION, pb_grid
from creative_nao.provenance import record

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
        from creative_nao.pb_space.picture import draw_map

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
