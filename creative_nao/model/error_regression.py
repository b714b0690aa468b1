"""Error regression: move PB values downhill on the error of what the network generates from them.

Plain gradient descent creeps here, since the map is steep in one direction and flat in another; Levenberg and Marquardt
scale the gradient by the curvature of the squared error. Many descents run side by side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from creative_nao.model.slopes import DifferentiableGenerator

LARGEST_STEP = 0.1
"""Of a PB value in one iteration; the approximation is not to be trusted farther."""
DAMPING = 0.01
"""Marquardt's factor at the start; a good step divides it by 5, a bad one multiplies it by 6."""
GIVE_UP_DAMPING = 1e4
SMALLEST_STEP = 1e-6
SMALLEST_GAIN = 1e-3
"""A descent ends when a step lowers its error by less than this share."""
STATE_PENALTY = 1e-5
"""Weight of a squared initial state beside the mean squared angle error [rad^2]: a state of 1 must explain more than
this, so that noise is not explained by states that nothing else asks for."""


@dataclass(eq=False)
class Descents:
    """Where descents stand.

    Attributes:
        unknowns: PB values and, if sought, initial states of the slowest layer, shape (n, k).
        error: Mean squared difference of the angles [rad^2], with the penalty of the states, shape (n,).
    """

    unknowns: np.ndarray
    error: np.ndarray

    def best(self, n: int, apart: float) -> Descents:
        """Return the `n` descents of the lowest error; of those closer than `apart` in every value, one."""
        order = np.argsort(self.error, kind="stable")
        order = order[distinct(self.unknowns[order], n, apart)]
        return Descents(self.unknowns[order], self.error[order])


def distinct(points: np.ndarray, n: int, apart: float) -> np.ndarray:
    """Return the places of the first `n` points, each at least `apart` in some value from those before it."""
    open_ = np.ones(len(points), bool)
    chosen: list[int] = []
    while len(chosen) < n and open_.any():
        place = int(np.argmax(open_))
        chosen.append(place)
        open_ &= np.abs(points - points[place]).max(axis=1) > apart
        open_[place] = False
    return np.array(chosen, dtype=np.int64)


def descend(
    generator: DifferentiableGenerator, starts: np.ndarray, n_pb: int, target: np.ndarray, n_iterations: int
) -> Descents:
    """Lower the squared error from every start.

    The descent is in rho, of which P = tanh(rho) (Eq. 1), seen from P: a step of rho times (1 - P^2) is a step of P,
    and cutting P at the border of [-1, 1] keeps rho's range without its vanishing slope there.

    Args:
        generator: The network.
        starts: Shape (n, k): PB values and, if sought, initial states.
        n_pb: How many of the k are PB values.
        target: What should be generated [rad], shape (n_steps, n_joints).
        n_iterations: At most; a descent ends earlier when it no longer gains.
    """
    unknowns = _within(starts, n_pb)
    k = np.arange(unknowns.shape[1])
    penalty = np.where(k < n_pb, 0.0, STATE_PENALTY * (target.size - target.shape[1]))  # of the sum, as J^T J is

    def look(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        error, curvature, downhill = generator.normal_equations(points, n_pb, target)
        curvature[:, k, k] += penalty
        states = points[:, n_pb:]
        return error + STATE_PENALTY * (states**2).sum(axis=1), curvature, downhill - penalty * points

    error, curvature, downhill = look(unknowns)
    damping = np.full(len(unknowns), DAMPING)
    active = np.arange(len(unknowns))
    for _ in range(n_iterations):
        matrix = curvature[active]
        matrix[:, k, k] += damping[active, None] * matrix[:, k, k] + 1e-9
        step = np.linalg.solve(matrix, downhill[active][:, :, None])[:, :, 0]
        step[:, :n_pb] = np.clip(step[:, :n_pb], -LARGEST_STEP, LARGEST_STEP)
        tried = _within(unknowns[active] + step, n_pb)
        new_error, new_curvature, new_downhill = look(tried)
        better = new_error < error[active]
        gain = error[active] - new_error
        done = np.abs(tried - unknowns[active]).max(axis=1) < SMALLEST_STEP
        done |= better & (gain < SMALLEST_GAIN * error[active])
        moved = active[better]
        unknowns[moved], error[moved] = tried[better], new_error[better]
        curvature[moved], downhill[moved] = new_curvature[better], new_downhill[better]
        damping[moved] /= 5
        damping[active[~better]] *= 6
        active = active[~done & (damping[active] < GIVE_UP_DAMPING)]
        if not len(active):
            break
    return Descents(unknowns, error)


def _within(unknowns: np.ndarray, n_pb: int) -> np.ndarray:
    """Return the unknowns as the network sees them: PB values in [-1, 1], everything in float32."""
    inside = unknowns.astype(np.float32).astype(np.float64)
    inside[:, :n_pb] = np.clip(inside[:, :n_pb], -1.0, 1.0)
    return inside
