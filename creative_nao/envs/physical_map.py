"""The physical map: every point of a grid over the PB space, performed by the free-standing robot and measured.

The mental map (`pb_space.pb_map`) scores what the network imagines. Here the simulated NAO performs each of those
movements as in `CreativeNao/Boxing-v0`, and what its encoders measured is scored.

Also here:
- What the robot's body makes of a PB map: outcomes and figures of every point, in one file.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from creative_nao.arrays import read_npz
from creative_nao.arrays import take as take_array
from creative_nao.envs.executors import body_figures
from creative_nao.envs.observation import APPROPRIATE, OF_THE_BODY, OUTCOMES
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError
from creative_nao.fields import only_arrays, shown, take_header, take_record
from creative_nao.joints import JOINTS
from creative_nao.maps import PAPER_RESOLUTION, pb_grid
from creative_nao.measures import Criteria, dtw_matrix, score
from creative_nao.measures.outcome import is_fluctuating, is_non_moving
from creative_nao.model import Memory
from creative_nao.robot import PhysicalLimits, first_failure
from creative_nao.runtime import record, usable_cores
from creative_nao.storage import write_bytes

if TYPE_CHECKING:
    from creative_nao.robot.performance import Performance
    from creative_nao.robot.playback import Performer


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
        from creative_nao.maps.picture import draw_map

        if "title" not in options:
            memory = self.record.get("settings", {}).get("memory", "")
            options["title"] = f"Memory {memory} on the robot: {100 * self.appropriate.mean():.1f} % is appropriate"
        drawable: Any = self  # has everything that is drawn of a `PBMap`
        return draw_map(drawable, path, **options)


_WORDS = ("outcome", "mental", "fault")
_ARRAYS = (*_WORDS, "nearest", "distance", *FIGURES)


BLOCK = 256
"""Movements generated, performed and saved together: about ten seconds of one core, 12 MB."""


class Crowd:
    """Several robots of one scene that perform movements side by side, one a thread: `crew.Bodies` without a picture.

    MuJoCo steps without holding Python back, so two threads on two free cores perform twice as much. A movement gives
    the same bits as `Performer.perform` gives alone, whichever thread performs it.

    Args:
        n_threads: How many; default: as many as this process may use.
    """

    def __init__(self, n_threads: int | None = None) -> None:
        from creative_nao.robot import Performer, bare_scene

        n_threads = usable_cores() if n_threads is None else n_threads
        if n_threads < 1:
            raise SettingsError(f"`n_threads` should be at least 1, but is {n_threads}")
        scene = bare_scene()
        self._free: list[Performer] = [Performer(scene) for _ in range(n_threads)]
        self._lock = threading.Lock()
        self._pool = ThreadPoolExecutor(n_threads)

    def perform(self, trajectories: np.ndarray, dt_s: float) -> list[Performance]:
        """Perform trajectories, (n, n_steps, 8) [rad] at ticks of `dt_s` [s], in their order."""
        return list(self._pool.map(lambda one: self._one(one, dt_s), trajectories))

    def _one(self, trajectory: np.ndarray, dt_s: float) -> Performance:
        with self._lock:
            performer = self._free.pop()
        try:
            return performer.perform(trajectory, dt_s)
        finally:
            with self._lock:
                self._free.append(performer)

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def __enter__(self) -> Crowd:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def physical_map(
    memory: Memory,
    resolution: int = PAPER_RESOLUTION,
    *,
    n_threads: int | None = None,
    criteria: Criteria | None = None,
    limits: PhysicalLimits | None = None,
    progress: Callable[[int, int], None] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> PhysicalMap:
    """Let the robot perform a whole grid of PB points; 200 x 200 take about 25 minutes of one core.

    Args:
        memory: A memory of the NAO's eight arm joints with two PB units.
        resolution: Points along each axis; the paper has 200.
        n_threads: Movements performed at the same time; default: one a core.
        criteria: Where the lines between the outcomes are drawn; default: the paper's.
        limits: From where on a performance counts as failed.
        progress: Called with the movements done and their number after every block.
        checkpoint: File that keeps what is done after every block; if it is there, the work goes on where it ended.
            The finished map has the same bits either way; the file stays.

    Raises:
        SettingsError: If the memory does not suit, or the checkpoint belongs to other settings.
        FileFormatError: If the checkpoint is torn or foreign.
    """
    if memory.network.n_pb != 2 or memory.joints != JOINTS:
        raise SettingsError(
            f"a physical map needs a memory with n_pb = 2 and the joints {', '.join(JOINTS)}, "
            f"but this one has {memory.network.n_pb} and {', '.join(memory.joints)}"
        )
    criteria, limits = criteria or Criteria(), limits or PhysicalLimits()
    chart = _blank(memory, resolution, criteria, limits)
    if checkpoint is not None and Path(checkpoint).exists():
        chart = _continued(chart, Path(checkpoint))
    total = len(chart.outcome)
    if progress is not None:
        progress(chart.n_done, total)
    with Crowd(n_threads) as crowd:
        while chart.n_done < total:
            _next_block(chart, memory, crowd, criteria, limits)
            if checkpoint is not None:
                chart.save(checkpoint)
            if progress is not None:
                progress(chart.n_done, total)
    return chart


def _blank(memory: Memory, resolution: int, criteria: Criteria, limits: PhysicalLimits) -> PhysicalMap:
    pb = pb_grid(resolution)
    settings = {
        "memory": memory.name,
        "sha256": fingerprint(memory),
        "resolution": resolution,
        "criteria": vars(criteria),
        "limits": vars(limits),
    }
    n = len(pb)
    return PhysicalMap(
        resolution=resolution,
        pb=pb,
        outcome=np.full(n, "", dtype="<U16"),
        mental=np.full(n, "", dtype="<U16"),
        fault=np.full(n, "", dtype="<U16"),
        nearest=np.zeros(n, dtype=np.int64),
        distance=np.zeros(n, dtype=np.float32),
        figures={name: np.zeros(n, dtype=np.float32) for name in FIGURES},
        learned_pb=memory.pb,
        names=memory.demonstrations.names,
        record=record(settings=settings),
        n_done=0,
        wall_s=0.0,
        cpu_s=0.0,
    )


def fingerprint(memory: Memory) -> str:
    """Return what tells memories apart that share a name: a hash of network settings, weights and basic actions.

    Physical maps hold it, so it stays as it is; the explorer has another (`explorer.maps.content_hash`).
    """
    digest = hashlib.sha256(json.dumps(vars(memory.network), sort_keys=True, default=str).encode())
    for array in (
        *(memory.parameters[name] for name in sorted(memory.parameters)),
        *memory.demonstrations.trajectories,
    ):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _continued(blank: PhysicalMap, checkpoint: Path) -> PhysicalMap:
    """Return what the checkpoint holds, if it was begun with the same settings."""
    begun = PhysicalMap.load(checkpoint, unfinished=True)
    ours, theirs = blank.record["settings"], begun.record.get("settings", {})
    for key, value in ours.items():
        if theirs.get(key) != value:
            raise SettingsError(
                f"{checkpoint} was begun with {key} = {theirs.get(key)}, not {value}; "
                "delete it or choose another checkpoint"
            )
    return begun


def _next_block(chart: PhysicalMap, memory: Memory, crowd: Crowd, criteria: Criteria, limits: PhysicalLimits) -> None:
    """Generate, perform and score the next movements and write them into the map."""
    wall, cpu = time.monotonic(), time.process_time()
    rows = slice(chart.n_done, min(chart.n_done + BLOCK, len(chart.outcome)))
    generated = memory.generate(chart.pb[rows])
    done = crowd.perform(generated, memory.dt_s)
    measured = np.stack([one.measured for one in done])
    faults = np.array([first_failure(one, limits) or "" for one in done])
    distances = dtw_matrix(measured, memory.demonstrations.trajectories)
    chart.nearest[rows] = distances.argmin(axis=1)
    chart.distance[rows] = distances.min(axis=1)
    chart.fault[rows] = faults
    chart.mental[rows] = score(generated, memory.demonstrations, criteria).outcome
    chart.outcome[rows] = _outcomes(generated, measured, faults, distances.min(axis=1), memory, criteria)
    for name, values in _figures(done).items():
        chart.figures[name][rows] = values
    chart.n_done = rows.stop
    chart.wall_s += time.monotonic() - wall
    chart.cpu_s += time.process_time() - cpu


def _outcomes(
    generated: np.ndarray,
    measured: np.ndarray,
    faults: np.ndarray,
    distance: np.ndarray,
    memory: Memory,
    criteria: Criteria,
) -> np.ndarray:
    """Name the outcomes as `Episodes.score` does: speed on the command, then the body, then what was measured."""
    outcome = np.where(distance <= criteria.learned_threshold, "learned", "unlearned").astype("<U16")
    outcome[is_non_moving(measured, memory.demonstrations, criteria)] = "non_moving"
    outcome = np.where(faults == "", outcome, faults)
    outcome[is_fluctuating(generated, memory.demonstrations, criteria)] = "fluctuating"
    return outcome


def _figures(done: list[Performance]) -> dict[str, list[float]]:
    """Return the figures of `physical_chart.FIGURES`, a list each: those of an environment's `info` and one more."""
    told = [{**body_figures(one), "limit_excess": one.limit_excess_rad} for one in done]
    return {name: [one[name] for one in told] for name in FIGURES}
