"""Turn a trajectory of coarse ticks into the smooth commands that a robot gets every few milliseconds."""

from __future__ import annotations

import numpy as np


def monotone_slopes(values: np.ndarray, dt: float) -> np.ndarray:
    """Return slopes at 2 or more evenly spaced knots that make a cubic through them monotone wherever the knots are.

    Fritsch and Carlson's condition in the form of Fritsch and Butland (1984): inside, the harmonic mean of the two
    neighbouring chords where they have the same sign, else zero; at both ends the three-point formula, limited so that
    the curve does not overshoot. Knots `dt` seconds apart and slopes have the shape (n_knots, n_channels).
    """
    chords = np.diff(values, axis=0) / dt
    if len(chords) == 1:
        return np.repeat(chords, 2, axis=0)
    before, after = chords[:-1], chords[1:]
    agree = before * after > 0
    inside = np.where(agree, 2 * before * after / np.where(agree, before + after, 1.0), 0.0)
    first, last = _end_slope(chords[0], chords[1]), _end_slope(chords[-1], chords[-2])
    return np.concatenate([first[None], inside, last[None]])


def _end_slope(nearest: np.ndarray, next_one: np.ndarray) -> np.ndarray:
    slope = (3 * nearest - next_one) / 2
    slope = np.where(slope * nearest <= 0, 0.0, slope)
    limited = (nearest * next_one <= 0) & (np.abs(slope) > 3 * np.abs(nearest))
    return np.where(limited, 3 * nearest, slope)


def refine(values: np.ndarray, dt: float, factor: int) -> np.ndarray:
    """Return the monotone cubic through evenly spaced knots, sampled `factor` times as finely.

    Between two knots the curve never leaves the range they span: what is within the joint limits stays there.

    Args:
        values: Knots, shape (n_knots, n_channels); one knot comes back as it is.
        dt: Time between knots [s].
        factor: Samples per interval, >= 1. The result has the shape ((n_knots - 1) * factor + 1, n_channels); every
            `factor`-th row is a knot, exactly.
    """
    if len(values) < 2 or factor == 1:
        return values.copy()
    slopes = monotone_slopes(values, dt)
    s = (np.arange(factor) / factor)[None, :, None]
    left, right = values[:-1, None], values[1:, None]
    left_slope, right_slope = slopes[:-1, None] * dt, slopes[1:, None] * dt
    rise = s * s * (3 - 2 * s)
    curve = left + (right - left) * rise + s * (1 - s) * ((1 - s) * left_slope - s * right_slope)
    return np.concatenate([curve.reshape(-1, values.shape[1]), values[-1:]])


def minimum_jerk(start: np.ndarray, end: np.ndarray, n_steps: int) -> np.ndarray:
    """Return the smooth move from `start` to `end` at rest on both sides, shape (n_steps, n_channels), ending in `end`.

    Its largest speed is 1.875 times the mean one (Flash and Hogan 1985).
    """
    s = (np.arange(1, n_steps + 1) / n_steps)[:, None]
    return start + (end - start) * s**3 * (10 - 15 * s + 6 * s * s)


def limit_speed(targets: np.ndarray, start: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Let `targets`, (n_rows, n_channels), move from `start` by at most `step` a row, both of shape (n_channels,).

    The robot's own controller does so; slow targets stay as they are.
    """
    if np.all(np.abs(np.diff(targets, axis=0, prepend=start[None])) <= step):
        return targets
    limited = np.empty_like(targets)
    here = start
    for row, target in enumerate(targets):
        here = here + np.clip(target - here, -step, step)
        limited[row] = here
    return limited


def ramp(start: np.ndarray, targets: np.ndarray, n_substeps: int) -> np.ndarray:
    """Divide the way to each target evenly: shape (n_targets, n_channels) to (n_targets * n_substeps, n_channels).

    The last substep of each target is the target itself.
    """
    before = np.concatenate([start[None], targets[:-1]])[:, None]
    part = (np.arange(1, n_substeps + 1) / n_substeps)[None, :, None]
    return (before + (targets[:, None] - before) * part).reshape(-1, targets.shape[1])
