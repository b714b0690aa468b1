"""Webots `.motion`: a header with the joint names, then one posture a line, time as minutes:seconds:milliseconds.

Angles come back exactly; times are rounded to the millisecond, which is all the format can say.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from creative_nao import atomic
from creative_nao.errors import FileFormatError, SettingsError
from creative_nao.exchange import reading
from creative_nao.exchange.keys import Keys
from creative_nao.exchange.motion import Motion

MARK = "#WEBOTS_MOTION"
_VERSION = "V1.0"
_TIME = re.compile(r"(\d{1,4}):(\d{1,2}):(\d{1,3})", re.ASCII)
_UNCHANGED = "*"
_LARGEST_S = 100 * 60


def write_motion(motion: Motion, path: Path) -> list[str]:
    """Write a `.motion` file; the first posture is at time 0, as the simulator expects.

    Raises:
        SettingsError: If two postures fall into one millisecond, or the movement lasts 100 minutes.
    """
    if motion.dt_s < 0.001 or motion.duration_s >= _LARGEST_S:
        raise SettingsError(
            f"a Webots motion has ticks of 1 ms or more and lasts less than 100 minutes, but this one has ticks of "
            f"{motion.dt_s:g} s and lasts {motion.duration_s:g} s."
        )
    lines = [",".join([MARK, _VERSION, *motion.joints])]
    for step, (time, posture) in enumerate(zip(motion.times_s(), motion.angles, strict=True)):
        milliseconds = round(time * 1000)
        stamp = f"{milliseconds // 60000:02d}:{milliseconds // 1000 % 60:02d}:{milliseconds % 1000:03d}"
        angles = [np.format_float_positional(angle, trim="0") for angle in posture]
        lines.append(",".join([stamp, f"Pose{step + 1}", *angles]))
    atomic.write_text(path, "\n".join(lines) + "\n")
    inexact = any(abs(time * 1000 - round(time * 1000)) > 1e-6 for time in motion.times_s())
    return ["times are rounded to the millisecond"] if inexact else []


def read_motion(path: Path, content: bytes) -> Keys:
    """Read a `.motion` file; an asterisk leaves a joint without a key at that time.

    Raises:
        FileFormatError: If it is not such a file; the message names the line.
    """
    lines = [line.strip() for line in reading.as_text(path, content).splitlines()] or [""]
    header = [cell.strip() for cell in lines[0].split(",")]
    if header[0] != MARK or len(header) < 3:
        raise FileFormatError(f"{path}: line 1 should be {MARK},{_VERSION},JOINT,..., but is {lines[0][:80]}.")
    joints = tuple(header[2:])
    times: list[list[float]] = [[] for _ in joints]
    angles: list[list[float]] = [[] for _ in joints]
    for place, line in enumerate(lines[1:], start=2):
        if not line or line.startswith("#"):
            continue
        cells = [cell.strip() for cell in line.split(",")]
        if len(cells) != len(joints) + 2:
            raise FileFormatError(
                f"{path}: line {place}: has {len(cells)} cells, expected {len(joints) + 2}: "
                f"time, pose and {len(joints)} angles."
            )
        found = _TIME.fullmatch(cells[0])
        if not found:
            raise FileFormatError(
                f"{path}: line {place}: time is {cells[0][:40]!r}, expected minutes:seconds:milliseconds."
            )
        minutes, seconds, milliseconds = (int(part) for part in found.groups())
        time = (minutes * 60000 + seconds * 1000 + milliseconds) / 1000
        for column, cell in enumerate(cells[2:]):
            if cell != _UNCHANGED:
                times[column].append(time)
                angles[column].append(_angle(cell, joints[column], path, place))
    notes = [] if header[1] == _VERSION else [f"version {header[1][:20]!r} was read as {_VERSION}"]
    return Keys(joints, [np.array(t) for t in times], [np.array(a) for a in angles], time_step_s=0.001, notes=notes)


def _angle(cell: str, joint: str, path: Path, line: int) -> float:
    try:
        if "_" in cell:
            raise ValueError
        return float(cell)
    except ValueError:
        raise FileFormatError(f"{path}: line {line}: {joint} is {cell[:40]!r}, expected an angle or `*`.") from None
