"""ROS `trajectory_msgs/JointTrajectory` as JSON or YAML, for `ros2 topic pub` and trajectory controllers.

Written with ROS 2's field names (`sec`, `nanosec`); ROS 1's (`secs`, `nsecs`) are read too. Angles come back exactly,
times to the nanosecond.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao import atomic
from creative_nao.errors import FileFormatError
from creative_nao.exchange import reading, yaml_subset
from creative_nao.exchange.keys import Keys
from creative_nao.exchange.motion import Motion

_METADATA = "# metadata: "
_NANO = 1_000_000_000


def _message(motion: Motion) -> dict[str, Any]:
    start = round(motion.lead_s() * _NANO)
    tick = motion.dt_s * _NANO
    points = []
    for step, posture in enumerate(motion.angles):
        sec, nanosec = divmod(start + round(step * tick), _NANO)
        points.append({"positions": posture.tolist(), "time_from_start": {"sec": sec, "nanosec": nanosec}})
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    return {"header": header, "joint_names": list(motion.joints), "points": points}


def write_ros(motion: Motion, path: Path) -> list[str]:
    """Write the message, as YAML unless the file's name ends in .json; the first point leaves time to get there."""
    message = _message(motion)
    if path.suffix.lower() == ".json":
        head = f'{{"header": {json.dumps(message["header"])},\n"joint_names": {json.dumps(message["joint_names"])},\n'
        points = ",\n".join(json.dumps(point) for point in message["points"])
        atomic.write_text(path, f'{head}"points": [\n{points}\n]}}\n')
    else:
        # A comment, since a message with a field that its type does not have is refused by ROS.
        atomic.write_text(path, f"{_METADATA}{json.dumps(motion.metadata)}\n{yaml_subset.dump(message)}\n")
    return [f"the first posture is reached after {motion.lead_s():g} s"]


def read_ros(path: Path, content: bytes) -> Keys:
    """Read a message, also as the `trajectory` of a FollowJointTrajectory goal.

    Raises:
        FileFormatError: If a field is missing or of the wrong kind; the message names the point.
    """
    text = reading.as_text(path, content)
    is_json = text.lstrip()[:1] == "{"
    found = reading.as_json(path, text) if is_json else yaml_subset.load(path, text)
    if isinstance(found, dict) and isinstance(found.get("goal"), dict):
        found = found["goal"]
    if isinstance(found, dict) and isinstance(found.get("trajectory"), dict):
        found = found["trajectory"]
    if not isinstance(found, dict) or "joint_names" not in found or "points" not in found:
        raise FileFormatError(f"{path}: should hold `joint_names` and `points` of a JointTrajectory.")
    joints = reading.names(found["joint_names"], path, "`joint_names`")
    times, rows = [], []
    for place, point in enumerate(reading.listed(found["points"], path, "`points`")):
        where = f"point {place}"
        if not isinstance(point, dict):
            raise FileFormatError(f"{path}: {where} should be a mapping, but is {type(point).__name__}.")
        row = reading.listed(point.get("positions"), path, f"`positions` of {where}")
        if len(row) != len(joints):
            raise FileFormatError(
                f"{path}: {where} has {len(row)} positions, expected {len(joints)}, one for each joint."
            )
        rows.append([reading.number(angle, path, f"a position of {where}") for angle in row])
        times.append(_seconds(point.get("time_from_start"), path, where))
    angles = np.array(rows, dtype=np.float64).reshape(len(rows), len(joints))
    metadata = {} if is_json else _metadata(path, text)
    return Keys(joints, [np.array(times)] * len(joints), list(angles.T.copy()), metadata=metadata)


def _seconds(duration: object, path: Path, where: str) -> float:
    if not isinstance(duration, dict):
        return reading.number(duration, path, f"`time_from_start` of {where}")
    seconds = duration.get("sec", duration.get("secs", 0))
    nanoseconds = duration.get("nanosec", duration.get("nsecs", 0))
    whole = reading.number(seconds, path, f"`sec` of {where}")
    return whole + reading.number(nanoseconds, path, f"`nanosec` of {where}") / _NANO


def _metadata(path: Path, text: str) -> dict[str, Any]:
    first = text.split("\n", 1)[0]
    if not first.startswith(_METADATA):
        return {}
    return reading.as_json(path, first[len(_METADATA) :])
