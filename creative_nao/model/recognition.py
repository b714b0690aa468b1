"""Recognition: which point of the PB space makes a given movement?

The error as a function of PB is rugged, because a closed loop amplifies small differences tick by tick: neighbouring
cells of the 200 x 200 map of the shipped open/0 are 12 rad apart by DTW in the mean, more than what parts learned from
unlearned. The first ticks, though, change smoothly. So the search goes from short to long: many descents of the squared
error (error regression), side by side, first fit the first ticks, then more and more of the movement, and at every
length the best points of an even cover of the PB space join them. On open/0, descents at full length alone find 80 % of
random points again; from short to long it is all of them (benchmarks/recognition.py). In the end a local search lowers
the warping distance itself, which forgives what squared errors do not: being a tick early or late.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from creative_nao.errors import ShapeError
from creative_nao.measures.dtw import MAX_VALUE, as_numbers, dtw_matrix
from creative_nao.model.generation import DIFFERENTIATED_BATCH, ClosedLoopGenerator

LARGEST_STEP = 0.1  # of a PB value in one iteration; the approximation is not to be trusted farther
DAMPING = 0.01  # Marquardt's factor at the start; a good step divides it by 5, a bad one multiplies it by 6
GIVE_UP_DAMPING = 1e4
SMALLEST_STEP = 1e-6
SMALLEST_GAIN = 1e-3  # a descent ends when a step lowers its error by less than this share
# Weight of a squared initial state beside the mean squared angle error [rad^2]: a state of 1 must explain more than
# this, so that noise is not explained by states that nothing else asks for.
STATE_PENALTY = 1e-5

N_SCREEN = 4096  # points of the even cover: as dense as a grid of 64 x 64 when there are two PB units
FIRST_HORIZON = 8  # ticks of the shortest beginning that is fitted
N_HORIZONS = 7
ITERATIONS, LAST_ITERATIONS = 6, 20  # of each descent at one length, and at the full length
SAME_POINT = 1e-4  # descents closer than this in every PB value have met
SCREEN_TICKS = 4096 * 50  # ticks generated at a time, so that a long recording needs no more memory than a short one
WARPING_CELLS = 4e7  # pairs of postures spent on finding starts by the warping distance, and in the local search
N_POLISHED = 6
POLISH_RADII = 0.02 * 0.5 ** np.arange(8)  # standard deviation of the trial steps of the local search, round by round
N_TRIALS = 16


@dataclass(frozen=True, eq=False)
class Restarts:
    """Where the descents of one recognition ended, the best first.

    Attributes:
        pb: Shape (n, n_pb).
        error: DTW distance of what each generates to the target [rad], shape (n,).
        squared_error: Mean squared difference of the angles at equal ticks [rad^2], shape (n,).
    """

    pb: np.ndarray
    error: np.ndarray
    squared_error: np.ndarray

    def __len__(self) -> int:
        return len(self.pb)

    def __repr__(self) -> str:
        return f"Restarts({len(self)} points, DTW distance {self.error[0]:.4g} to {self.error[-1]:.4g} rad)"


@dataclass(frozen=True, eq=False)
class Recognition:
    """What a memory makes of a movement.

    Attributes:
        pb: The PB value whose movement is nearest, shape (n_pb,) in [-1, 1].
        error: DTW distance of that movement to the given one [rad]: what the search lowers in the end.
        squared_error: Mean squared difference of their angles at equal ticks, tick 0 left out [rad^2]: what the
            descents lower.
        trajectory: That movement [rad], shape (n_steps, n_joints), as long as the given one.
        initial_state: Internal states u of the hidden neurons at tick 0, shape (n_hidden,), if they were inferred:
            those of the slowest layer, the others 0; else None. `trajectory` then begins in the given first posture.
        restarts: Where the search ended elsewhere; its first row is the answer.
    """

    pb: np.ndarray
    error: float
    squared_error: float
    trajectory: np.ndarray
    initial_state: np.ndarray | None
    restarts: Restarts

    def __repr__(self) -> str:
        pb = ", ".join(f"{value:.4f}" for value in self.pb)
        initial = "" if self.initial_state is None else ", initial state inferred"
        return (
            f"Recognition(pb=[{pb}], DTW distance {self.error:.4g} rad, {len(self.trajectory)} ticks{initial}, "
            f"{len(self.restarts)} restarts)"
        )


def checked_trajectory(trajectory: ArrayLike, joints: tuple[str, ...]) -> np.ndarray:
    """Return joint angles as float64 (n_steps, n_joints); other shapes, one tick, values not finite: a ShapeError."""
    target = as_numbers(trajectory, "trajectory")
    if target.ndim != 2 or target.shape[1] != len(joints) or len(target) < 2:
        raise ShapeError(
            f"`trajectory` should have shape (n_steps, {len(joints)}), at least two ticks and one column for each of "
            f"{', '.join(joints)}, but has {target.shape}"
        )
    if not (np.abs(target) <= MAX_VALUE).all():
        tick, joint = np.argwhere(~(np.abs(target) <= MAX_VALUE))[0]
        raise ShapeError(
            f"`trajectory` should hold finite angles [rad], but is {target[tick, joint]} at tick {tick}, "
            f"joint {joints[joint]}"
        )
    return target


def infer_pb(
    generator: ClosedLoopGenerator,
    target: np.ndarray,
    *,
    infer_initial_state: bool,
    n_restarts: int,
    n_screen: int,
    seed: int,
) -> Recognition:
    """Find the PB value from which a network generates a movement; `Memory.infer_pb` describes the arguments.

    The initial states that may be sought are those of the slowest layer, the only ones that are remembered for long.
    """
    rng = np.random.default_rng(seed)
    if infer_initial_state:
        generator = generator.starting_from(target[0])
    n_pb = generator.n_pb
    n_unknown = n_pb + (generator.n_slow if infer_initial_state else 0)
    horizons = np.unique(np.geomspace(min(FIRST_HORIZON, len(target)), len(target), N_HORIZONS).round().astype(int))
    cover = even_cover(n_screen, n_pb, rng)
    errors = np.empty((len(horizons), len(cover)))  # squared, of every point of the cover over the first ticks
    size = max(1, SCREEN_TICKS // len(target))
    for start in range(0, len(cover), size):
        angles = generator(cover[start : start + size], len(target))
        squares = np.cumsum(((angles - target) ** 2).sum(axis=2), axis=1)
        errors[:, start : start + size] = squares[:, horizons - 1].T
    by_error = _from_short_to_long(generator, cover, errors, target, horizons, n_restarts, n_unknown)
    by_warping = _nearest_by_warping(generator, cover, errors[-1], target)
    unknowns = np.concatenate([by_error, np.pad(by_warping, ((0, 0), (0, n_unknown - n_pb)))])
    unknowns, error = _polished(generator, unknowns, target, rng)
    trajectories = _generate(generator, unknowns, len(target))
    squared = ((trajectories[:, 1:] - target[1:]) ** 2).mean(axis=(1, 2))
    states = None
    if infer_initial_state:
        states = np.concatenate([np.zeros(generator.n_hidden - generator.n_slow), unknowns[0, n_pb:]])
    restarts = Restarts(unknowns[:, :n_pb], error, squared)
    return Recognition(unknowns[0, :n_pb], float(error[0]), float(squared[0]), trajectories[0], states, restarts)


def even_cover(n: int, n_pb: int, rng: np.random.Generator) -> np.ndarray:
    """Return `n` points spread evenly over [-1, 1]^n_pb, as the generalised golden ratio spreads them, (n, n_pb).

    Point k is the fraction of shift + k / phi^(1, 2, ..., n_pb), phi the root of phi^(n_pb + 1) = phi + 1; in one
    dimension phi is the golden ratio. Unlike a grid it has any number of points in any dimension; `rng` draws the
    shift.
    """
    phi = 2.0
    for _ in range(64):  # the iteration contracts; 64 rounds reach the last bit
        phi = (1.0 + phi) ** (1.0 / (n_pb + 1))
    steps = phi ** -np.arange(1.0, n_pb + 1)
    return 2.0 * ((rng.random(n_pb) + np.arange(n)[:, None] * steps) % 1.0) - 1.0


def _from_short_to_long(
    generator: ClosedLoopGenerator,
    cover: np.ndarray,
    errors: np.ndarray,
    target: np.ndarray,
    horizons: np.ndarray,
    n_restarts: int,
    n_unknown: int,
) -> np.ndarray:
    """Fit longer and longer beginnings, a third of the descents at each length new; return the last, best first."""
    n_pb = cover.shape[1]
    n_new = -(-n_restarts // 3)
    apart = 3.0 * len(cover) ** (-1.0 / n_pb)  # one and a half times the mean distance of the cover's points
    best = np.zeros((0, n_unknown))
    for horizon, error in zip(horizons, errors, strict=True):
        order = np.argsort(error, kind="stable")[: 40 * n_new]
        fresh = cover[order[distinct(cover[order], n_new, apart)]]
        starts = np.concatenate([best, np.pad(fresh, ((0, 0), (0, n_unknown - n_pb)))])
        iterations = LAST_ITERATIONS if horizon == horizons[-1] else ITERATIONS
        unknowns, squared = descend(generator, starts, target[:horizon], iterations)
        unknowns = unknowns[np.argsort(squared, kind="stable")]
        best = unknowns[distinct(unknowns, n_restarts, SAME_POINT)]
    return best


def _nearest_by_warping(
    generator: ClosedLoopGenerator, cover: np.ndarray, error: np.ndarray, target: np.ndarray
) -> np.ndarray:
    """Return the points of the cover nearest to the target by DTW, of those that squared error ranks first."""
    n = int(min(len(cover), max(1, WARPING_CELLS // len(target) ** 2), SCREEN_TICKS // len(target) + 1))
    ranked = cover[np.argsort(error, kind="stable")[:n]]
    distances = dtw_matrix(generator(ranked, len(target)), target[None], np.float32)[:, 0]
    return ranked[np.argsort(distances, kind="stable")[:N_POLISHED]]


def _polished(
    generator: ClosedLoopGenerator, unknowns: np.ndarray, target: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Lower the DTW distance of the most promising points by trial steps around them; return all points, best first."""
    n_pb = generator.n_pb
    n_most = int(max(N_POLISHED, WARPING_CELLS // len(target) ** 2 // 8))
    unknowns = unknowns[:n_most]
    error = _warping(generator, unknowns, target)
    order = np.argsort(error, kind="stable")
    unknowns, error = unknowns[order], error[order]
    chosen = distinct(unknowns[:, :n_pb], N_POLISHED, float(POLISH_RADII[1]))
    best, lowest = unknowns[chosen], error[chosen]
    n_rounds = int(min(len(POLISH_RADII), WARPING_CELLS // (N_TRIALS * len(best) * len(target) ** 2)))
    for radius in POLISH_RADII[:n_rounds]:
        trials = np.repeat(best, N_TRIALS, axis=0)
        trials[:, :n_pb] += radius * rng.standard_normal((len(trials), n_pb))
        trials[:, :n_pb] = np.clip(trials[:, :n_pb], -1.0, 1.0)
        reached = _warping(generator, trials, target).reshape(len(best), N_TRIALS)
        pick = reached.argmin(axis=1)
        lower = np.flatnonzero(reached.min(axis=1) < lowest)
        best[lower] = trials.reshape(len(best), N_TRIALS, -1)[lower, pick[lower]]
        lowest[lower] = reached[lower, pick[lower]]
    unknowns[chosen], error[chosen] = best, lowest
    order = np.argsort(error, kind="stable")
    return unknowns[order], error[order]


def _warping(generator: ClosedLoopGenerator, unknowns: np.ndarray, target: np.ndarray) -> np.ndarray:
    return dtw_matrix(_generate(generator, unknowns, len(target)), target[None])[:, 0]


def _generate(generator: ClosedLoopGenerator, unknowns: np.ndarray, n_steps: int) -> np.ndarray:
    pb, states = np.hsplit(unknowns, [generator.n_pb])
    return generator(pb, n_steps, states if states.size else None)


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
    generator: ClosedLoopGenerator, starts: np.ndarray, target: np.ndarray, n_iterations: int
) -> tuple[np.ndarray, np.ndarray]:
    """Lower the squared error from every start by at most so many steps.

    The descent is in rho, of which P = tanh(rho) (Eq. 1), seen from P: a step of rho times (1 - P^2) is a step of P,
    and cutting P at the border of [-1, 1] keeps rho's range without its vanishing slope there.

    Args:
        generator: The network.
        starts: Shape (n, k): PB values and, if sought, initial states of the slowest layer.
        target: What should be generated [rad], shape (n_steps, n_joints).
        n_iterations: At most; a descent ends earlier when it no longer gains.

    Returns:
        Where the descents end, (n, k), and the mean squared difference of the angles there [rad^2], with the penalty
        of the states, (n,).
    """
    n_pb = generator.n_pb
    unknowns = _within(starts, n_pb)
    k = np.arange(unknowns.shape[1])
    penalty = np.where(k < n_pb, 0.0, STATE_PENALTY * (target.size - target.shape[1]))  # of the sum, as J^T J is

    def evaluate(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return mean squared error, J^T J and J^T (target - angles) with the penalty: Gauss-Newton's approximation."""
        n, n_unknown = points.shape
        error, curvature, downhill = np.empty(n), np.empty((n, n_unknown, n_unknown)), np.empty((n, n_unknown))
        for start in range(0, n, DIFFERENTIATED_BATCH):
            part = slice(start, min(start + DIFFERENTIATED_BATCH, n))
            angles, derivatives = generator.differentiate(points[part], len(target))
            rest = (target[1:, :, None] - angles[1:]).reshape(-1, angles.shape[-1]).T  # (points, angles)
            jacobian = derivatives[1:].reshape(-1, n_unknown, angles.shape[-1]).transpose(2, 0, 1).astype(np.float64)
            error[part] = (rest**2).mean(axis=1)
            curvature[part] = jacobian.transpose(0, 2, 1) @ jacobian
            downhill[part] = (rest[:, None, :] @ jacobian)[:, 0]
        curvature[:, k, k] += penalty
        return error + STATE_PENALTY * (points[:, n_pb:] ** 2).sum(axis=1), curvature, downhill - penalty * points

    error, curvature, downhill = evaluate(unknowns)
    damping = np.full(len(unknowns), DAMPING)
    active = np.arange(len(unknowns))
    for _ in range(n_iterations):
        matrix = curvature[active]
        matrix[:, k, k] += damping[active, None] * matrix[:, k, k] + 1e-9
        step = np.linalg.solve(matrix, downhill[active][:, :, None])[:, :, 0]
        step[:, :n_pb] = np.clip(step[:, :n_pb], -LARGEST_STEP, LARGEST_STEP)
        tried = _within(unknowns[active] + step, n_pb)
        new_error, new_curvature, new_downhill = evaluate(tried)
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
    return unknowns, error


def _within(unknowns: np.ndarray, n_pb: int) -> np.ndarray:
    """Return the unknowns as the network sees them: PB values in [-1, 1], everything in float32."""
    inside = unknowns.astype(np.float32).astype(np.float64)
    inside[:, :n_pb] = np.clip(inside[:, :n_pb], -1.0, 1.0)
    return inside
