"""From the keys of a file to a movement: one set of checks for every format, and one wording.

Joint names may come in any order; units are recognised where that is certain; what was recognised, converted, filled,
left out or changed on the way is said in notes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np

from creative_nao import storage
from creative_nao.errors import FileFormatError, nearest_name
from creative_nao.exchange.motion import (
    DEGREES_FROM_RAD,
    DT_S,
    LIMIT_TOLERANCE_RAD,
    Motion,
    Tick,
    check_duration,
    monotone_cubic,
    outside_range,
    resample,
)
from creative_nao.joints import JOINTS, LIMITS_RAD, limits
from creative_nao.robot.postures import arm_angles
from creative_nao.schema import Count, Field, Names, Positive, checked, record

MAX_POSTURES = 20_000  # longest movement that is read, in postures
LARGEST_ANGLE = 1e6  # largest angle that is read, in radians or degrees
LARGEST_TIME_S = 1e12  # clocks that count from 1970 stand at 2e9
SHORTEST_STEP_S = 1e-6
MAX_MOVEMENTS = 1_000

JointNames = Annotated[tuple[str, ...], Field(min_length=1)]
"""Joints of a file, which may name one twice or call it something that is no name; those are not wanted."""

Fill = Literal["guard", "rest", "zero"]
_FILLED_BY = {"guard": "Guard", "rest": "Stand", "zero": "StandZero"}
TIME_UNITS_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_EVEN_S = 1e-6
_LONG_S = 600.0  # movements last seconds; one of ten minutes, or with postures this far apart, is asked about
_FAR_APART_S = ((3, 5.0), (20, 1.0))
_MOST_LIKELY = 0.8  # names as alike as this are the same one, mistyped
_MOST_IN_DEGREES = 0.5  # share of the postures of a recording in degrees that no joint could reach in radians

_ARM = ("ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll", "WristYaw", "Hand")
_LEG = ("HipYawPitch", "HipRoll", "HipPitch", "KneePitch", "AnklePitch", "AnkleRoll")
CHAINS = {
    "Head": ("HeadYaw", "HeadPitch"),
    **{f"{side}Arm": tuple(side + joint for joint in _ARM) for side in "LR"},
    **{f"{side}Leg": tuple(side + joint for joint in _LEG) for side in "LR"},
}
"""NAOqi's names for several joints; an arm without wrist and hand has four."""
CHAINS["Body"] = tuple(joint for chain in ("Head", "LArm", "LLeg", "RLeg", "RArm") for joint in CHAINS[chain])
_NAO = set(CHAINS["Body"])


@record
class Reading:
    """What a file does not say about itself; the command line has a flag for each."""

    fill: Fill | None = None
    """Posture in which joints are held that a recording does not have: the boxing guard, standing at rest, or zero;
    default: such a recording is refused."""
    rate: Positive | None = None
    """Postures a second, for a table or postures without times; default: the file's own times."""
    time_column: str | None = None
    """Column of a table that holds the time; default: `time_s`, or the one that is called time."""
    time_unit: Literal["s", "ms", "us", "ns"] | None = None
    """Unit of the times; default: what the file says, else seconds."""
    unit: Literal["radians", "degrees"] | None = None
    """Unit of the angles; default: what the file says, else recognised."""
    movement: Count | None = None
    """Which movement of a file that holds several, from 1; default: all, where a command takes several."""


NOTHING_SAID = Reading()
"""Every file speaks for itself."""


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
    faults: dict[str, str] = field(default_factory=dict)
    """What is wrong with a joint's column, told if the joint is wanted."""
    lines: Sequence[Sequence[int]] | None = None
    """For each joint the line of each key, where the file has one a line."""
    seconds_known: bool = False
    """Whether the file itself says in which unit its times are."""
    place: str = ""
    """Where the movement stands in a file of several."""
    asked: bool = False
    """Whether the reader has followed `Reading.time_unit` itself."""

    def where(self, column: int, key: int) -> str:
        """Return how to name a key: by its line, or its number from 1."""
        return f"key {key + 1}" if self.lines is None else f"line {self.lines[column][key]}"


@dataclass(frozen=True, eq=False)
class Recording:
    """A movement read from a file, the name of its format, and what was recognised, left out or changed in notes."""

    motion: Motion
    format: str
    notes: tuple[str, ...]
    place: str = ""
    """Where it stands in a file of several movements."""


def text_of(path: Path, content: bytes) -> str:
    """Return the content of a movement's file as UTF-8 text."""
    return storage.as_text(content, str(path), "movement")


def whole_chains(path: Path, names: Sequence[str], n_lists: int) -> tuple[str, ...]:
    """Return joint names with NAOqi's chains, such as `LArm`, replaced by their joints, as many as there are lists."""
    joints: list[str] = []
    short = sum(name in ("LArm", "RArm", "Body") for name in names)
    for name in names:
        chain = CHAINS.get(name, (name,))
        if short == 1 and name in ("LArm", "RArm") and n_lists == len(names) + 3:
            chain = chain[:4]
        elif short == 1 and name == "Body" and n_lists == len(names) + 24:
            chain = tuple(joint for joint in chain if joint != "RHipYawPitch")
        elif short == 2 and n_lists == len(names) + 6:
            chain = chain[:4]
        joints += chain
    if len(joints) != n_lists and any(name in CHAINS for name in names):
        told = " and ".join(name for name in names if name in CHAINS)
        raise FileFormatError(f"{path}: {told} make {len(joints)} joints, but there are lists for {n_lists}.")
    return tuple(joints)


def to_motion(
    keys: Keys,
    path: Path,
    dt_s: float | None,
    joints: tuple[str, ...] | None,
    reading: Reading | None = None,
    *,
    beyond: Literal["refuse", "keep"] = "keep",
) -> tuple[Motion, tuple[str, ...]]:
    """Turn keys into a movement of the wanted joints at one tick, and tell what was done; `path` is for messages.

    `dt_s` [s], `joints` and `beyond` are those of `formats.read`. FileFormatError tells of a wanted joint that is
    missing, angles that are none, times that do not rise, and a movement that is too short or too long.
    """
    reading = reading or NOTHING_SAID
    dt_s = None if dt_s is None else checked(Tick, dt_s, "dt_s")
    notes = list(keys.notes)
    wanted = keys.joints if joints is None else checked(Names, joints, "joints")
    present = tuple(name for name in wanted if name in keys.joints)
    held = _to_hold(keys, path, wanted, present, reading.fill)
    for name in present:
        if keys.joints.count(name) > 1:
            raise FileFormatError(f"{path}: joint `{name}` stands in the file more than once.")
        if name in keys.faults:
            raise FileFormatError(f"{path}: {keys.faults[name]}.")
    columns = [keys.joints.index(name) for name in present]
    if ignored := [name for name in keys.joints if name not in wanted]:
        notes.append(f"left out, not among the wanted joints: {', '.join(ignored)[:300]}")
    times, angles = [keys.times[c] for c in columns], [keys.angles[c] for c in columns]
    if (reading.time_unit and keys.seconds_known and not keys.asked) or reading.unit not in (
        None,
        keys.unit or reading.unit,
    ):
        option = "--time-unit" if reading.unit in (None, keys.unit) else "--unit"
        raise FileFormatError(f"{path}: says its own unit, so {option} is not for it; leave it out.")
    if reading.time_unit is not None and not keys.seconds_known and reading.time_unit != "s":
        times = [when * TIME_UNITS_S[reading.time_unit] for when in times]
        notes.append(f"times read in {reading.time_unit}")
    for column, when, where in zip(columns, times, angles, strict=True):
        _check(keys, path, column, when, where)
    if not keys.seconds_known and reading.time_unit is None:
        _ask_about_seconds(path, times)
    angles = _in_radians(path, keys, columns, angles, reading.unit or keys.unit, notes)
    if beyond == "refuse":
        for column, where in zip(columns, angles, strict=True):
            if found := outside_range(where[:, None], (keys.joints[column],)):
                place, joint = keys.where(column, found[0]), keys.joints[column]
                raise FileFormatError(f"{path}: {place}: `{joint}` {found[2]}.")
    when, postures = _together(times, angles, notes)
    if len(when) < 2:
        raise FileFormatError(f"{path}: has a single posture, expected at least 2.")
    if held:
        known = dict(zip(present, postures.T, strict=True))
        postures = np.stack([known.get(name, np.full(len(when), held.get(name))) for name in wanted], axis=1)
        notes.append(f"held in the {reading.fill} posture: {', '.join(held)}")
    own = _own_tick(when, keys.time_step_s)
    if own is not None and (dt_s is None or abs(own - dt_s) <= _EVEN_S):
        return Motion(postures, own if dt_s is None else dt_s, wanted, keys.metadata), tuple(notes)
    tick = DT_S if dt_s is None else dt_s
    check_duration(float(when[-1] - when[0]), tick, MAX_POSTURES, f"{path}")
    rate = "unevenly spaced postures" if own is None else f"postures every {own:g} s"
    notes.append(f"{rate} brought to a tick of {tick:g} s")
    return Motion(resample(when, postures, tick), tick, wanted, keys.metadata), tuple(notes)


def _to_hold(
    keys: Keys, path: Path, wanted: tuple[str, ...], present: tuple[str, ...], fill: Fill | None
) -> dict[str, float]:
    """Return at which angle each joint is held that is wanted but not in the file; refuse what cannot be filled."""
    missing = [name for name in wanted if name not in keys.joints]
    if not missing:
        return {}
    strange = [name for name in keys.joints if name not in _NAO and name not in wanted]
    told = ", ".join(f"`{name}`" for name in missing[:8])
    whole = {"L": JOINTS[4:], "R": JOINTS[:4]}
    for side, arm in whole.items():
        if tuple(missing) == arm:
            told += f" (the whole {'left' if side == 'L' else 'right'} arm)"
    likely = next((hint for name in missing if (hint := nearest_name(name, strange))), "")
    if all(f"{name}_x" in keys.joints for name in ("RShoulder", "RElbow")) or "RIGHT_SHOULDER_x" in keys.joints:
        likely = "; these are places of a body: `creative-nao teach --from` turns them into angles"
    typed = [name for name in missing if _mistyped(name, strange)]
    fault = f"{path}: {told} {'is' if len(missing) == 1 else 'are'} missing{likely}"
    if fill is None or not present or typed or any(name not in JOINTS for name in missing):
        has = f"; the file has {', '.join(keys.joints)[:200]}"
        may = present and not typed and all(name in JOINTS for name in missing)
        hint = f"; {' or '.join(f'--fill {one}' for one in get_args(Fill))} holds what is missing" if may else ""
        raise FileFormatError(f"{fault}{has}{hint}.")
    angles = dict(zip(JOINTS, arm_angles(_FILLED_BY[fill]), strict=True))
    if fill == "zero":
        low, high = limits()
        angles = dict(zip(JOINTS, np.clip(0.0, low, high), strict=True))
    return {name: float(angles[name]) for name in missing}


def _mistyped(name: str, strange: Sequence[str]) -> bool:
    import difflib

    return bool(difflib.get_close_matches(name, [s for s in strange if len(s) < 60], n=1, cutoff=_MOST_LIKELY))


def _check(keys: Keys, path: Path, column: int, times: np.ndarray, angles: np.ndarray) -> None:
    """Refuse keys of one joint that are no movement."""
    joint = f"{path}: {keys.joints[column]}"
    if len(times) != len(angles) or not len(times):
        raise FileFormatError(f"{joint} has {len(times)} times and {len(angles)} angles, expected as many.")
    if len(times) > MAX_POSTURES:
        raise FileFormatError(f"{joint} has {len(times)} keys, expected at most {MAX_POSTURES}.")
    for what, values, most in (("time", times, LARGEST_TIME_S), ("angle", angles, LARGEST_ANGLE)):
        wild = np.flatnonzero(~(np.abs(values) <= most))
        if len(wild) and not np.isfinite(values[wild[0]]):
            place = keys.where(column, int(wild[0]))
            raise FileFormatError(f"{joint}: {place}: has a time or an angle that is not a finite number.")
        if len(wild):
            place = keys.where(column, int(wild[0]))
            raise FileFormatError(f"{joint}: {place}: has the {what} {values[wild[0]]:g}, beyond {most:g}.")
    steps = np.diff(times)
    late = np.flatnonzero(steps < SHORTEST_STEP_S)
    if len(late) and steps[late[0]] > 0:
        raise FileFormatError(
            f"{joint}: {keys.where(column, int(late[0]) + 1)}: follows after {steps[late[0]]:g} s, expected "
            f"{SHORTEST_STEP_S:g} or more."
        )
    if len(late):
        k = int(late[0]) + 1
        raise FileFormatError(
            f"{path}: {keys.where(column, k)}: times of {keys.joints[column]} should rise, but {times[k]:.9g} s "
            f"follows {times[k - 1]:.9g} s."
        )


def _ask_about_seconds(path: Path, times: list[np.ndarray]) -> None:
    """Refuse times that are more likely milliseconds."""
    when = max(times, key=len)
    first, last = min(float(one[0]) for one in times), max(float(one[-1]) for one in times)
    apart = float(np.median(np.diff(when))) if len(when) > 1 else 0.0
    if last - first > _LONG_S or any(len(when) >= n and apart >= far for n, far in _FAR_APART_S):
        raise FileFormatError(
            f"{path}: lasts {last - first:g} s with {apart:g} s between postures: are the times in seconds, not "
            "milliseconds? Say --time-unit ms, or s if they are."
        )


def _in_radians(
    path: Path, keys: Keys, columns: list[int], angles: list[np.ndarray], unit: str | None, notes: list[str]
) -> list[np.ndarray]:
    """Bring angles to radians; where nothing says the unit, what no joint could reach in radians means degrees."""
    if unit is None:
        joints = [keys.joints[column] for column in columns]
        fits = [_within(joint, values) for joint, values in zip(joints, angles, strict=True)]
        if all(one.all() for one in fits) or max(float(np.abs(v).max()) for v in angles) <= DEGREES_FROM_RAD:
            return angles
        n_all = sum(map(len, angles))
        largest = max(float(np.abs(values).max()) for values in angles)
        share = sum(int((~one).sum()) for one in fits) / n_all
        inside = sum(
            int(_within(joint, np.deg2rad(values)).sum()) for joint, values in zip(joints, angles, strict=True)
        )
        if share < _MOST_IN_DEGREES / 2 or inside < _MOST_IN_DEGREES * n_all:
            column, key = _farthest(columns, angles)
            raise FileFormatError(
                f"{path}: {keys.where(column, key)}: `{keys.joints[column]}` is {keys.angles[column][key]:.6g}, looks "
                f"like degrees, but {1 - share:.0%} of the angles could be radians; say --unit radians or degrees."
            )
        notes.append(f"angles converted from degrees: the largest is {largest:.4g}")
        unit = "degrees"
    elif unit == "degrees":
        notes.append("angles converted from degrees")
    return [np.deg2rad(values) for values in angles] if unit == "degrees" else angles


def _farthest(columns: list[int], angles: list[np.ndarray]) -> tuple[int, int]:
    place = max(range(len(angles)), key=lambda k: float(np.abs(angles[k]).max()))
    return columns[place], int(np.abs(angles[place]).argmax())


def _within(joint: str, values: np.ndarray) -> np.ndarray:
    low, high = LIMITS_RAD.get(joint, (-DEGREES_FROM_RAD, DEGREES_FROM_RAD))
    return (values >= low - LIMIT_TOLERANCE_RAD) & (values <= high + LIMIT_TOLERANCE_RAD)


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
