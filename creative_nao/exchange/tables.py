"""Movements as tables: CSV as in `demonstrations/files.py`, NPZ without pickle, and Webots `.motion`.

CSV is read less strictly here than where a network learns from it: degrees are recognised, and angles beyond a range
are left to the check before an export. A Webots file has a header with the joint names, then one posture a line, with
its time as minutes:seconds:milliseconds. Every bit of every angle comes back.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao import storage
from creative_nao.arrays import only_arrays, unpack_npz
from creative_nao.demonstrations import files
from creative_nao.errors import FileFormatError, SettingsError
from creative_nao.exchange.keys import MAX_FILE_BYTES, Keys, Motion, json_object, text_of


def write_csv(motion: Motion, path: Path) -> list[str]:
    """Write `time_s` and one column for each joint."""
    files.save_trajectory(path, motion.angles, motion.dt_s, motion.joints)
    return []


def read_csv(path: Path, content: bytes) -> Keys:
    """Read a CSV file with a column `time_s` in seconds.

    Raises:
        FileFormatError: If it is not such a table; the message names line and column.
    """
    header, rows = files.read_table(path, text_of(path, content))
    time = files.TIME_COLUMN
    if header.count(time) != 1 or len(header) < 2:
        raise FileFormatError(
            f"{path}: the first line should be `{time}` and joint names, but is {', '.join(header)[:200]}."
        )
    columns = [[_cell(row[c], header[c], path, line) for line, row in rows] for c in range(len(header))]
    times = np.array(columns.pop(header.index(time)))
    joints = tuple(name for name in header if name != time)
    if np.isnan(times).any():
        raise FileFormatError(f"{path}: `{time}` holds something that is not a number.")
    return Keys(joints, [times] * len(joints), [np.array(column) for column in columns])


def _cell(cell: str, column: str, path: Path, line: int) -> float:
    """Return a number; what is none becomes NaN, since a column nobody wants may hold text."""
    try:
        return files.cell_number(cell)
    except ValueError:
        if "," in cell:
            raise FileFormatError(f"{path}: line {line}: `{column}` is `{cell[:40]}`; a decimal comma?") from None
        return float("nan")


def write_npz(motion: Motion, path: Path) -> list[str]:
    """Write the arrays `angles`, `dt_s`, `joints` and `metadata` (JSON text)."""
    with storage.replacing(path) as temporary, open(temporary, "wb") as stream:
        np.savez(
            stream,
            angles=motion.angles,
            dt_s=np.array(motion.dt_s),
            joints=np.array(motion.joints),
            metadata=np.array(json.dumps(motion.metadata)),
        )
    return []


def read_npz(path: Path, content: bytes) -> Keys:
    """Read what `write_npz` writes; `times_s`, shape (n_steps,), may stand in the place of `dt_s`.

    Raises:
        FileFormatError: If an array is missing, torn, pickled, or has the wrong type or shape.
    """
    arrays = unpack_npz(path, "movement", content, MAX_FILE_BYTES)
    only_arrays(path, arrays, ("angles", "joints", "dt_s", "times_s", "metadata"))
    for name in ("angles", "joints"):
        if name not in arrays:
            raise FileFormatError(f"{path}: the array `{name}` is missing; the file has {', '.join(arrays)[:200]}.")
    joints, angles = arrays["joints"], arrays["angles"]
    if joints.ndim != 1 or joints.dtype.kind != "U" or not len(joints):
        raise FileFormatError(f"{path}: `joints` should be a list of names, but is {joints.dtype} {joints.shape}.")
    if angles.dtype.kind not in "fiu" or angles.ndim != 2 or angles.shape[1] != len(joints):
        raise FileFormatError(
            f"{path}: `angles` should be numbers of shape (n_steps, {len(joints)}), "
            f"but is {angles.dtype} {angles.shape}."
        )
    times = _times(path, arrays, len(angles))
    metadata = _metadata(path, arrays)
    columns = [column.astype(np.float64) for column in angles.T]
    return Keys(tuple(str(name) for name in joints), [times] * len(columns), columns, "radians", metadata=metadata)


def _times(path: Path, arrays: dict[str, np.ndarray], n_steps: int) -> np.ndarray:
    for name, shape in (("times_s", (n_steps,)), ("dt_s", ())):
        if name in arrays:
            found = arrays[name]
            if found.dtype.kind not in "fiu" or found.shape != shape:
                raise FileFormatError(
                    f"{path}: `{name}` should be numbers of shape {shape}, but is {found.dtype} {found.shape}."
                )
            if name == "times_s":
                return found.astype(np.float64)
            if not (np.isfinite(found) and found > 0):
                raise FileFormatError(f"{path}: `dt_s` should be a positive number of seconds, but is {found}.")
            return np.arange(n_steps) * float(found)
    raise FileFormatError(f"{path}: neither `dt_s` nor `times_s` is there; the file has {', '.join(arrays)[:200]}.")


def _metadata(path: Path, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    if "metadata" not in arrays:
        return {}
    if arrays["metadata"].dtype.kind != "U" or arrays["metadata"].shape != ():
        raise FileFormatError(f"{path}: `metadata` should be JSON text, but is {arrays['metadata'].dtype}.")
    return json_object(path, str(arrays["metadata"]))


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
    storage.write_text(path, "\n".join(lines) + "\n")
    inexact = any(abs(time * 1000 - round(time * 1000)) > 1e-6 for time in motion.times_s())
    return ["times are rounded to the millisecond"] if inexact else []


def read_motion(path: Path, content: bytes) -> Keys:
    """Read a `.motion` file; an asterisk leaves a joint without a key at that time.

    Raises:
        FileFormatError: If it is not such a file; the message names the line.
    """
    lines = [line.strip() for line in text_of(path, content).splitlines()] or [""]
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
        return files.cell_number(cell)
    except ValueError:
        raise FileFormatError(f"{path}: line {line}: {joint} is {cell[:40]!r}, expected an angle or `*`.") from None
