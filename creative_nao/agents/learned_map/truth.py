"""The truth of a memory at spread PB points: what a learned map is taught, and where its training is judged."""

from __future__ import annotations

import functools
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from creative_nao.arrays import load_tensors, only_arrays, save_tensors, take
from creative_nao.envs.rollout import DECISION_TICKS, held_in_turn
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError
from creative_nao.maps import pb_grid
from creative_nao.measures import dtw_matrix, reward_scale, score
from creative_nao.measures.outcome import ALL_OUTCOMES, APPROPRIATE, OUTCOME_CODE
from creative_nao.model import Memory, load_memory, shipped_memories, split_of
from creative_nao.schema import Count, LongText, Version1, parse, record

KIND = "memory truth"
ENDING = ".truth.safetensors"
_ARRAYS = ("pb", "outcome", "distances", "gaps", "learned_pb", "basic_gaps")
N_POINTS = 1024
MAX_DISTANCE = 1e4
"""In units of the reward; half precision ends at 65,504."""


@record
class _TruthHeader:
    format_version: Version1
    name: LongText
    n_segments: Count = 1


@dataclass(frozen=True, eq=False)
class MemoryTruth:
    """What n spread PB points of a memory generate; distances are in units of the reward (`reward_scale`).

    Attributes:
        name: Of the memory.
        pb: The points, shape (n, n_pb), float32.
        outcome: Code of each one's outcome, its place in `ALL_OUTCOMES`, shape (n,), int8.
        distances: To every basic action, shape (n, n_basic), float32.
        gaps: Between what the points generate, shape (n, n), float16, symmetric.
        learned_pb: The learned PB points, shape (n_basic, n_pb), float32.
        basic_gaps: Distances between the basic actions, shape (n_basic, n_basic), float32.
        n_segments: PB vectors of a movement, each held for an equal part of it (`envs.rollout.held_in_turn`); a point
            is all of them, one after the other, and n_pb counts all their values.
    """

    name: str
    pb: np.ndarray
    outcome: np.ndarray
    distances: np.ndarray
    gaps: np.ndarray
    learned_pb: np.ndarray
    basic_gaps: np.ndarray
    n_segments: int = 1

    @functools.cached_property
    def appropriate(self) -> np.ndarray:
        """Whether each point can be used, shape (n,) of bool."""
        return self.outcome < len(APPROPRIATE)

    @property
    def form(self) -> tuple[int, int]:
        """Values of a point and basic actions, which all memories of one training have in common."""
        return self.pb.shape[1], len(self.learned_pb)

    @property
    def n_units(self) -> int:
        """PB units of the memory."""
        return self.pb.shape[1] // self.n_segments

    def save(self, path: Path) -> Path:
        """Write it to a file in one step and return its path."""
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        header = {"format_version": 1, "name": self.name, "n_segments": self.n_segments}
        return save_tensors(path, kind=KIND, header=header, tensors=arrays)

    @classmethod
    def load(cls, path: Path) -> MemoryTruth:
        """Read a file of `save`; a torn or foreign one is a `FileFormatError` that names the part."""
        values, arrays = load_tensors(path, kind=KIND)
        only_arrays(path, arrays, _ARRAYS)
        header = parse(_TruthHeader, values, f"{path}: header")
        pb = take(path, arrays, "pb", (None, None), np.float32, least=-1.0, most=1.0)
        learned = take(path, arrays, "learned_pb", (None, pb.shape[1]), np.float32, least=-1.0, most=1.0)
        n, n_basic, far = len(pb), len(learned), functools.partial(take, path, arrays, least=0.0, most=MAX_DISTANCE)
        outcome = take(path, arrays, "outcome", (n,), np.int8, kinds="i", least=0, most=len(ALL_OUTCOMES) - 1)
        distances, gaps = far("distances", (n, n_basic), np.float32), far("gaps", (n, n), np.float16)
        if pb.shape[1] % header.n_segments:
            raise FileFormatError(f"{path}: points of {pb.shape[1]} values are no {header.n_segments} PB vectors")
        basic_gaps = far("basic_gaps", (n_basic, n_basic), np.float32)
        return cls(header.name, pb, outcome, distances, gaps, learned, basic_gaps, header.n_segments)


@functools.cache
def spread_points(n_pb: int, n: int) -> np.ndarray:
    """Return PB points spread over [-1, 1]^n_pb, the same each time: float64 of shape (n, n_pb).

    With two PB units the square grid with at most `n` points, its edges included; else a scrambled Sobol sequence.
    """
    if n_pb == 2:
        return pb_grid(max(2, int(np.sqrt(n))))
    from scipy.stats import qmc

    drawn = qmc.Sobol(n_pb, scramble=True, rng=np.random.default_rng(0)).random_base2(max(n - 1, 1).bit_length())
    return 2.0 * drawn[:n] - 1.0


def memory_truth(memory: Memory, name: str = "", n_points: int = N_POINTS, n_segments: int = 1) -> MemoryTruth:
    """Generate and score spread points of a memory; some two seconds of a core for the 1,024 points."""
    pb, basic = spread_points(memory.pb.shape[1] * n_segments, n_points), memory.demonstrations
    unit, n_steps = reward_scale(basic), memory.n_steps
    path = held_in_turn(pb, n_segments, -(-n_steps // DECISION_TICKS)).repeat(DECISION_TICKS, axis=1)[:, :n_steps]
    trajectories = memory.generate(pb) if n_segments == 1 else memory.generator(path, n_steps)
    scored = score(trajectories, basic)
    return MemoryTruth(
        name=name or memory.name,
        pb=pb.astype(np.float32),
        outcome=np.array([OUTCOME_CODE[one] for one in scored.outcome], np.int8),
        distances=(scored.distances / unit).astype(np.float32),
        gaps=(dtw_matrix(trajectories, dtype=np.float32) / unit).astype(np.float16),
        learned_pb=np.tile(memory.pb, (1, n_segments)).astype(np.float32),
        basic_gaps=(dtw_matrix(basic.trajectories) / unit).astype(np.float32),
        n_segments=n_segments,
    )


def kept_truth(
    memory: Memory, path: Path, name: str = "", n_points: int = N_POINTS, n_segments: int = 1
) -> MemoryTruth:
    """Return the truth of a memory that a file holds; where it holds none, or another one's, it is made and written."""
    if path.is_file():
        truth = MemoryTruth.load(path)
        points = spread_points(memory.pb.shape[1] * n_segments, n_points).astype(np.float32)
        learned = np.tile(memory.pb, (1, n_segments)).astype(np.float32)
        kept = truth.n_segments == n_segments and np.array_equal(truth.pb, points)
        if kept and np.array_equal(truth.learned_pb, learned):
            return truth
    truth = memory_truth(memory, name, n_points, n_segments)
    truth.save(path)
    return truth


def truth_file(folder: Path, name: str) -> Path:
    """Return where the truth of a memory is kept."""
    return folder / f"{name.replace('/', '-')}{ENDING}"


def read_truths(folder: str | os.PathLike[str]) -> list[MemoryTruth]:
    """Read all truths of a folder, in the order of their names; a `NotFoundError` if there is none."""
    paths = sorted(Path(folder).glob(f"*{ENDING}"))
    if not paths:
        raise NotFoundError(f"no truths of memories in {folder}: `creative-nao agent memories --out {folder}`")
    return [MemoryTruth.load(path) for path in paths]


def bank_truths(names: Sequence[str], folder: Path, n_segments: int = 1) -> list[MemoryTruth]:
    """Return the truths of shipped memories; those that `folder` does not hold are made, and kept there."""
    return [kept_truth(load_memory(name), truth_file(folder, name), n_segments=n_segments) for name in names]


@functools.cache
def _test_points() -> dict[bytes, str]:
    names = [name for name in shipped_memories(None) if split_of(name).startswith("test")]
    return {load_memory(name).pb.astype(np.float32).tobytes(): name for name in names}


def refuse_test_memories(truths: Sequence[MemoryTruth], where: str) -> None:
    """Refuse truths among which one is of a test memory, whatever its name: its learned points tell it."""
    for truth in truths:
        if (name := _test_points().get(truth.learned_pb[:, : truth.n_units].tobytes())) is not None:
            raise SettingsError(f"{where} should not hold a test memory of the bank, but `{truth.name}` is {name}")
