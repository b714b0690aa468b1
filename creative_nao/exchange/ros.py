"""The part of YAML that a ROS message needs: nested mappings, lists, numbers, short texts. Nothing can be executed.

Anchors, tags, several documents and texts over several lines are refused, not guessed at.

Also here:
- ROS `trajectory_msgs/JointTrajectory` as JSON or YAML, for `ros2 topic pub` and trajectory controllers.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao import storage
from creative_nao.errors import FileFormatError
from creative_nao.exchange import keys as reading
from creative_nao.exchange.keys import Keys, Motion

_MAX_DEPTH = 12
_KEY = re.compile(r"""(?P<key>[A-Za-z_][\w/.-]*|"[^"\\]*"|'[^']*')\s*:(?:\s+(?P<rest>.*))?$""", re.ASCII)
_FLOW_KEY = re.compile(r"""([A-Za-z_]\w*|"[^"\\]*"|'[^']*')\s*:\s*""", re.ASCII)
_WORD = re.compile(r"""("[^"\\]*"|'[^']*'|[^,\[\]{}"']*)""")
_BLANKS = re.compile(r"\s*")
_NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_WORDS = {"true": True, "false": False, "null": None, "~": None, "": None}
_REFUSED = ("&", "*", "!", "|", ">", "%", "@", "`", "?")


def dump(value: object, indent: int = 0) -> str:
    """Return a mapping as YAML text; lists of numbers and small mappings stand on one line (their JSON is YAML)."""
    lines = []
    space = " " * indent
    assert isinstance(value, dict)
    for key, item in value.items():
        if isinstance(item, dict) and any(isinstance(part, dict | list) for part in item.values()):
            lines.append(f"{space}{key}:\n{dump(item, indent + 2)}")
        elif isinstance(item, list) and item and isinstance(item[0], dict):
            entries = [dump(part, indent + 2) for part in item]
            lines += [f"{space}{key}:"] + [f"{space}- {entry[indent + 2 :]}" for entry in entries]
        else:
            lines.append(f"{space}{key}: {json.dumps(item, allow_nan=False)}")
    return "\n".join(lines)


def load(path: Path, text: str) -> Any:
    """Read YAML text of that part.

    Raises:
        FileFormatError: If it is torn or uses more of YAML; the message names the line.
    """
    return _Reader(path, text).whole()


class _Reader:
    """Reads lines of a block by their indentation, and what stands on one line by characters."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.lines: list[tuple[int, int, str]] = []
        for number, raw in enumerate(text.splitlines(), start=1):
            if raw.strip() in ("---", "...") and not self.lines:
                continue
            line = _without_comment(raw)
            if not line.strip():
                continue
            if "\t" in line[: len(line) - len(line.lstrip())]:
                raise FileFormatError(f"{path}: line {number}: tabs cannot indent YAML.")
            self.lines.append((number, len(line) - len(line.lstrip()), line.strip()))
        self.next = 0

    def whole(self) -> Any:
        if not self.lines:
            raise FileFormatError(f"{self.path}: is empty, expected YAML.")
        found = self.block(self.lines[0][1], 0)
        if self.next < len(self.lines):
            if self.lines[self.next][2] in ("---", "..."):
                self.lines = self.lines[: self.next + 1]
                if self.next == len(self.lines) - 1:
                    return found
            self.fail("does not belong to what stands above it (indentation?)")
        return found

    def fail(self, reason: str) -> Any:
        number, _, line = self.lines[min(self.next, len(self.lines) - 1)]
        raise FileFormatError(f"{self.path}: line {number}: {line[:60]!r} {reason}.")

    def block(self, indent: int, depth: int) -> Any:
        if depth > _MAX_DEPTH:
            self.fail(f"is nested more than {_MAX_DEPTH} deep")
        line = self.lines[self.next][2]
        if line == "-" or line.startswith("- "):
            return self.entries(indent, depth)
        return self.mapping(indent, depth)

    def entries(self, indent: int, depth: int) -> list[Any]:
        found = []
        while self.next < len(self.lines) and self.lines[self.next][1] == indent:
            number, _, line = self.lines[self.next]
            if not (line == "-" or line.startswith("- ")):
                break
            rest = line[1:].strip()
            if not rest:
                self.next += 1
                found.append(self.nested(indent, depth))
            elif _KEY.match(rest) and rest[0] not in "[{":
                inner = indent + len(line) - len(line[1:].lstrip())
                self.lines[self.next] = (number, inner, rest)
                found.append(self.mapping(inner, depth + 1))
            else:
                found.append(self.scalar(rest))
                self.next += 1
        return found

    def mapping(self, indent: int, depth: int) -> dict[str, Any]:
        found: dict[str, Any] = {}
        while self.next < len(self.lines) and self.lines[self.next][1] == indent:
            line = self.lines[self.next][2]
            if line == "-" or line.startswith("- ") or line in ("---", "..."):
                break
            match = _KEY.match(line)
            if not match:
                self.fail("is not `key: value`")
                break
            key, rest = match["key"].strip("\"'"), (match["rest"] or "").strip()
            if key in found:
                self.fail("stands there twice")
            if rest:
                found[key] = self.scalar(rest)
                self.next += 1
            else:
                self.next += 1
                found[key] = self.nested(indent, depth, below=True)
        return found

    def nested(self, indent: int, depth: int, *, below: bool = False) -> Any:
        """Read what is indented under a key or a dash; a list may stand as far left as its key."""
        if self.next >= len(self.lines):
            return None
        _, inner, line = self.lines[self.next]
        is_list = line == "-" or line.startswith("- ")
        if inner > indent or (below and inner == indent and is_list):
            return self.block(inner, depth + 1)
        return None

    def scalar(self, text: str) -> Any:
        if text[0] in "[{":
            value, end = self.flow(text, 0, 0)
            return value if end == len(text) else self.fail("has something after its closing bracket")
        if text[0] in _REFUSED:
            return self.fail(f"uses `{text[0]}`, a part of YAML that is not read here")
        return _plain(text)

    def flow(self, text: str, at: int, depth: int) -> tuple[Any, int]:
        """Read `[...]`, `{...}` or a word at a place in `text`; return it and the place of what follows.

        The text is never cut: a line may have 20 million characters, and a copy for each word would take days.
        """
        if depth > _MAX_DEPTH:
            self.fail(f"is nested more than {_MAX_DEPTH} deep")
        if text[at : at + 1] == "[":
            return self.flow_list(text, _skip(text, at + 1), depth)
        if text[at : at + 1] == "{":
            return self.flow_mapping(text, _skip(text, at + 1), depth)
        match = _WORD.match(text, at)
        word = match[0] if match else ""
        if word[:1] in _REFUSED:
            self.fail(f"uses `{word[0]}`, a part of YAML that is not read here")
        return _plain(word.strip()), _skip(text, at + len(word))

    def flow_list(self, text: str, at: int, depth: int) -> tuple[list[Any], int]:
        found = []
        while text[at : at + 1] != "]":
            value, at = self.flow(text, at, depth + 1)
            found.append(value)
            if text[at : at + 1] == ",":
                at = _skip(text, at + 1)
            elif text[at : at + 1] != "]":
                self.fail("has a list that is not closed on its line")
        return found, _skip(text, at + 1)

    def flow_mapping(self, text: str, at: int, depth: int) -> tuple[dict[str, Any], int]:
        found: dict[str, Any] = {}
        while text[at : at + 1] != "}":
            match = _FLOW_KEY.match(text, at)
            if not match:
                self.fail("has a mapping that cannot be read")
                break
            key = match[1].strip("\"'")
            if key in found:
                self.fail(f"says `{key[:40]}` twice")
            found[key], at = self.flow(text, match.end(), depth + 1)
            if text[at : at + 1] == ",":
                at = _skip(text, at + 1)
            elif text[at : at + 1] != "}":
                self.fail("has a mapping that is not closed on its line")
        return found, _skip(text, at + 1)


def _skip(text: str, at: int) -> int:
    """Return the place of the next character that is no blank."""
    match = _BLANKS.match(text, at)
    return match.end() if match else at


def _without_comment(line: str) -> str:
    if "#" not in line:
        return line.rstrip()
    quote = ""
    for place, mark in enumerate(line):
        if quote:
            quote = "" if mark == quote else quote
        elif mark in "\"'":
            quote = mark
        elif mark == "#" and (place == 0 or line[place - 1] in " \t"):
            return line[:place].rstrip()
    return line.rstrip()


def _plain(word: str) -> Any:
    """Return a number, a truth value, nothing, or the text itself."""
    if word[:1] in ("'", '"'):
        return word[1:-1]
    if _NUMBER.fullmatch(word):
        return int(word) if re.fullmatch(r"[-+]?\d{1,18}", word, re.ASCII) else float(word)
    return _WORDS.get(word.lower(), word)


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
        storage.write_text(path, f'{head}"points": [\n{points}\n]}}\n')
    else:
        # A comment, since a message with a field that its type does not have is refused by ROS.
        storage.write_text(path, f"{_METADATA}{json.dumps(motion.metadata)}\n{dump(message)}\n")
    return [f"the first posture is reached after {motion.lead_s():g} s"]


def read_ros(path: Path, content: bytes) -> Keys:
    """Read a message, also as the `trajectory` of a FollowJointTrajectory goal.

    Raises:
        FileFormatError: If a field is missing or of the wrong kind; the message names the point.
    """
    text = reading.as_text(path, content)
    is_json = text.lstrip()[:1] == "{"
    found = reading.as_json(path, text) if is_json else load(path, text)
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
