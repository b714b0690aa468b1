"""The physical map: every point of a grid over the PB space, performed by the free-standing robot and measured.

The mental map (`pb_space.pb_map`) scores what the network imagines. Here the simulated NAO performs each of those
movements as in `CreativeNao/Boxing-v0`, and what its encoders measured is scored.
"""

from __future__ import annotations

import hashlib
import json
import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from creative_nao.cores import usable_cores
from creative_nao.envs.performers import body_figures
from creative_nao.envs.physical_chart import FIGURES, PhysicalMap
from creative_nao.errors import SettingsError
from creative_nao.joints import JOINTS
from creative_nao.measures import Criteria, dtw_matrix, score
from creative_nao.measures.appropriateness import is_fluctuating, is_non_moving
from creative_nao.model import Memory
from creative_nao.pb_space import PAPER_RESOLUTION, pb_grid
from creative_nao.provenance import record
from creative_nao.robot import PhysicalLimits, first_failure

if TYPE_CHECKING:
    from creative_nao.robot.performance import Performance
    from creative_nao.robot.playback import Performer

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
