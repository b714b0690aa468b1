"""A movement on its way to or from a file: `Motion`, and the keys that every importer gives.

Joint names may come in any order; the unit of the angles is recognised; everything that was recognised, left out or
changed on the way is said in notes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from creative_nao import storage
from creative_nao.demonstrations.dataset import DEGREES_FROM_RAD, LIMIT_TOLERANCE_RAD, Tick, draw_curves
from creative_nao.demonstrations.files import LARGEST_TIME_S, SHORTEST_STEP_S, check_duration, monotone_cubic, resample
from creative_nao.demonstrations.keyframes import DT_S
from creative_nao.errors import FileFormatError, SettingsError, nearest_name
from creative_nao.joints import JOINTS, LIMITS_RAD, joint_angles
from creative_nao.schema import Field, JsonObject, Names, checked

CYCLE_S = 0.010  # cycle of the robot's device controller [s]; ticks made here are whole numbers of it
APPROACH_SPEED_RAD_S = 1.5
"""Largest speed on the way to the first posture: less than a quarter of what the slowest joint can do."""

MIN_LEAD_S = 1.0  # shortest time for that way [s]
MAX_POSTURES = 20_000  # longest movement that is read, in postures
LARGEST_ANGLE = 1e6  # largest angle that is read, in radians or degrees

JointNames = Annotated[tuple[str, ...], Field(min_length=1)]
"""Joints of a file, which may name one twice or call it something that is no name; those are not wanted."""

_ROUNDING = 1e-9
_EVEN_S = 1e-6


@dataclass(frozen=True, eq=False, repr=False)
class Motion:
    """A trajectory with its tick, checked once when it is made.

    Attributes:
        angles: Joint angles [rad], shape (n_steps, n_joints), float64, finite; at least one row.
        dt_s: Time from one posture to the next [s].
        joints: Name of each column.
        metadata: Source, memory, PB value, command, versions, ...; plain JSON values.

    Raises:
        ShapeError: If `angles` is not such an array.
        SettingsError: If `dt_s` is not positive, a name is not plain ASCII or repeats, or `metadata` is not JSON.

    Example:
        >>> Motion(np.zeros((3, 1)), 0.1, ("RElbowYaw",))
        Motion of 1 joint: 3 postures at 0.1 s, 0.2 s long
    """

    angles: np.ndarray
    dt_s: float
    joints: tuple[str, ...] = JOINTS
    metadata: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check everything, and keep an own copy in float64."""
        for name, kind in {"joints": Names, "dt_s": Tick, "metadata": JsonObject}.items():
            object.__setattr__(self, name, checked(kind, getattr(self, name), name))
        for name in self.joints:
            if not (name.isascii() and name.replace("_", "a").replace("/", "a").isalnum()):
                raise SettingsError(f"`joints`: a name should be ASCII letters, digits, _ and /, but one is {name!r}.")
        object.__setattr__(self, "angles", joint_angles(self.angles, "angles", self.joints))

    def __repr__(self) -> str:
        joints = f"{len(self.joints)} joint{'s' if len(self.joints) > 1 else ''}"
        return f"Motion of {joints}: {len(self.angles)} postures at {self.dt_s:g} s, {self.duration_s:g} s long"

    def _repr_png_(self) -> bytes:
        """Return the curves of the joints, for Jupyter."""
        return draw_curves({str(self.metadata.get("source", ""))[:60]: self.angles}, self.dt_s, self.joints)

    @property
    def duration_s(self) -> float:
        """From the first posture to the last [s]."""
        return (len(self.angles) - 1) * self.dt_s

    def times_s(self, start_s: float = 0.0) -> list[float]:
        """Return when each posture is reached if the first one is at `start_s` [s], to the nanosecond."""
        return [round(start_s + step * self.dt_s, 9) for step in range(len(self.angles))]

    def lead_s(self) -> float:
        """Return how long the way to the first posture takes at a safe speed [s]: whole cycles, at least `MIN_LEAD_S`.

        The robot must not jump there, and a file cannot know where the robot is: the farthest end of each range counts.
        """
        farthest = 0.0
        for joint, angle in zip(self.joints, self.angles[0], strict=True):
            low, high = LIMITS_RAD.get(joint, (angle, angle))
            farthest = max(farthest, angle - low, high - angle)
        seconds = max(MIN_LEAD_S, farthest / APPROACH_SPEED_RAD_S)
        return round(math.ceil(seconds / CYCLE_S - _ROUNDING) * CYCLE_S, 9)


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
    """A movement read from a file, the name of its format, and what was recognised, left out or changed in notes."""

    motion: Motion
    format: str
    notes: tuple[str, ...]


def text_of(path: Path, content: bytes) -> str:
    """Return the content of a movement's file as UTF-8 text."""
    return storage.as_text(content, str(path), "movement")


def to_motion(
    keys: Keys, path: Path, dt_s: float | None, joints: tuple[str, ...] | None
) -> tuple[Motion, tuple[str, ...]]:
    """Turn keys into a movement of the wanted joints at one tick, and tell what was done; `path` is for messages.

    `dt_s` [s] and `joints` are those of `formats.read`. FileFormatError tells of a wanted joint that is missing, times
    that do not rise, and a movement that is too short or too long; SettingsError of a `dt_s` that is not positive.
    """
    dt_s = None if dt_s is None else checked(Tick, dt_s, "dt_s")
    notes = list(keys.notes)
    wanted = keys.joints if joints is None else checked(Names, joints, "joints")
    for name in wanted:
        if name not in keys.joints:
            raise FileFormatError(
                f"{path}: joint `{name}` is missing{nearest_name(name, keys.joints)}; "
                f"the file has {', '.join(keys.joints)[:200]}."
            )
        if keys.joints.count(name) > 1:
            raise FileFormatError(f"{path}: joint `{name}` stands in the file more than once.")
    columns = [keys.joints.index(name) for name in wanted]
    ignored = [name for name in keys.joints if name not in wanted]
    if ignored:
        notes.append(f"left out, not among the wanted joints: {', '.join(ignored)[:300]}")
    times, angles = [keys.times[c] for c in columns], [keys.angles[c] for c in columns]
    for name, when, where in zip(wanted, times, angles, strict=True):
        _check(f"{path}: {name}", when, where)
    angles = _in_radians(wanted, angles, keys.unit, notes)
    when, postures = _together(times, angles, notes)
    if len(when) < 2:
        raise FileFormatError(f"{path}: has a single posture, expected at least 2.")
    own = _own_tick(when, keys.time_step_s)
    if own is not None and (dt_s is None or abs(own - dt_s) <= _EVEN_S):
        return Motion(postures, own if dt_s is None else dt_s, wanted, keys.metadata), tuple(notes)
    tick = DT_S if dt_s is None else dt_s
    check_duration(float(when[-1] - when[0]), tick, MAX_POSTURES, f"{path}")
    rate = "unevenly spaced postures" if own is None else f"postures every {own:g} s"
    notes.append(f"{rate} brought to a tick of {tick:g} s")
    return Motion(resample(when, postures, tick), tick, wanted, keys.metadata), tuple(notes)


def _check(joint: str, times: np.ndarray, angles: np.ndarray) -> None:
    """Refuse keys of one joint that are no movement; `joint` begins the message."""
    if len(times) != len(angles) or not len(times):
        raise FileFormatError(f"{joint} has {len(times)} times and {len(angles)} angles, expected as many.")
    if len(times) > MAX_POSTURES:
        raise FileFormatError(f"{joint} has {len(times)} keys, expected at most {MAX_POSTURES}.")
    if not (np.isfinite(times).all() and np.isfinite(angles).all()):
        raise FileFormatError(f"{joint} has a time or an angle that is not a finite number.")
    for what, values, most in (("time", times, LARGEST_TIME_S), ("angle", angles, LARGEST_ANGLE)):
        if np.abs(values).max() > most:
            raise FileFormatError(f"{joint} has the {what} {values[np.abs(values).argmax()]:g}, beyond {most:g}.")
    steps = np.diff(times)
    late = np.flatnonzero(steps < SHORTEST_STEP_S)
    if len(late) and steps[late[0]] > 0:
        raise FileFormatError(f"{joint} has keys {steps[late[0]]:g} s apart, expected {SHORTEST_STEP_S:g} or more.")
    if len(late):
        k = int(late[0]) + 1
        path, _, name = joint.rpartition(": ")
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
        monotone_cubic(when, where, common) if len(when) > 1 else np.full(len(common), where[0])
        for when, where in zip(times, angles, strict=True)
    ]
    notes.append("joints have keys at different times; between a joint's keys a monotone cubic was taken")
    return common, np.stack(columns, axis=1)


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
