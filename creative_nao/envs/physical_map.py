"""The physical map: every point of a grid over the PB space, performed by the free-standing robot and measured.

The mental map (`maps.pb_map`) scores what the network generates. Here the simulated NAO performs each of those
movements as in `CreativeNao/Boxing-v0`, and what its encoders measured is scored.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from creative_nao.arrays import npz_header, only_arrays, read_npz, save_npz, take
from creative_nao.envs.executors import PhysicsPool, SharedScene, ThreadPool, physics_figures
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError, shown
from creative_nao.joints import JOINTS
from creative_nao.maps import PAPER_RESOLUTION, PBMap, pb_grid
from creative_nao.maps.map import MAX_DISTANCE, MapHeader, grid_fields
from creative_nao.measures import Criteria, dtw_matrix, score
from creative_nao.measures.outcome import (
    ALL_OUTCOMES,
    APPROPRIATE,
    NO_FAULT,
    OUTCOME_CODE,
    PHYSICAL_FAULTS,
    is_fluctuating,
    is_non_moving,
    outcome_codes,
)
from creative_nao.model import Memory
from creative_nao.model.config import check_kind
from creative_nao.robot import PhysicalLimits, first_failure
from creative_nao.runtime import record as provenance
from creative_nao.schema import Field, Index, NonNegative, Text, checked_path, dump, must, parse, record

KIND = "physical PB map"
BLOCK = 256
"""Movements generated, performed and saved together: about ten seconds of one core, 12 MB."""

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
_OUTCOME_ARRAYS = ("outcome", "mental", "fault")
_ARRAYS = ("header", "learned_pb", *_OUTCOME_ARRAYS, "nearest", "distance", *FIGURES)
_CODES = ("", *ALL_OUTCOMES)


def _checked_npz(path: str | os.PathLike[str], name: str = "path") -> Path:
    if (target := checked_path(path, name)).suffix != ".npz":
        raise SettingsError(f"`{name}` should end in .npz, the format of physical maps, but is {shown(path)}")
    return target


@record
class PhysicalMapHeader(MapHeader):
    """What the file of a physical map says beside its arrays."""

    kind: Text
    n_done: Index
    outcomes: Annotated[
        tuple[Text, ...], Field(max_length=100), must(set(_CODES).issuperset, "a list of known outcomes")
    ]
    """What the numbers in the arrays of outcomes mean."""
    wall_s: NonNegative
    cpu_s: NonNegative

    def __post_init__(self) -> None:
        """Refuse more points than the map has."""
        if self.n_done > self.resolution**2:
            raise SettingsError(f"`n_done` should be at most {self.resolution**2}, but is {self.n_done}")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class PhysicalMap(PBMap):
    """A `PBMap` whose movements the robot performed: `outcome`, `nearest` and `distance` are of what it measured.

    Attributes:
        mental: Outcome of the generated movement without a body, that of the mental map, shape (n,) of str.
        fault: First physical failure, also where the command was already too fast, or empty, shape (n,) of str.
        figures: What the performances measured, by the names of `FIGURES`, each of shape (n,), float32.
        n_done: Points performed so far; n in a finished map.
        wall_s: Time that took [s].
        cpu_s: Processor time that took, all threads together [s].
    """

    mental: np.ndarray
    fault: np.ndarray
    figures: dict[str, np.ndarray]
    n_done: int
    wall_s: float
    cpu_s: float

    @property
    def mentally_appropriate(self) -> np.ndarray:
        """Whether each point's movement is appropriate without a body, shape (n,) of bool."""
        return np.isin(self.mental, APPROPRIATE)

    def summary(self) -> dict[str, Any]:
        """Return the figures of the whole map: shares [%], what physics refuses of the mental map, times [s]."""
        both = self.mentally_appropriate & self.appropriate
        n_mental = int(self.mentally_appropriate.sum())
        refused = self.fault[self.mentally_appropriate]
        return {
            "memory": self.memory_name,
            "resolution": self.resolution,
            "n_performed": self.n_done,
            "mentally_appropriate_pct": 100.0 * float(self.mentally_appropriate.mean()),
            "physically_appropriate_pct": 100.0 * float(self.appropriate.mean()),
            "physical_of_mental_pct": 100.0 * int(both.sum()) / n_mental if n_mental else None,
            **{f"{name}_pct": self.share_pct(name) for name in ALL_OUTCOMES},
            "refused_of_mental_pct": {
                name: 100.0 * float(np.mean(refused == name)) if n_mental else None for name in PHYSICAL_FAULTS
            },
            "with_a_hit_pct": 100.0 * float(np.mean(self.figures["hits"] > 0)),
            "median": {name: float(np.median(values)) for name, values in self.figures.items() if name != "fell"},
            "largest": {name: float(values.max()) for name, values in self.figures.items() if name != "fell"},
            "wall_s": round(self.wall_s, 1),
            "cpu_s": round(self.cpu_s, 1),
        }

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the map to an NPZ file without pickle, in one step, and return its path, which ends in .npz."""
        own = {name: getattr(self, name) for name in ("resolution", "n_done", "names", "wall_s", "cpu_s", "record")}
        header = dump(PhysicalMapHeader(kind=KIND, format_version=1, outcomes=_CODES, **own))
        arrays = {
            "nearest": self.nearest.astype(np.int16),
            "distance": self.distance,
            "learned_pb": self.learned_pb,
            **{
                name: np.array([_CODES.index(word) for word in getattr(self, name)], dtype=np.int8)
                for name in _OUTCOME_ARRAYS
            },
            **self.figures,
        }
        return save_npz(_checked_npz(path), header, arrays)

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
        source = checked_path(path)
        if not source.is_file():
            raise NotFoundError(
                f"no physical map at {source}; make one with `creative-nao map MEMORY --physical --out {source}`"
            )
        arrays = read_npz(source, KIND)
        only_arrays(source, arrays, _ARRAYS)
        values = npz_header(source, arrays, KIND)
        if not isinstance(values, dict) or values.get("kind") != KIND:
            raise FileFormatError(f"{source}: not a {KIND}")
        header = parse(PhysicalMapHeader, values, f"{source}: `header`")
        n = header.resolution**2
        if header.n_done < n and not unfinished:
            raise FileFormatError(
                f"{source}: {header.n_done} of {n} points are performed; "
                "finish it with `creative-nao map MEMORY --physical --resume`"
            )
        outcomes = np.array(header.outcomes, dtype="<U16")
        fields = grid_fields(source, header, arrays)
        fields["distance"] = fields["distance"].astype(np.float32)
        for name in _OUTCOME_ARRAYS:
            fields[name] = outcomes[take(source, arrays, name, (n,), kinds="iu", least=0, most=len(outcomes) - 1)]
        fields["figures"] = {
            name: take(source, arrays, name, (n,), least=0.0, most=MAX_DISTANCE).astype(np.float32) for name in FIGURES
        }
        return cls(**fields, n_done=header.n_done, wall_s=header.wall_s, cpu_s=header.cpu_s)

    def plot(self, path: str | os.PathLike[str] | None = None, **options: Any) -> Any:
        """Draw the map in the manner of the mental one; the options are those of `PBMap.plot`."""
        title = f"Memory {self.memory_name} on the robot: {100 * self.appropriate.mean():.1f} % is appropriate"
        return super().plot(path, **{"title": title, **options})


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
        checkpoint: NPZ file that keeps what is done after every block; if it is there, the work goes on where it ended.
            The finished map has the same bits either way; the file stays.

    Raises:
        SettingsError: If the memory does not suit, or the checkpoint belongs to other settings.
        FileFormatError: If the checkpoint is torn or foreign.
    """
    criteria, limits = criteria or Criteria(), limits or PhysicalLimits()
    check_kind(memory, Memory, "memory")
    check_kind(criteria, Criteria, "criteria")
    check_kind(limits, PhysicalLimits, "limits")
    if memory.network.n_pb != 2 or memory.joints != JOINTS:
        raise SettingsError(
            f"a physical map needs a memory with n_pb = 2 and the joints {', '.join(JOINTS)}, "
            f"but this one has {memory.network.n_pb} and {', '.join(memory.joints)}"
        )
    if checkpoint is not None:
        checkpoint = _checked_npz(checkpoint, "checkpoint")
    result = _blank(memory, resolution, criteria, limits)
    if checkpoint is not None and checkpoint.exists():
        result = _continued(result, checkpoint)
    total = len(result.outcome)
    if progress is not None:
        progress(result.n_done, total)
    with closing(ThreadPool(n_threads)) as threads:
        pool = PhysicsPool(threads, SharedScene(bare=True))
        while result.n_done < total:
            result = _with_next_block(result, memory, pool, criteria, limits)
            if checkpoint is not None:
                result.save(checkpoint)
            if progress is not None:
                progress(result.n_done, total)
    return result


def _blank(memory: Memory, resolution: int, criteria: Criteria, limits: PhysicalLimits) -> PhysicalMap:
    pb = pb_grid(resolution)
    settings = {
        "memory": memory.name, "sha256": fingerprint(memory), "resolution": resolution,
        "criteria": vars(criteria), "limits": vars(limits),
    }  # fmt: skip
    n, none = len(pb), np.full(len(pb), "", dtype="<U16")
    return PhysicalMap(
        resolution, pb, none, np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.float32), memory.pb,
        memory.demonstrations.names, provenance(settings=settings), mental=none.copy(), fault=none.copy(),
        figures={name: np.zeros(n, dtype=np.float32) for name in FIGURES}, n_done=0, wall_s=0.0, cpu_s=0.0,
    )  # fmt: skip


def fingerprint(memory: Memory) -> str:
    """Return a hash that tells memories of one name apart: network settings, weights and basic actions.

    Physical maps hold it, so it stays as it is; the explorer has another (`explorer.registry.content_hash`).
    """
    digest = hashlib.sha256(json.dumps(vars(memory.network), sort_keys=True, default=str).encode())
    parameters = [memory.parameters[name] for name in sorted(memory.parameters)]
    for array in (*parameters, *memory.demonstrations.trajectories):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _continued(blank: PhysicalMap, checkpoint: Path) -> PhysicalMap:
    """Return what the checkpoint holds, if it was begun with the same settings."""
    partial = PhysicalMap.load(checkpoint, unfinished=True)
    theirs = partial.record.get("settings", {})
    for key, value in blank.record["settings"].items():
        if (other := theirs.get(key)) != value:
            raise SettingsError(
                f"{checkpoint} was begun with {key} = {other}, not {value}; delete it or choose another checkpoint"
            )
    return partial


def _with_next_block(
    partial: PhysicalMap, memory: Memory, pool: PhysicsPool, criteria: Criteria, limits: PhysicalLimits
) -> PhysicalMap:
    """Generate, perform and score the next movements, write them into the arrays and return the map with its times."""
    wall, cpu = time.monotonic(), time.process_time()
    rows = slice(partial.n_done, min(partial.n_done + BLOCK, len(partial.outcome)))
    basic = memory.demonstrations
    generated = memory.generate(partial.pb[rows])
    performances = [one for one, _ in pool.perform(generated, [memory.dt_s] * len(generated))]
    measured = np.stack([one.measured for one in performances])
    faults = [first_failure(one, limits) or "" for one in performances]
    distances = dtw_matrix(measured, basic.trajectories)
    codes = outcome_codes(
        distances.min(axis=1),
        too_fast=is_fluctuating(generated, basic, criteria),
        non_moving=is_non_moving(measured, basic, criteria),
        fault=np.array([OUTCOME_CODE.get(fault, NO_FAULT) for fault in faults]),
        learned_threshold=criteria.learned_threshold,
    )
    partial.nearest[rows], partial.distance[rows] = distances.argmin(axis=1), distances.min(axis=1)
    partial.outcome[rows], partial.fault[rows] = np.array(ALL_OUTCOMES)[codes], faults
    partial.mental[rows] = score(generated, basic, criteria).outcome
    figures = [{**physics_figures(one), "limit_excess": one.limit_excess_rad} for one in performances]
    for name, values in partial.figures.items():
        values[rows] = [one[name] for one in figures]
    return dataclasses.replace(
        partial,
        n_done=rows.stop,
        wall_s=partial.wall_s + time.monotonic() - wall,
        cpu_s=partial.cpu_s + time.process_time() - cpu,
    )
