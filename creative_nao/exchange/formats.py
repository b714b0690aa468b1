"""Write a movement in any format, read one from any file; the tables CSV and NPZ.

CSV is read less strictly here than where a network learns from it: degrees are recognised, and angles beyond a range
are left to the check before an export. Every bit of every angle comes back.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from creative_nao import storage
from creative_nao.arrays import only_arrays, unpack_npz
from creative_nao.demonstrations import files
from creative_nao.demonstrations.files import MAX_FILE_BYTES
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError, nearest_name
from creative_nao.exchange import choregraphe, simulators
from creative_nao.exchange.keys import Keys, Motion, Recording, text_of, to_motion
from creative_nao.exchange.safety import Unsafe, made_safe
from creative_nao.joints import JOINTS
from creative_nao.schema import JsonObject, checked, checked_path, parse


def write_csv(motion: Motion, path: Path) -> list[str]:
    """Write `time_s` and one column for each joint."""
    files.save_trajectory(path, motion.angles, motion.dt_s, motion.joints)
    return []


def read_csv(path: Path, content: bytes) -> Keys:
    """Read a CSV file with a column `time_s` in seconds; errors name line and column."""
    header, rows = files.read_table(path, text_of(path, content))
    time = files.TIME_COLUMN
    if header.count(time) != 1 or len(header) < 2:
        raise FileFormatError(
            f"{path}: the first line should be `{time}` and joint names, but is {', '.join(header)[:200]}."
        )
    columns: list[list[float]] = [[] for _ in header]
    for line, row in rows:
        for cell, name, column in zip(row, header, columns, strict=True):
            try:
                column.append(files.cell_number(cell))
            except ValueError:
                if "," in cell:
                    told = f"`{name}` is `{cell[:40]}`; a decimal comma?"
                    raise FileFormatError(f"{path}: line {line}: {told}") from None
                column.append(float("nan"))  # a column that nobody wants may hold text
    times = np.array(columns.pop(header.index(time)))
    joints = tuple(name for name in header if name != time)
    if np.isnan(times).any():
        raise FileFormatError(f"{path}: `{time}` holds something that is not a number.")
    return Keys(joints, [times] * len(joints), [np.array(column) for column in columns])


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
    """Read what `write_npz` writes; `times_s`, shape (n_steps,), may stand in the place of `dt_s`. No pickles."""
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
    metadata = arrays.get("metadata", np.array("{}"))
    if metadata.dtype.kind != "U" or metadata.shape != ():
        raise FileFormatError(f"{path}: `metadata` should be JSON text, but is {metadata.dtype}.")
    metadata = parse(JsonObject, str(metadata), str(path))
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


@dataclass(frozen=True)
class Format:
    """One format in both directions."""

    endings: tuple[str, ...]
    write: Callable[[Motion, Path], list[str]]
    read: Callable[[Path, bytes], Keys]
    purpose: str
    holds_metadata: bool
    for_robots: bool
    """A robot or a simulator plays such files, so an unsafe movement is never kept in one."""


FORMATS: dict[str, Format] = {
    "csv": Format((".csv",), write_csv, read_csv, "table, for `train` and `score`", False, False),
    "npz": Format((".npz",), write_npz, read_npz, "NumPy arrays, no pickle", True, False),
    "naoqi": Format((".py",), choregraphe.write_script, choregraphe.read_python, "program for the robot", True, True),
    "json": Format((".json",), choregraphe.write_json, choregraphe.read_json, "the lists NAOqi takes", True, True),
    "ros": Format(
        (".yaml", ".yml", ".json"), simulators.write_ros, simulators.read_ros, "JointTrajectory", False, True
    ),
    "webots": Format((".motion",), simulators.write_motion, simulators.read_motion, "Webots motion", False, True),
}
"""Every format by name."""


@dataclass(frozen=True)
class Exported:
    """What came of an export."""

    path: Path
    format: str
    motion: Motion
    """The movement as it was written."""
    changes: tuple[str, ...]
    """What was clipped, slowed down or kept although unsafe; empty for a safe movement."""
    notes: tuple[str, ...]
    """What else to know, one sentence each."""
    record: Path | None = None
    """The file of the metadata beside it, for formats that cannot hold any."""


def format_for(path: str | os.PathLike[str]) -> str:
    """Return the format that a file to be written has by its ending; SettingsError if none has this ending."""
    ending = checked_path(path).suffix.lower()
    for name, one in FORMATS.items():
        if ending in one.endings:
            return name
    known = ", ".join(f"{'/'.join(one.endings)} ({name})" for name, one in FORMATS.items())
    raise SettingsError(f"no format for {str(path)!r}; known endings are {known}.")


def write(
    path: str | os.PathLike[str], motion: Motion, format: str | None = None, *, unsafe: Unsafe = "refuse"
) -> Exported:
    """Check a movement and write it to a file, replaced in one step; return what was written and changed for safety.

    Args:
        path: The file.
        motion: The movement.
        format: One of `FORMATS`; None: by the ending of the file.
        unsafe: What to do with a movement beyond the joints' ranges or speeds, as in `safety.made_safe`.

    Raises:
        UnsafeMotionError: If the movement is unsafe and may not be changed.
        NotFoundError: If there is no such format.
        SettingsError: If the ending does not fit the format, or an unsafe movement is to be kept in a robot's format.
    """
    path = checked_path(path)
    checked(Motion, motion, "motion")
    name = format_for(path) if format is None else _known(format)
    one = FORMATS[name]
    if path.suffix.lower() not in one.endings:
        raise SettingsError(f"a file of the format {name} should end in {' or '.join(one.endings)}, but is {path}.")
    if unsafe == "keep" and one.for_robots:
        raise SettingsError(f"`unsafe` = keep is for csv, npz and films; a robot plays {name}, use clip.")
    safe, changes = made_safe(motion, unsafe)
    notes = one.write(safe, path)
    record = None
    if safe.metadata and not one.holds_metadata and path.suffix.lower() not in (".yaml", ".yml"):
        record = path.with_name(path.name + ".record.json")
        storage.write_text(record, json.dumps(safe.metadata, indent=2) + "\n")
    return Exported(path, name, safe, tuple(changes), tuple(notes), record)


def recognise(path: str | os.PathLike[str], content: bytes) -> str:
    """Return the format of a file by what it begins with, then by its ending; SettingsError if neither tells."""
    start = content[:4096].lstrip(b"\xef\xbb\xbf \t\r\n")
    if start.startswith(b"PK\x03\x04"):
        return "npz"
    if start.startswith(simulators.MARK.encode()):
        return "webots"
    if start.startswith(b"{"):
        return "ros" if b'"joint_names"' in content and b'"points"' in content else "json"
    ending = Path(path).suffix.lower()
    if ending not in (".json", ".npz") and any(ending in one.endings for one in FORMATS.values()):
        return format_for(path)
    if b"time_s" in start.split(b"\n", 1)[0]:
        return "csv"
    if b"joint_names:" in start:
        return "ros"
    if b".append(" in content or b"names =" in content:
        return "naoqi"
    return format_for(path)


def read(
    path: str | os.PathLike[str],
    dt_s: float | None = None,
    joints: tuple[str, ...] | None = JOINTS,
    format: str | None = None,
) -> Recording:
    """Read a movement from a file of any format; its format is recognised by ending and content.

    Args:
        path: The file.
        dt_s: Wanted tick [s]; None: the file's own if its postures are evenly spaced, else 0.15 s.
        joints: Wanted joints, in this order, whatever the file's; None: all.
        format: One of `FORMATS`; None: recognised.

    Returns:
        The movement in radians, the format, and notes on what was recognised, left out or changed.

    Raises:
        NotFoundError: If there is no such file or format.
        FileFormatError: If the file does not hold a movement; the message names the file, the part and the reason.
    """
    path = checked_path(path)
    content = storage.read_bytes(path, "movement", MAX_FILE_BYTES)
    if not content.strip():
        raise FileFormatError(f"{path}: is empty, expected a movement.")
    name = recognise(path, content) if format is None else _known(format)
    motion, notes = to_motion(FORMATS[name].read(path, content), path, dt_s, joints)
    return Recording(motion, name, notes)


def _known(name: str) -> str:
    if name not in FORMATS:
        raise NotFoundError(f"no format `{name}`{nearest_name(str(name), FORMATS)}; there are {', '.join(FORMATS)}.")
    return name
