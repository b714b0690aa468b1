"""Closed-loop generation: PB points in, joint trajectories out (Eq. 1-3, 5 at ratio 1, 7).

A trajectory has the same bits alone, in a batch, with any number of threads, and when it is generated a few ticks at a
time. That matters, because where the map is rugged the closed loop amplifies a difference in the last bit into another
movement.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures.dtw import as_numbers
from creative_nao.model.config import NetworkSettings, layer_time_constants
from creative_nao.model.encoding import SoftmaxEncoding
from creative_nao.runtime import usable_cores

BATCH = 64  # most points in a compiled batch: all activations still lie in a fast cache
DIFFERENTIATED_BATCH = 32  # the same where derivatives are computed too
FEW_POINTS = 2  # up to this many points, one at a time is faster than a batch
SERIAL_BATCHES = 8  # up to this many batches, starting threads costs more than it saves


@dataclass(eq=False)
class Rollout:
    """The state of n movements that are generated a few ticks at a time."""

    tick: int  # postures generated so far
    code: np.ndarray  # what the network reads next: the code of its last prediction, (n, n_codes) float32
    state: np.ndarray  # internal states u of all hidden units, (n, n_hidden) float32
    activity: np.ndarray  # y = tanh(u) of the layers P_F, P_M, P_S one after the other, (n, n_hidden) float32

    def __len__(self) -> int:
        return len(self.code)


class ClosedLoopGenerator:
    """A trained network prepared for generation.

    Args:
        settings: Sizes and time constants.
        parameters: By name, shapes as in `config.parameter_shapes`, float32; copied.
        encoding: The joints' softmax code.
        initial_posture: Joint angles at tick 0 [rad], shape (n_joints,).

    Attributes:
        n_pb: PB units.
        n_hidden: Units of all hidden layers.
        n_slow: Units of the slowest layer, P_S: the last of the hidden ones.
        initial_posture: As given, float64.
    """

    def __init__(
        self,
        settings: NetworkSettings,
        parameters: dict[str, np.ndarray],
        encoding: SoftmaxEncoding,
        initial_posture: np.ndarray,
    ) -> None:
        self.n_pb, self.n_hidden, self.n_slow = settings.n_pb, settings.n_hidden, settings.layer_sizes[-1]
        weights = [parameters[name].copy() for name in ("w_in", "w_out", "w_hidden", "w_pb")]
        rest = (
            parameters["b_out"].copy(),
            parameters["b_hidden"].copy(),
            np.concatenate([[0], np.cumsum(settings.layer_sizes)]),  # first unit of each layer, and their number
            np.float32(1) / layer_time_constants(settings),
            encoding.references.astype(np.float32),  # angles of the code [rad], (n_joints, n_units)
        )
        # What compiled code reads, as plain tuples: a call with a named one takes half a microsecond longer.
        self._by_presynaptic = (*weights, *rest)
        self._by_postsynaptic = (*(np.ascontiguousarray(array.T) for array in weights), *rest)
        self._encoding = encoding
        self._set_posture(initial_posture)

    def _set_posture(self, posture: np.ndarray) -> None:
        self.initial_posture = np.array(posture, dtype=np.float64)
        self._initial_code = self._encoding.encode(self.initial_posture).astype(np.float32)

    def starting_from(self, posture: np.ndarray) -> ClosedLoopGenerator:
        """Return the same network with another initial posture [rad], shape (n_joints,)."""
        other = copy.copy(self)
        other._set_posture(posture)
        return other

    def __call__(self, pb: np.ndarray, n_steps: int, slow_states: np.ndarray | None = None) -> np.ndarray:
        """Generate one movement from each PB point.

        Args:
            pb: PB values in [-1, 1], shape (n, n_pb), or (n, n_steps, n_pb) for a PB that moves: row t drives tick t.
            n_steps: Ticks to generate, at least 1; row 0 is the initial posture itself.
            slow_states: Internal states of P_S at tick 0, shape (n, n_slow); default: 0, as those of all other units.

        Returns:
            Joint angles [rad], shape (n, n_steps, n_joints), float64.
        """
        if len(pb) <= FEW_POINTS and slow_states is None:
            return self._advance(self.begin(len(pb)), pb, n_steps)
        rows = (pb if pb.ndim == 3 else pb[:, None]).transpose(1, 2, 0)

        def generate(part: slice) -> np.ndarray:
            states = None if slow_states is None else slow_states[part].T
            angles = self._run_batch(None, rows[:, :, part], states, n_steps)
            return angles[:, :, : part.stop - part.start].transpose(2, 0, 1)

        parts = [slice(start, min(start + BATCH, len(pb))) for start in range(0, len(pb), BATCH)]
        out = np.empty((len(pb), n_steps, self._encoding.n_joints))
        if len(parts) <= SERIAL_BATCHES or usable_cores() == 1:
            for part in parts:
                out[part] = generate(part)
        else:
            with ThreadPoolExecutor(usable_cores()) as pool:
                for part, angles in zip(parts, pool.map(generate, parts), strict=True):
                    out[part] = angles
        out[:, 0] = self.initial_posture
        return out

    def _run_batch(
        self, n_points: int | None, pb: np.ndarray, slow_states: np.ndarray | None, n_steps: int
    ) -> np.ndarray:
        """Run a batch whose columns, `n_points` and then derivatives or all points, are filled up to whole panels."""
        from creative_nao.model.compiled_generation import generate_batch
        from creative_nao.model.matmul import PANEL, line_up

        n_columns = pb.shape[2]
        width = line_up(n_columns, PANEL)
        points = np.zeros((*pb.shape[:2], width), np.float32)
        points[:, :, :n_columns] = pb
        states = np.zeros((self.n_hidden, width), np.float32)
        if slow_states is not None:
            states[-self.n_slow :, :n_columns] = slow_states
        angles = np.zeros((n_steps, self._encoding.n_joints, width), np.float32)
        generate_batch(self._by_postsynaptic, n_points or width, points, self._initial_code, states, angles)
        return angles

    def differentiate(self, unknowns: np.ndarray, n_steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Generate with the derivatives of the angles by the PB values and, if given, by the states of P_S at tick 0.

        Args:
            unknowns: Shape (n, k), n at most `DIFFERENTIATED_BATCH`: PB values, followed by n_slow states or by none.
            n_steps: Ticks to generate.

        Returns:
            Joint angles [rad], (n_steps, n_joints, n), and their derivatives, (n_steps, n_joints, k, n), float32;
            row 0, the initial posture, holds zeros in both.
        """
        n, k = unknowns.shape
        n_points = -(-n // 16) * 16  # as many as one instruction works on
        # One row for each unknown: its values, then 1 where it is differentiated by itself.
        inputs = np.zeros((k, (1 + k) * n_points), np.float32)
        inputs[:, :n] = unknowns.T
        for i in range(k):
            inputs[i, (1 + i) * n_points : (2 + i) * n_points] = 1
        states = inputs[self.n_pb :] if k > self.n_pb else None
        angles = self._run_batch(n_points, inputs[None, : self.n_pb], states, n_steps)
        blocks = angles[:, :, : (1 + k) * n_points].reshape(n_steps, -1, 1 + k, n_points)[..., :n]
        return blocks[:, :, 0], blocks[:, :, 1:]

    def begin(self, n: int) -> Rollout:
        """Return n movements of which nothing is generated yet."""
        states = np.zeros((2, n, self.n_hidden), np.float32)
        return Rollout(0, self._initial_code[None].repeat(n, axis=0), states[0], states[1])

    def advance(self, rollout: Rollout, pb: np.ndarray, n_ticks: int) -> np.ndarray:
        """Generate the next ticks of movements; `rollout` then stands `n_ticks` later.

        Args:
            rollout: Their state.
            pb: PB value of each in [-1, 1] during these ticks, (n, n_pb), or at each of them, (n, n_ticks, n_pb).
            n_ticks: Postures to generate, at least 1; the very first is the initial posture itself.

        Returns:
            Joint angles [rad], (n, n_ticks, n_joints), float64. PB values of another shape or outside [-1, 1] are a
            ShapeError.
        """
        n = len(rollout)
        if pb.shape not in ((n, self.n_pb), (n, n_ticks, self.n_pb)) or not (np.abs(pb) <= 1).all():
            raise ShapeError(f"`pb` should have shape ({n}, {self.n_pb}) and lie in [-1, 1], but is {pb!r:.80}")
        return self._advance(rollout, pb, n_ticks)

    @functools.cached_property
    def _advance_kernel(self) -> Any:
        from creative_nao.model.compiled_generation import advance  # loads numba, at the first computation

        return advance

    def _advance(self, rollout: Rollout, pb: np.ndarray, n_ticks: int) -> np.ndarray:
        angles = np.zeros((len(rollout), n_ticks, self._encoding.n_joints), np.float32)
        points = (pb if pb.ndim == 3 else pb[:, None]).astype(np.float32)
        first = int(rollout.tick == 0)
        states = rollout.code, rollout.state, rollout.activity
        self._advance_kernel(self._by_presynaptic, points, first, *states, angles)
        trajectories = angles.astype(np.float64)
        if first:
            trajectories[:, 0] = self.initial_posture
        rollout.tick += n_ticks
        return trajectories


def pb_points(value: ArrayLike, n_pb: int, name: str, least: int = 0) -> np.ndarray:
    """Return PB points as float64 (n, n_pb); other shapes, fewer than `least`, values outside [-1, 1]: a ShapeError."""
    points = as_numbers(value, name)
    if points.ndim != 2 or points.shape[1] != n_pb or len(points) < least:
        expected = f"(n, {n_pb})" + (f" with n at least {least}" if least else "")
        raise ShapeError(f"`{name}` should have shape {expected}, but has {points.shape}")
    inside = np.abs(points) <= 1  # false for NaN
    if not inside.all():
        row = int(np.argmin(inside.all(axis=1)))
        raise ShapeError(f"`{name}` should lie in [-1, 1], but row {row} is {points[row].tolist()}")
    return points


def pb_of_each_tick(
    points: ArrayLike, n_pb: int, n_steps: int, at_ticks: Sequence[int] | np.ndarray | None = None
) -> np.ndarray:
    """Return the PB value at every tick of `Memory.generate_path`, which describes the arguments, (n_steps, n_pb).

    Before the first and after the last point the PB rests; from the tick of a jump on the later point counts.
    Points that do not fit are a ShapeError, ticks that do not a SettingsError.
    """
    corners = pb_points(points, n_pb, "points", least=1)
    if at_ticks is None:
        reached = np.linspace(0.0, n_steps - 1, len(corners))
    else:
        reached = as_numbers(at_ticks, "at_ticks")
        if reached.shape != (len(corners),) or not (np.diff(reached) >= 0).all() or not np.isfinite(reached).all():
            raise SettingsError(
                f"`at_ticks` should hold {len(corners)} ticks, one for each point, none before the one ahead of it, "
                f"but is {reached.tolist()}"
            )
    return along(corners, reached, np.arange(n_steps, dtype=np.float64))


def along(corners: np.ndarray, reached: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the places at `wanted` on the line through `corners`, which are reached at `reached`."""
    after = np.searchsorted(reached, wanted, side="right")
    left, right = np.clip(after - 1, 0, None), np.clip(after, None, len(corners) - 1)
    span = reached[right] - reached[left]
    share = np.clip((wanted - reached[left]) / np.where(span > 0, span, 1.0), 0.0, 1.0)[:, None]
    return corners[left] + share * (corners[right] - corners[left])
