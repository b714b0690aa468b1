"""What every importer gives: keys, each joint with times and angles of its own. From them, a movement at one tick.

Joint names may come in any order; the unit of the angles is recognised; everything that was recognised, left out or
changed on the way is said in notes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao.demonstrations.csv_format import LARGEST_TIME_S, SHORTEST_STEP_S
from creative_nao.demonstrations.dataset import DEGREES_FROM_RAD, LIMIT_TOLERANCE_RAD
from creative_nao.demonstrations.keyframes import DT_S
from creative_nao.demonstrations.resampling import monotone_cubic, n_ticks, resample
from creative_nao.errors import FileFormatError, SettingsError, nearest_name
from creative_nao.exchange.motion import Motion
from creative_nao.joints import LIMITS_RAD

MAX_POSTURES = 20_000
"""Longest movement that is read, in postures."""

LARGEST_ANGLE = 1e6
"""In radians or degrees: a motor turns, but not to the stars."""
_EVEN_S = 1e-6


@dataclass
class Keys:
    """Keys as they stand in a file: for each joint when [s] and where, in the file's own unit."""

    joints: tuple[str, ...]
    times: list[np.ndarray]
    angles: list[np.ndarray]
    unit: str | None = None
    """`radians`, `degrees`, or None if the file does not say."""
    time_step_s: float = 0.0
    """Times in the file are rounded to this [s]."""
    metadata: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Recording:
    """A movement read from a file.

    Attributes:
        motion: The movement.
        format: Name of the file's format.
        notes: What was recognised, left out or changed, one sentence each.
    """

    motion: Motion
    format: str
    notes: tuple[str, ...]


def to_motion(
    keys: Keys, path: Path, dt_s: float | None, joints: tuple[str, ...] | None
) -> tuple[Motion, tuple[str, ...]]:
    """Turn keys into a movement of the wanted joints at one tick, and tell what was done.

    Args:
        keys: What stands in the file.
        path: The file, for messages.
        dt_s: Wanted tick [s]. None: the file's own if its postures are evenly spaced, else 0.15 s.
        joints: Wanted joints, in this order. None: all, in the file's order.

    Raises:
        FileFormatError: If a wanted joint is missing, times do not rise, or the movement is too short or too long.
        SettingsError: If `dt_s` is not positive.
    """
    if dt_s is not None and not (np.isfinite(dt_s) and dt_s > 0):
        raise SettingsError(f"`dt_s` should be a positive number of seconds, but is {dt_s}.")
    notes = list(keys.notes)
    wanted = keys.joints if joints is None else joints
    columns = _columns(keys.joints, wanted, path)
    ignored = [name for name in keys.joints if name not in wanted]
    if ignored:
        notes.append(f"left out, not among the wanted joints: {', '.join(ignored)[:300]}")
    times, angles = [keys.times[c] for c in columns], [keys.angles[c] for c in columns]
    for name, when, where in zip(wanted, times, angles, strict=True):
        _check(name, when, where, path)
    angles = _in_radians(wanted, angles, keys.unit, notes)
    when, postures = _together(times, angles, notes)
    return _at_one_tick(keys, path, when, postures, dt_s, wanted, notes), tuple(notes)


def _columns(present: tuple[str, ...], wanted: tuple[str, ...], path: Path) -> list[int]:
    for name in wanted:
        if name not in present:
            raise FileFormatError(
                f"{path}: joint `{name}` is missing{nearest_name(name, present)}; "
                f"the file has {', '.join(present)[:200]}."
            )
        if present.count(name) > 1:
            raise FileFormatError(f"{path}: joint `{name}` stands in the file more than once.")
    return [present.index(name) for name in wanted]


def _check(name: str, times: np.ndarray, angles: np.ndarray, path: Path) -> None:
    if len(times) != len(angles) or not len(times):
        raise FileFormatError(f"{path}: {name} has {len(times)} times and {len(angles)} angles, expected as many.")
    if len(times) > MAX_POSTURES:
        raise FileFormatError(f"{path}: {name} has {len(times)} keys, expected at most {MAX_POSTURES}.")
    if not (np.isfinite(times).all() and np.isfinite(angles).all()):
        raise FileFormatError(f"{path}: {name} has a time or an angle that is not a finite number.")
    for what, values, most in (("time", times, LARGEST_TIME_S), ("angle", angles, LARGEST_ANGLE)):
        if np.abs(values).max() > most:
            raise FileFormatError(
                f"{path}: {name} has the {what} {values[np.abs(values).argmax()]:g}, beyond {most:g}."
            )
    steps = np.diff(times)
    late = np.flatnonzero(steps < SHORTEST_STEP_S)
    if len(late) and steps[late[0]] > 0:
        raise FileFormatError(
            f"{path}: {name} has keys {steps[late[0]]:g} s apart, expected {SHORTEST_STEP_S:g} or more."
        )
    if len(late):
        k = int(late[0]) + 1
        raise FileFormatError(
            f"{path}: times of {name} should rise, but {times[k]:g} s follows {times[k - 1]:g} s (key {k + 1})."
        )


def _in_radians(
    joints: tuple[str, ...], angles: list[np.ndarray], unit: str | None, notes: list[str]
) -> list[np.ndarray]:
    """Bring angles to radians; where the file does not say its unit, more than a full turn means degrees."""
    if unit is None:
        fits = all(_within(joint, values) for joint, values in zip(joints, angles, strict=True))
        largest = max(float(np.abs(values).max()) for values in angles)
        unit = "degrees" if not fits and largest > DEGREES_FROM_RAD else "radians"
        reason = "every angle fits the joint's range" if fits else f"the largest angle is {largest:.4g}"
        notes.append(f"angles taken for {unit}: {reason}")
    else:
        notes.append(f"angles are in {unit}, as the file says")
    return [np.deg2rad(values) for values in angles] if unit == "degrees" else angles


def _within(joint: str, values: np.ndarray) -> bool:
    low, high = LIMITS_RAD.get(joint, (-DEGREES_FROM_RAD, DEGREES_FROM_RAD))
    return bool((values >= low - LIMIT_TOLERANCE_RAD).all() and (values <= high + LIMIT_TOLERANCE_RAD).all())


def _together(times: list[np.ndarray], angles: list[np.ndarray], notes: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return common times and postures; joints with other keys are read between theirs."""
    if all(np.array_equal(times[0], other) for other in times[1:]):
        return times[0], np.stack(angles, axis=1)
    common = np.unique(np.concatenate(times))
    columns = [
        monotone_cubic(when, where[:, None], common)[:, 0] if len(when) > 1 else np.full(len(common), where[0])
        for when, where in zip(times, angles, strict=True)
    ]
    notes.append("joints have keys at different times; between a joint's keys a monotone cubic was taken")
    return common, np.stack(columns, axis=1)


def _at_one_tick(
    keys: Keys,
    path: Path,
    times: np.ndarray,
    postures: np.ndarray,
    dt_s: float | None,
    joints: tuple[str, ...],
    notes: list[str],
) -> Motion:
    if len(times) < 2:
        raise FileFormatError(f"{path}: has a single posture, expected at least 2.")
    own = _own_tick(times, keys.time_step_s)
    if own is not None and (dt_s is None or abs(own - dt_s) <= _EVEN_S):
        return Motion(postures, own if dt_s is None else dt_s, joints, keys.metadata)
    tick = DT_S if dt_s is None else dt_s
    duration = float(times[-1] - times[0])
    if duration < tick * (1.0 - 1e-6):
        raise FileFormatError(f"{path}: lasts {duration:g} s, shorter than one tick of {tick:g} s.")
    if duration / tick > MAX_POSTURES:
        raise FileFormatError(
            f"{path}: lasts {duration:g} s, {n_ticks(duration, tick)} ticks of {tick:g} s, expected at most "
            f"{MAX_POSTURES}; are the times in seconds, not milliseconds?"
        )
    rate = "unevenly spaced postures" if own is None else f"postures every {own:g} s"
    notes.append(f"{rate} brought to a tick of {tick:g} s")
    return Motion(resample(times, postures, tick), tick, joints, keys.metadata)


def _own_tick(times: np.ndarray, time_step_s: float) -> float | None:
    """Return the spacing of evenly spaced times, as round a number as fits, or None."""
    steps = np.arange(len(times))
    since = times - times[0]
    mean = float(since[-1] / steps[-1])
    tolerance = max(_EVEN_S, 1.01 * time_step_s)
    for digits in (3, 6, 9):
        tick = round(mean, digits)
        if tick > 0 and np.abs(since - steps * tick).max() <= (tolerance if digits > 3 else tolerance / 2):
            return tick
    return None
