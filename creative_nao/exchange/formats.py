"""Write a movement in any format, read one from any file."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from creative_nao import storage
from creative_nao.demonstrations.files import checked_path
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError, nearest_name
from creative_nao.exchange import choregraphe, ros, tables
from creative_nao.exchange.keys import MAX_FILE_BYTES, Keys, Motion, Recording, to_motion
from creative_nao.exchange.safety import Unsafe, made_safe
from creative_nao.joints import JOINTS
from creative_nao.schema import checked


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
    "csv": Format((".csv",), tables.write_csv, tables.read_csv, "table, for `train` and `score`", False, False),
    "npz": Format((".npz",), tables.write_npz, tables.read_npz, "NumPy arrays, no pickle", True, False),
    "naoqi": Format((".py",), choregraphe.write_script, choregraphe.read_python, "program for the robot", True, True),
    "json": Format((".json",), choregraphe.write_json, choregraphe.read_json, "the lists NAOqi takes", True, True),
    "ros": Format(
        (".yaml", ".yml", ".json"), ros.write_ros, ros.read_ros, "JointTrajectory", False, True
    ),
    "webots": Format((".motion",), tables.write_motion, tables.read_motion, "Webots motion", False, True),
}  # fmt: skip
"""Every format by name."""

_YAML = (".yaml", ".yml")


@dataclass(frozen=True)
class Exported:
    """What came of an export.

    Attributes:
        path: The file.
        format: Its format.
        motion: The movement as it was written.
        changes: What was clipped, slowed down or kept although unsafe; empty for a safe movement.
        notes: What else to know, one sentence each.
        record: The file of the metadata beside it, for formats that cannot hold any.
    """

    path: Path
    format: str
    motion: Motion
    changes: tuple[str, ...]
    notes: tuple[str, ...]
    record: Path | None = None


def format_for(path: str | os.PathLike[str]) -> str:
    """Return the format that a file to be written has by its ending.

    Raises:
        SettingsError: If no format has this ending.
    """
    ending = checked_path(path).suffix.lower()
    for name, one in FORMATS.items():
        if ending in one.endings:
            return name
    known = ", ".join(f"{'/'.join(one.endings)} ({name})" for name, one in FORMATS.items())
    raise SettingsError(f"no format for {str(path)!r}; known endings are {known}.")


def write(
    path: str | os.PathLike[str], motion: Motion, format: str | None = None, *, unsafe: Unsafe = "refuse"
) -> Exported:
    """Check a movement and write it to a file, which is replaced in one step.

    Args:
        path: The file.
        motion: The movement.
        format: One of `FORMATS`; None: by the ending of the file.
        unsafe: What to do with a movement beyond the joints' ranges or speeds, as in `safety.made_safe`.

    Returns:
        What was written, and what was changed for safety.

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
    if safe.metadata and not one.holds_metadata and path.suffix.lower() not in _YAML:
        record = path.with_name(path.name + ".record.json")
        storage.write_text(record, json.dumps(safe.metadata, indent=2) + "\n")
    return Exported(path, name, safe, tuple(changes), tuple(notes), record)


def recognise(path: str | os.PathLike[str], content: bytes) -> str:
    """Return the format of a file by what it begins with and, where that leaves a doubt, by its ending.

    Raises:
        SettingsError: If neither tells.
    """
    start = content[:4096].lstrip(b"\xef\xbb\xbf \t\r\n")
    if start.startswith(b"PK\x03\x04"):
        return "npz"
    if start.startswith(tables.MARK.encode()):
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
