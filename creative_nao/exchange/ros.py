"""ROS `trajectory_msgs/JointTrajectory` as JSON or YAML, for `ros2 topic pub` and trajectory controllers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao import storage
from creative_nao.errors import FileFormatError
from creative_nao.exchange.keys import Keys, Motion, joint_names, json_object, listed, number, text_of

_METADATA = "# metadata: "
_NANO = 1_000_000_000


def write_ros(motion: Motion, path: Path) -> list[str]:
    """Write the message, as YAML unless the file's name ends in .json; the first point leaves time to get there."""
    message = _message(motion)
    if path.suffix.lower() == ".json":
        head = f'{{"header": {json.dumps(message["header"])},\n"joint_names": {json.dumps(message["joint_names"])},\n'
        points = ",\n".join(json.dumps(point) for point in message["points"])
        storage.write_text(path, f'{head}"points": [\n{points}\n]}}\n')
    else:
        # A comment, since a message with a field that its type does not have is refused by ROS.
        storage.write_text(path, f"{_METADATA}{json.dumps(motion.metadata)}\n{_yaml(message)}\n")
    return [f"the first posture is reached after {motion.lead_s():g} s"]


def _message(motion: Motion) -> dict[str, Any]:
    start = round(motion.lead_s() * _NANO)
    tick = motion.dt_s * _NANO
    points = []
    for step, posture in enumerate(motion.angles):
        sec, nanosec = divmod(start + round(step * tick), _NANO)
        points.append({"positions": posture.tolist(), "time_from_start": {"sec": sec, "nanosec": nanosec}})
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    return {"header": header, "joint_names": list(motion.joints), "points": points}


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
    """Read a message, also as the `trajectory` of a FollowJointTrajectory goal.

    Raises:
        FileFormatError: If a field is missing or of the wrong kind; the message names the point.
    """
    text = text_of(path, content)
    is_json = text.lstrip()[:1] == "{"
    # `ros2 topic echo` ends each message with the mark of the next document.
    found = json_object(path, text) if is_json else storage.as_yaml(text.rstrip().removesuffix("\n---"), str(path))
    for outer in ("goal", "trajectory"):
        if isinstance(found, dict) and isinstance(found.get(outer), dict):
            found = found[outer]
    if not isinstance(found, dict) or "joint_names" not in found or "points" not in found:
        raise FileFormatError(f"{path}: should hold `joint_names` and `points` of a JointTrajectory.")
    joints = joint_names(found["joint_names"], f"{path}: `joint_names`")
    times, rows = [], []
    for place, point in enumerate(listed(found["points"], f"{path}: `points`")):
        if not isinstance(point, dict):
            raise FileFormatError(f"{path}: point {place} should be a mapping, but is {type(point).__name__}.")
        row = listed(point.get("positions"), f"{path}: `positions` of point {place}")
        if len(row) != len(joints):
            raise FileFormatError(
                f"{path}: point {place} has {len(row)} positions, expected {len(joints)}, one for each joint."
            )
        rows.append([number(angle, f"{path}: a position of point {place}") for angle in row])
        times.append(_seconds(point.get("time_from_start"), path, place))
    angles = np.array(rows, dtype=np.float64).reshape(len(rows), len(joints))
    first = text.split("\n", 1)[0]
    metadata = json_object(path, first[len(_METADATA) :]) if first.startswith(_METADATA) else {}
    return Keys(joints, [np.array(times)] * len(joints), list(angles.T.copy()), metadata=metadata)


def _seconds(duration: object, path: Path, place: int) -> float:
    if not isinstance(duration, dict):
        return number(duration, f"{path}: `time_from_start` of point {place}")
    seconds = number(duration.get("sec", duration.get("secs", 0)), f"{path}: `sec` of point {place}")
    nanoseconds = duration.get("nanosec", duration.get("nsecs", 0))
    return seconds + number(nanoseconds, f"{path}: `nanosec` of point {place}") / _NANO
