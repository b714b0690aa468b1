"""Write a movement in any format, read one from any file, for every command alike; the arrays of NPZ.

Every bit of every angle comes back.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from creative_nao import storage
from creative_nao.arrays import only_arrays, unpack_npz
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError, nearest_name
from creative_nao.exchange import choregraphe, robot_program, simulators, skeleton, table
from creative_nao.exchange.keys import MAX_MOVEMENTS, NOTHING_SAID, Keys, Reading, Recording, to_motion
from creative_nao.exchange.motion import Motion
from creative_nao.exchange.safety import Unsafe, made_safe
from creative_nao.joints import JOINTS
from creative_nao.schema import JsonObject, checked, checked_path, parse


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


def read_npz(path: Path, content: bytes, reading: Reading = NOTHING_SAID) -> list[Keys]:
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
    names = tuple(str(name) for name in joints)
    return [Keys(names, [times] * len(columns), columns, "radians", metadata=metadata)]


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
    write: Callable[[Motion, Path], list[str]] | None
    read: Callable[..., list[Keys]]
    """From path, content and `Reading` to the movements of a file."""
    purpose: str
    holds_metadata: bool
    for_robots: bool
    """A robot or a simulator plays such files, so an unsafe movement is never kept in one."""


FORMATS: dict[str, Format] = {
    "csv": Format((".csv",), table.write_csv, table.read_csv, "table, for `train` and `score`", False, False),
    "npz": Format((".npz",), write_npz, read_npz, "NumPy arrays, no pickle", True, False),
    "naoqi": Format((".py",), choregraphe.write_script, robot_program.read_python, "program for the robot", True, True),
    "json": Format((".json",), choregraphe.write_json, choregraphe.read_json, "the lists NAOqi takes", True, True),
    "ros": Format(
        (".yaml", ".yml", ".json"), simulators.write_ros, simulators.read_ros, "JointTrajectory", False, True
    ),
    "webots": Format((".motion",), simulators.write_motion, simulators.read_motion, "Webots motion", False, True),
    "bvh": Format((".bvh",), skeleton.write_bvh, skeleton.refuse_bvh, "skeleton, for Blender", False, False),
    "choregraphe": Format(
        (".xar", ".xap", ".qianim", ".anim"), None, choregraphe.read_timeline, "timeline or postures", False, True
    ),
}
"""Every format by name; `write` is None where a format is only read."""
WRITABLE = tuple(name for name, one in FORMATS.items() if one.write is not None)
MAX_FILE_BYTES = 16_000_000


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
    for name in WRITABLE:
        if ending in FORMATS[name].endings:
            return name
    known = ", ".join(f"{'/'.join(FORMATS[name].endings)} ({name})" for name in WRITABLE)
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
    if one.write is None:
        raise SettingsError(f"{name} is read, not written; there are {', '.join(WRITABLE)}.")
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
    if start.startswith(b"HIERARCHY"):
        return "bvh"
    if start.startswith(b"<"):
        return "choregraphe"
    if start.startswith(b"{"):
        return "ros" if b'"joint_names"' in content and b'"points"' in content else "json"
    ending = Path(path).suffix.lower()
    if ending not in (".json", ".npz") and any(ending in one.endings for one in FORMATS.values()):
        return next(name for name, one in FORMATS.items() if ending in one.endings)
    if b"time_s" in start.split(b"\n", 1)[0]:
        return "csv"
    if b"joint_names:" in start or (b"position:" in start and b"name:" in start):
        return "ros"
    if b".append(" in content or b"names =" in content or b"angleInterpolation" in content:
        return "naoqi"
    return format_for(path)


def read(
    path: str | os.PathLike[str],
    dt_s: float | None = None,
    joints: tuple[str, ...] | None = JOINTS,
    format: str | None = None,
    *,
    reading: Reading | None = None,
    beyond: Literal["refuse", "keep"] = "keep",
) -> Recording:
    """Read the one movement of a file of any format; its format is recognised by ending and content.

    Args:
        path: The file.
        dt_s: Wanted tick [s]; None: the file's own if its postures are evenly spaced, else 0.15 s.
        joints: Wanted joints, in this order, whatever the file's; None: all.
        format: One of `FORMATS`; None: recognised.
        reading: What the file does not say about itself, such as the posture that fills a recording of one arm.
        beyond: Whether angles more than 0.02 rad beyond a joint's range are refused or kept.

    Returns:
        The movement in radians, the format, and notes on what was recognised, filled, left out or changed.

    Raises:
        NotFoundError: If there is no such file or format.
        FileFormatError: If the file does not hold a movement, or holds several and `reading` does not say which; the
            message names the file, the part and the reason.
    """
    found = read_all(path, dt_s, joints, format, reading=reading, beyond=beyond)
    if len(found) > 1:
        places = ", ".join(f"{place} ({one.place})" for place, one in enumerate(found[:8], start=1))
        raise FileFormatError(
            f"{path}: holds {len(found)} movements: {places}; say which one with --movement 1 to {len(found)}."
        )
    return found[0]


def read_all(
    path: str | os.PathLike[str],
    dt_s: float | None = None,
    joints: tuple[str, ...] | None = JOINTS,
    format: str | None = None,
    *,
    reading: Reading | None = None,
    beyond: Literal["refuse", "keep"] = "keep",
) -> list[Recording]:
    """Read every movement of a file; arguments and errors as of `read`."""
    path = checked_path(path)
    if path.is_dir():
        raise NotFoundError(f"no movement at {path}: it is a folder.")
    content = storage.read_bytes(path, "movement", MAX_FILE_BYTES)
    return read_content(path, content, dt_s, joints, format, reading=reading, beyond=beyond)


def read_content(
    path: Path,
    content: bytes,
    dt_s: float | None = None,
    joints: tuple[str, ...] | None = JOINTS,
    format: str | None = None,
    *,
    reading: Reading | None = None,
    beyond: Literal["refuse", "keep"] = "keep",
) -> list[Recording]:
    """Read every movement of a file's content, without touching the file; `path` is for its ending and for messages."""
    said: Reading = NOTHING_SAID if reading is None else checked(Reading, reading, "reading")
    if not content.strip():
        raise FileFormatError(f"{path}: is empty, expected a movement.")
    name = recognise(path, content) if format is None else _known(format)
    for option, of in (("rate", ("csv", "choregraphe")), ("time_column", ("csv",))):
        if getattr(said, option) is not None and name not in of:
            flag = f"--{option.replace('_', '-')}"
            raise FileFormatError(f"{path}: {name} has times of its own, so {flag} is not for it; leave it out.")
    found = FORMATS[name].read(path, content, said)
    if len(found) > MAX_MOVEMENTS:
        raise FileFormatError(f"{path}: holds {len(found)} movements, expected at most {MAX_MOVEMENTS}.")
    if said.movement is not None:
        if said.movement > len(found):
            raise FileFormatError(f"{path}: has no movement {said.movement}, but {len(found)} of them.")
        found = [found[said.movement - 1]]
    recordings = []
    for keys in found:
        called = path if len(found) == 1 else Path(f"{path}, {keys.place}")
        motion, notes = to_motion(keys, called, dt_s, joints, said, beyond=beyond)
        recordings.append(Recording(motion, name, notes, keys.place))
    return recordings


def _known(name: str) -> str:
    if name not in FORMATS:
        raise NotFoundError(f"no format `{name}`{nearest_name(str(name), FORMATS)}; there are {', '.join(FORMATS)}.")
    return name
