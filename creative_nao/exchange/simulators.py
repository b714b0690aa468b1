"""Movements for simulators: Webots `.motion` files and ROS `trajectory_msgs/JointTrajectory`, for `ros2 topic pub`.

A Webots file has a header with the joint names, then one posture a line, with its time as minutes:seconds:milliseconds.
A ROS message is JSON or YAML, as trajectory controllers take it. Every bit of every angle comes back.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao import storage
from creative_nao.demonstrations import files
from creative_nao.errors import FileFormatError, SettingsError
from creative_nao.exchange.keys import JointNames, Keys, Motion, text_of
from creative_nao.schema import JsonObject, parse

MARK = "#WEBOTS_MOTION"
"""First cell of a Webots file."""
_VERSION = "V1.0"
_TIME = re.compile(r"(\d{1,4}):(\d{1,2}):(\d{1,3})", re.ASCII)
_LARGEST_S = 100 * 60


def write_motion(motion: Motion, path: Path) -> list[str]:
    """Write a `.motion` file with ticks of 1 ms or more, shorter than 100 minutes; its first posture is at time 0."""
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
    """Read a `.motion` file; an asterisk leaves a joint without a key at that time. Errors name the line."""
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
            if cell != "*":
                times[column].append(time)
                try:
                    angles[column].append(files.cell_number(cell))
                except ValueError:
                    told = f"{joints[column]} is {cell[:40]!r}, expected an angle or `*`."
                    raise FileFormatError(f"{path}: line {place}: {told}") from None
    notes = [] if header[1] == _VERSION else [f"version {header[1][:20]!r} was read as {_VERSION}"]
    return Keys(joints, [np.array(t) for t in times], [np.array(a) for a in angles], time_step_s=0.001, notes=notes)


_METADATA = "# metadata: "
_NANO = 1_000_000_000


def write_ros(motion: Motion, path: Path) -> list[str]:
    """Write the message, as YAML unless the file's name ends in .json; the first point leaves time to get there."""
    start, tick = round(motion.lead_s() * _NANO), motion.dt_s * _NANO
    points = []
    for step, posture in enumerate(motion.angles):
        sec, nanosec = divmod(start + round(step * tick), _NANO)
        points.append({"positions": posture.tolist(), "time_from_start": {"sec": sec, "nanosec": nanosec}})
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    message = {"header": header, "joint_names": list(motion.joints), "points": points}
    if path.suffix.lower() == ".json":
        head = f'{{"header": {json.dumps(header)},\n"joint_names": {json.dumps(message["joint_names"])},\n'
        rows = ",\n".join(json.dumps(point) for point in points)
        storage.write_text(path, f'{head}"points": [\n{rows}\n]}}\n')
    else:
        # A comment, since a message with a field that its type does not have is refused by ROS.
        storage.write_text(path, f"{_METADATA}{json.dumps(motion.metadata)}\n{_yaml(message)}\n")
    return [f"the first posture is reached after {motion.lead_s():g} s"]


def _yaml(value: dict[str, Any], indent: int = 0) -> str:
    """Return a mapping as YAML; lists of numbers and small mappings stand on one line (their JSON is YAML)."""
    lines = []
    space = " " * indent
    for key, item in value.items():
        if isinstance(item, dict) and any(isinstance(part, dict | list) for part in item.values()):
            lines.append(f"{space}{key}:\n{_yaml(item, indent + 2)}")
        elif isinstance(item, list) and item and isinstance(item[0], dict):
            entries = [_yaml(part, indent + 2) for part in item]
            lines += [f"{space}{key}:"] + [f"{space}- {entry[indent + 2 :]}" for entry in entries]
        else:
            lines.append(f"{space}{key}: {json.dumps(item, allow_nan=False)}")
    return "\n".join(lines)


def read_ros(path: Path, content: bytes) -> Keys:
    """Read a message, also as the `trajectory` of a FollowJointTrajectory goal. Errors name the point."""
    text = text_of(path, content)
    if text.lstrip()[:1] == "{":
        found = parse(JsonObject, text, str(path))
    else:  # `ros2 topic echo` ends each message with the mark of the next document
        found = storage.as_yaml(text.rstrip().removesuffix("\n---"), str(path))
    for outer in ("goal", "trajectory"):
        if isinstance(found, dict) and isinstance(found.get(outer), dict):
            found = found[outer]
    if not isinstance(found, dict) or "joint_names" not in found or "points" not in found:
        raise FileFormatError(f"{path}: should hold `joint_names` and `points` of a JointTrajectory.")
    joints = parse(JointNames, found["joint_names"], f"{path}: `joint_names`")
    times, rows = [], []
    for place, point in enumerate(parse(list[Any], found["points"], f"{path}: `points`")):
        of = f"of point {place}"
        if not isinstance(point, dict):
            raise FileFormatError(f"{path}: point {place} should be a mapping, but is {type(point).__name__}.")
        row = parse(list[float], point.get("positions"), f"{path}: `positions` {of}")
        if len(row) != len(joints):
            raise FileFormatError(
                f"{path}: point {place} has {len(row)} positions, expected {len(joints)}, one for each joint."
            )
        rows.append(row)
        duration = point.get("time_from_start")
        if not isinstance(duration, dict):
            times.append(parse(float, duration, f"{path}: `time_from_start` {of}"))
            continue
        seconds = parse(float, duration.get("sec", duration.get("secs", 0)), f"{path}: `sec` {of}")
        nanoseconds = duration.get("nanosec", duration.get("nsecs", 0))
        times.append(seconds + parse(float, nanoseconds, f"{path}: `nanosec` {of}") / _NANO)
    angles = np.array(rows, dtype=np.float64).reshape(len(rows), len(joints))
    first = text.split("\n", 1)[0]
    metadata = parse(JsonObject, first[len(_METADATA) :], str(path)) if first.startswith(_METADATA) else {}
    return Keys(joints, [np.array(times)] * len(joints), list(angles.T.copy()), metadata=metadata)
