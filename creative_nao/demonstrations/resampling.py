"""Bring a recording of any rate to the network's tick.

Between the samples a monotone cubic (Fritsch and Butland 1984) never overshoots a posture that was recorded. A
recording finer than the tick holds movement that the tick cannot (tremor at 10 Hz against 3.3 Hz), which plain picking
would turn into a slow wobble that nobody made. So each posture is a mean over a Hann window, as wide as the tick less
the spacing of the recording: of a 50 Hz recording read at 0.15 s, a 1.5 Hz swing keeps 98 % of its size and a 10 Hz
tremor less than 30 %. A recording at the tick itself is taken as it is.
"""

from __future__ import annotations

import numpy as np

from creative_nao.errors import FileFormatError

GRID_TOLERANCE_S = 1e-6
"""Times this close to the tick's grid are on it [s]."""

_WINDOW_POINTS = 33


def n_ticks(duration_s: float, dt_s: float) -> int:
    """Return how many postures at `dt_s` fit a recording of `duration_s` seconds, the first one at its start."""
    return int(np.floor(duration_s / dt_s + GRID_TOLERANCE_S)) + 1


def check_duration(duration_s: float, dt_s: float, most: int, where: str) -> None:
    """Refuse a recording that is shorter than a tick or longer than `most` ticks; `where` begins the message.

    Raises:
        FileFormatError: If it is.
    """
    if duration_s < dt_s * (1.0 - 1e-6):
        raise FileFormatError(f"{where}: lasts {duration_s:g} s, shorter than one tick of {dt_s:g} s.")
    if duration_s / dt_s > most:
        raise FileFormatError(
            f"{where}: lasts {duration_s:g} s, {n_ticks(duration_s, dt_s)} ticks of {dt_s:g} s, "
            f"expected at most {most}; are the times in seconds, not milliseconds?"
        )


def resample(times_s: np.ndarray, angles: np.ndarray, dt_s: float) -> np.ndarray:
    """Return the recorded postures at every `dt_s` seconds, from the first sample on.

    Args:
        times_s: When each posture was recorded [s], strictly rising, shape (n,), at least two; spacing may vary.
        angles: Recorded postures [rad], shape (n, n_joints).
        dt_s: The tick [s].

    Returns:
        Postures [rad], shape (n_steps, n_joints).
    """
    times = np.asarray(times_s, dtype=np.float64) - times_s[0]
    ticks = np.arange(n_ticks(times[-1], dt_s)) * dt_s
    if len(ticks) == len(times) and np.abs(ticks - times).max() <= GRID_TOLERANCE_S:
        return np.array(angles, dtype=np.float64)
    width = dt_s - float(np.median(np.diff(times)))
    if width <= 0:
        return monotone_cubic(times, angles, ticks)
    share = (np.arange(_WINDOW_POINTS) + 0.5) / _WINDOW_POINTS
    weights = np.sin(np.pi * share) ** 2
    weights /= weights.sum()
    around = ticks[:, None] + width * (share - 0.5)
    fine = monotone_cubic(times, angles, around.ravel())
    return np.einsum("w,nwj->nj", weights, fine.reshape(len(ticks), _WINDOW_POINTS, -1))


def monotone_cubic(times_s: np.ndarray, angles: np.ndarray, wanted_s: np.ndarray) -> np.ndarray:
    """Return the monotone cubic through `(times_s, angles)` at `wanted_s`, the end postures held outside."""
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(times_s, angles, axis=0)(np.clip(wanted_s, times_s[0], times_s[-1]))
