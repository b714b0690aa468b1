"""What the robot's body makes of a PB map: outcomes and figures of every point, in one file."""

from __future__ import annotations

import io
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao.atomic import write_bytes
from creative_nao.envs.observation import APPROPRIATE, OF_THE_BODY, OUTCOMES
from creative_nao.errors import FileFormatError, NotFoundError
from creative_nao.fields import only_arrays, shown
from creative_nao.npz import read_npz, take_array, take_header, take_record
from creative_nao.pb_space import pb_grid

FORMAT_VERSION = 1
KIND = "physical PB map"
MAX_RESOLUTION = 4000
MAX_FIGURE = 1e30
"""Largest figure of a file; float32 ends at 3e38."""

FIGURES: dict[str, str] = {
    "tracking_error": "mean error of the worst joint [rad]",
    "torque_saturated": "share of the time of the worst motor at its torque limit",
    "self_collision": "share of the time in which the robot touches itself",
    "limit_excess": "how far the command leaves the joint ranges at most [rad]",
    "fell": "1 after a fall",
    "hits": "hits on the bag",
    "hit_impulse": "force on the bag, integrated [N s]",
    "fist_speed": "largest speed of a fist [m/s]",
}
"""What is kept of every performance, float32."""
_CODES = ("", *OUTCOMES)


@dataclass(eq=False)
class PhysicalMap:
    """A grid over the PB space, performed by the robot; it can be drawn like a `PBMap`.

    Attributes:
        resolution: Points along each axis; there are n = resolution^2.
        pb: The points, shape (n, 2), in the order of `pb_space.pb_grid`.
        outcome: One of `envs.observation.OUTCOMES` each, as the environment gives it, shape (n,) of str.
        mental: What the generated movement is without a body: the outcome of the mental map, shape (n,) of str.
        fault: First physical failure, also where the command was already too fast, or empty, shape (n,) of str.
        nearest: Which basic action the measured movement is nearest to, shape (n,) of int.
        distance: DTW distance of the measured movement to it [rad], shape (n,), float32.
        figures: What the performances measured, by the names of `FIGURES`, each of shape (n,), float32.
        learned_pb: Where the basic actions themselves lie, shape (n_actions, 2).
        names: Names of the basic actions.
        record: Memory, settings and versions that made the map.
        n_done: Points performed so far; n in a finished map.
        wall_s: Time that took [s].
        cpu_s: Processor time that took, all threads together [s].
    """

    resolution: int
    pb: np.ndarray
    outcome: np.ndarray
    mental: np.ndarray
    fault: np.ndarray
    nearest: np.ndarray
    distance: np.ndarray
    figures: dict[str, np.ndarray]
    learned_pb: np.ndarray
    names: tuple[str, ...]
    record: dict[str, Any]
    n_done: int
    wall_s: float
    cpu_s: float

    @property
    def appropriate(self) -> np.ndarray:
        """Whether each point's movement is appropriate on the robot, shape (n,) of bool."""
        return np.isin(self.outcome, APPROPRIATE)

    @property
    def mentally_appropriate(self) -> np.ndarray:
        """Whether each point's movement is appropriate in the mind, shape (n,) of bool."""
        return np.isin(self.mental, APPROPRIATE)

    def share_pct(self, outcome: str) -> float:
        """Return the share of the map with this outcome [%]."""
        return 100.0 * float(np.mean(self.outcome == outcome))

    def learned_region_pct(self) -> np.ndarray:
        """Return the share of the map where each basic action comes back on the robot [%], shape (n_actions,)."""
        mine = self.nearest[None, :] == np.arange(len(self.names))[:, None]
        return 100.0 * np.mean(mine & (self.outcome == "learned"), axis=1)

    def summary(self) -> dict[str, Any]:
        """Return the figures of the whole map: shares [%], what the body refuses of what the mind allows, times [s]."""
        both = self.mentally_appropriate & self.appropriate
        n_mental = int(self.mentally_appropriate.sum())
        refused = self.fault[self.mentally_appropriate]
        return {
            "memory": self.record.get("settings", {}).get("memory", ""),
            "resolution": self.resolution,
            "n_performed": self.n_done,
            "mentally_appropriate_pct": 100.0 * float(self.mentally_appropriate.mean()),
            "physically_appropriate_pct": 100.0 * float(self.appropriate.mean()),
            "physical_of_mental_pct": 100.0 * int(both.sum()) / n_mental if n_mental else None,
            **{f"{name}_pct": self.share_pct(name) for name in OUTCOMES},
            "refused_of_mental_pct": {
                name: 100.0 * float(np.mean(refused == name)) if n_mental else None for name in OF_THE_BODY
            },
            "with_a_hit_pct": 100.0 * float(np.mean(self.figures["hits"] > 0)),
            "median": {name: float(np.median(values)) for name, values in self.figures.items() if name != "fell"},
            "largest": {name: float(values.max()) for name, values in self.figures.items() if name != "fell"},
            "wall_s": round(self.wall_s, 1),
            "cpu_s": round(self.cpu_s, 1),
        }

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the map to an NPZ file without pickle, in one step, and return its path."""
        header = {
            "kind": KIND,
            "format_version": FORMAT_VERSION,
            "resolution": self.resolution,
            "n_done": self.n_done,
            "names": list(self.names),
            "outcomes": list(_CODES),
            "wall_s": self.wall_s,
            "cpu_s": self.cpu_s,
            "record": self.record,
        }
        codes = {name: np.array([_CODES.index(word) for word in getattr(self, name)], dtype=np.int8) for name in _WORDS}
        # In memory first, as a mental map is written. Plain numbers only: nothing is pickled.
        arrays: dict[str, Any] = {
            "header": np.frombuffer(json.dumps(header, allow_nan=False).encode(), dtype=np.uint8),
            "nearest": self.nearest.astype(np.int16),
            "distance": self.distance,
            "learned_pb": self.learned_pb,
            **codes,
            **self.figures,
        }
        content = io.BytesIO()
        np.savez_compressed(content, **arrays)
        return write_bytes(path, content.getvalue())

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, unfinished: bool = False) -> PhysicalMap:
        """Read a map back.

        Args:
            path: NPZ file.
            unfinished: Also take a checkpoint in which points are still missing.

        Raises:
            NotFoundError: If there is no such file.
            FileFormatError: If it is torn, foreign or unfinished; the message names the part.
        """
        source = Path(path)
        if not source.is_file():
            raise NotFoundError(
                f"no physical map at {source}; make one with `creative-nao map MEMORY --physical --out {source}`"
            )
        arrays = read_npz(source, KIND, largest=64 * MAX_RESOLUTION**2)
        only_arrays(source, arrays, ("header", "learned_pb", *_ARRAYS))
        header = take_header(source, arrays, KIND)
        if header.values.get("kind") != KIND:
            raise FileFormatError(f"{source}: not a {KIND} of format {FORMAT_VERSION}")
        header.version("format_version", FORMAT_VERSION)
        resolution, names = header.whole("resolution", 2, MAX_RESOLUTION), header.names("names")
        n_done = header.whole("n_done", 0, resolution**2)
        known = header.listed("outcomes", most=100)
        if foreign := [word for word in known if word not in _CODES]:
            raise FileFormatError(f"{header.where}: `outcomes` should hold known ones, not {shown(foreign[0])}")
        codebook = np.array(known, dtype="<U16")
        for name in _WORDS:
            take_array(source, arrays, name, (resolution**2,), kinds="iu", least=0, most=len(codebook) - 1)
        take_array(source, arrays, "nearest", (resolution**2,), kinds="iu", least=0, most=len(names) - 1)
        for name in ("distance", *FIGURES):
            take_array(source, arrays, name, (resolution**2,), kinds="f", least=0.0, most=MAX_FIGURE)
        take_array(source, arrays, "learned_pb", (len(names), 2), kinds="f", least=-1.0, most=1.0)
        if not unfinished and n_done != resolution**2:
            raise FileFormatError(
                f"{source}: {n_done} of {resolution**2} points are performed; "
                "finish it with `creative-nao map MEMORY --physical --resume`"
            )
        return cls(
            resolution=resolution,
            pb=pb_grid(resolution),
            **{name: codebook[arrays[name]] for name in _WORDS},
            nearest=arrays["nearest"].astype(np.int64),
            distance=arrays["distance"].astype(np.float32),
            figures={name: arrays[name].astype(np.float32) for name in FIGURES},
            learned_pb=arrays["learned_pb"],
            names=names,
            record=take_record(header),
            n_done=n_done,
            wall_s=header.number("wall_s", least=0.0),
            cpu_s=header.number("cpu_s", least=0.0),
        )

    def plot(self, path: str | os.PathLike[str] | None = None, **options: Any) -> Any:
        """Draw the map in the manner of the mental one; see `pb_space.picture.draw_map` for the options."""
        from creative_nao.pb_space.picture import draw_map

        if "title" not in options:
            memory = self.record.get("settings", {}).get("memory", "")
            options["title"] = f"Memory {memory} on the robot: {100 * self.appropriate.mean():.1f} % is appropriate"
        drawable: Any = self  # has everything that is drawn of a `PBMap`
        return draw_map(drawable, path, **options)


_WORDS = ("outcome", "mental", "fault")
_ARRAYS = (*_WORDS, "nearest", "distance", *FIGURES)
