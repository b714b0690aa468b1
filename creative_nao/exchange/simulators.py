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
from creative_nao.errors import FileFormatError, SettingsError
from creative_nao.exchange.keys import LARGEST_TIME_S, NOTHING_SAID, JointNames, Keys, Reading, text_of
from creative_nao.exchange.motion import Motion
from creative_nao.exchange.table import cell_number
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


def read_motion(path: Path, content: bytes, reading: Reading = NOTHING_SAID) -> list[Keys]:
    """Read a `.motion` file; an asterisk leaves a joint without a key at that time. Errors name the line."""
    lines = [line.strip() for line in text_of(path, content).splitlines()] or [""]
    header = [cell.strip() for cell in lines[0].split(",")]
    if header[0] != MARK or len(header) < 3:
        raise FileFormatError(f"{path}: line 1 should be {MARK},{_VERSION},JOINT,..., but is {lines[0][:80]}.")
    joints = tuple(header[2:])
    times, angles = [[[] for _ in joints] for _ in range(2)]
    numbers: list[list[int]] = [[] for _ in joints]
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
                numbers[column].append(place)
                try:
                    angles[column].append(cell_number(cell))
                except ValueError:
                    told = f"{joints[column]} is {cell[:40]!r}, expected an angle or `*`."
                    raise FileFormatError(f"{path}: line {place}: {told}") from None
    notes = [] if header[1] == _VERSION else [f"version {header[1][:20]!r} was read as {_VERSION}"]
    return [
        Keys(
            joints, [np.array(t) for t in times], [np.array(a) for a in angles], time_step_s=0.001, notes=notes,
            lines=list(numbers), seconds_known=True,
        )
    ]  # fmt: skip


_METADATA = "# metadata: "
_NANO = 1_000_000_000
MAX_MESSAGES = 10_000
_DOCUMENT = re.compile(r"^---[ \t]*\r?$", re.MULTILINE)


def write_ros(motion: Motion, path: Path) -> list[str]:
    """Write the message, as YAML unless the file's name ends in .json; the first point leaves time to get there."""
    import yaml

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
        dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)  # the compiled one where PyYAML has it
        text = yaml.dump(message, Dumper=dumper, default_flow_style=None, sort_keys=False, width=10**9)
        storage.write_text(path, f"{_METADATA}{json.dumps(motion.metadata)}\n{text}")
    return [f"the first posture is reached after {motion.lead_s():g} s"]


_OUTER = ("goal", "trajectory", "joint_trajectory", "planned_trajectory", "trajectory_start", "msg", "message")


def read_ros(path: Path, content: bytes, reading: Reading = NOTHING_SAID) -> list[Keys]:
    """Read messages: a `JointTrajectory`, alone or within MoveIt's messages and goals, or `JointState`s one by one.

    Errors name the point or the message.
    """
    text = text_of(path, content)
    if text.lstrip()[:1] == "{":
        messages = [parse(JsonObject, text, str(path))]
    else:  # `ros2 topic echo` ends each message with the mark of the next document
        parts = [part for part in _DOCUMENT.split(text) if part.strip()]
        if len(parts) > MAX_MESSAGES:
            raise FileFormatError(f"{path}: holds {len(parts)} messages, expected at most {MAX_MESSAGES}.")
        messages = [storage.as_yaml(part, _part(path, place, len(parts))) for place, part in enumerate(parts)]
        messages = [message for message in messages if message is not None]
    if messages and all(isinstance(one, dict) and "name" in one and "position" in one for one in messages):
        return [_joint_states(path, messages)]
    found = [keys for place, message in enumerate(messages) for keys in _trajectories(path, message, place)]
    if not found:
        raise FileFormatError(f"{path}: should hold `joint_names` and `points` of a JointTrajectory.")
    first = text.split("\n", 1)[0]
    if first.startswith(_METADATA):
        found[0].metadata = parse(JsonObject, first[len(_METADATA) :], str(path))
    for place, keys in enumerate(found, start=1):
        keys.place = f"message {place}"
    return found


def _part(path: Path, place: int, n_parts: int) -> str:
    return str(path) if n_parts == 1 else f"{path}: message {place + 1}"


def _trajectories(path: Path, message: Any, place: int) -> list[Keys]:
    """Return every JointTrajectory in a message, from whatever it is wrapped in."""
    left_out: list[str] = []
    for _ in range(len(_OUTER)):
        outer = next((name for name in _OUTER if isinstance(message, dict) and name in message), None)
        if not isinstance(message, dict) or outer is None or "points" in message:
            break
        left_out += _others(message, outer)
        message = message[outer]
        if isinstance(message, list):
            return [keys for one in message for keys in _trajectories(path, one, place)]
    if not isinstance(message, dict) or "joint_names" not in message or "points" not in message:
        raise FileFormatError(f"{path}: should hold `joint_names` and `points` of a JointTrajectory.")
    keys = _trajectory(path, message)
    left_out += [name for name in message if name not in ("header", "joint_names", "points")]
    if left_out:
        keys.notes.append(f"left out: {', '.join(f'`{name}`' for name in dict.fromkeys(left_out))[:300]}")
    return [keys]


def _others(message: dict[str, Any], taken: str) -> list[str]:
    """Return what else a message holds that moves a robot."""
    quiet = ("header", "stamp", "goal_id", "group_name", "model_id", "start_state", "trajectory_start", taken)
    empty = ({}, [], None, "", 0, 0.0)
    other = {name: value for name, value in message.items() if name not in quiet and value not in empty}
    points = other.get("multi_dof_joint_trajectory")
    if isinstance(points, dict) and not points.get("points"):
        del other["multi_dof_joint_trajectory"]
    return list(other)


def _trajectory(path: Path, found: dict[str, Any]) -> Keys:
    joints = parse(JointNames, found["joint_names"], f"{path}: `joint_names`")
    times, rows, known, left_out = [], [], True, set[str]()
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
        left_out |= {name for name in point if name not in ("positions", "time_from_start") and point[name]}
        duration = point.get("time_from_start")
        known = known and isinstance(duration, dict)
        times.append(_stamp(duration, path, f"`time_from_start` {of}", of))
    angles = np.array(rows, dtype=np.float64).reshape(len(rows), len(joints))
    notes = [f"left out of each point: {', '.join(sorted(left_out))[:200]}"] if left_out else []
    return Keys(
        joints, [np.array(times)] * len(joints), list(angles.T.copy()), notes=notes, seconds_known=known
    )  # fmt: skip


def _stamp(value: Any, path: Path, called: str, of: str) -> float:
    """Return a time of ROS in seconds: a number, or seconds and nanoseconds under the names of ROS 1 or 2."""
    if not isinstance(value, dict):
        return parse(float, value, f"{path}: {called}")
    seconds = parse(float, value.get("sec", value.get("secs", 0)), f"{path}: `sec` {of}")
    nanoseconds = value.get("nanosec", value.get("nsecs", 0))
    return seconds + parse(float, nanoseconds, f"{path}: `nanosec` {of}") / _NANO


def _nanoseconds(stamp: Any, path: Path, of: str) -> int:
    """Return a stamp in whole nanoseconds: as a number of seconds since 1970 it would not have the digits."""
    parts = stamp if isinstance(stamp, dict) else {"sec": stamp}
    seconds = parse(float, parts.get("sec", parts.get("secs", 0)), f"{path}: `sec` {of}")
    nanoseconds = parse(float, parts.get("nanosec", parts.get("nsecs", 0)), f"{path}: `nanosec` {of}")
    if max(abs(seconds), abs(nanoseconds)) > LARGEST_TIME_S:
        raise FileFormatError(f"{path}: the stamp {of} is {max(seconds, nanoseconds):g}, beyond {LARGEST_TIME_S:g}.")
    return int(seconds) * _NANO + round((seconds - int(seconds)) * _NANO) + round(nanoseconds)


def _joint_states(path: Path, messages: list[dict[str, Any]]) -> Keys:
    """Read `JointState` messages as the postures of one movement; the first is at time 0."""
    joints: tuple[str, ...] = ()
    times, rows = [], []
    for place, message in enumerate(messages, start=1):
        of = f"of message {place}"
        names = parse(JointNames, message["name"], f"{path}: `name` {of}")
        row = parse(list[float], message["position"], f"{path}: `position` {of}")
        joints = joints or names
        if len(row) != len(names) or sorted(names) != sorted(joints):
            raise FileFormatError(
                f"{path}: message {place} has {len(row)} positions of {len(names)} joints, expected one for each of "
                f"{', '.join(joints)[:200]}."
            )
        rows.append(row if names == joints else [row[names.index(joint)] for joint in joints])
        header = message.get("header")
        stamp = header.get("stamp") if isinstance(header, dict) else None
        if stamp is None:
            raise FileFormatError(f"{path}: message {place} has no `stamp` in its header, so when it was is unknown.")
        times.append(_nanoseconds(stamp, path, of))
    when = np.array([(time - times[0]) / _NANO for time in times])
    angles = np.array(rows, dtype=np.float64).reshape(len(rows), len(joints))
    notes = ["read as JointState messages; the first one is at 0 s"]
    return Keys(joints, [when] * len(joints), list(angles.T.copy()), notes=notes, seconds_known=True)
