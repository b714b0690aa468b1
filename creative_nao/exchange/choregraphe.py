"""Choregraphe and NAOqi: names, times and angles as parallel lists, as JSON and as a program; timelines and postures.

The JSON object maps one to one onto `ALMotion.angleInterpolation(names, angles, times, isAbsolute)`. A program that is
written runs on the robot: plain Python 2.7 or 3, no package needed but the robot's own; `robot_program.py` reads such
programs. Every bit of every angle comes back, times to the nanosecond.
"""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from creative_nao import storage
from creative_nao.errors import FileFormatError
from creative_nao.exchange.keys import (
    CHAINS,
    NOTHING_SAID,
    TIME_UNITS_S,
    JointNames,
    Keys,
    Reading,
    text_of,
    whole_chains,
)
from creative_nao.exchange.motion import APPROACH_SPEED_RAD_S, Motion, resample
from creative_nao.exchange.table import cell_number
from creative_nao.joints import JOINTS
from creative_nao.schema import JsonObject, parse

FORMAT_NAME = "creative-nao key lists"
_UNITS = {"rad": "radians", "radian": "radians", "radians": "radians"}
_UNITS |= {"deg": "degrees", "degree": "degrees", "degrees": "degrees"}
_ABSOLUTE = {"isabsolute": True, "absolute": True, "relative": False, "isrelative": False}


def write_json(motion: Motion, path: Path) -> list[str]:
    """Write names, times [s], angles [rad], isAbsolute and metadata; the first key leaves time to get there."""
    lead = motion.lead_s()
    times = motion.times_s(lead)
    found = {
        "format": FORMAT_NAME,
        "unit": "radians",
        "dt_s": motion.dt_s,
        "isAbsolute": True,
        "names": list(motion.joints),
        "times": [times] * len(motion.joints),
        "angles": motion.angles.T.tolist(),
        "metadata": motion.metadata,
    }
    lines = [f"  {json.dumps(name)}: {_rows(value)}" for name, value in found.items()]
    storage.write_text(path, "{\n" + ",\n".join(lines) + "\n}\n")
    return [f"the first posture is reached after {lead:g} s"]


def _rows(value: Any) -> str:
    """One joint a line: readable, and short enough to compare by eye."""
    if isinstance(value, list) and value and isinstance(value[0], list):
        return "[\n    " + ",\n    ".join(json.dumps(row) for row in value) + "\n  ]"
    return json.dumps(value, allow_nan=False)


_KNOWN_KEYS = {"format", "unit", "dt_s", "isAbsolute", "names", "times", "angles", "keys", "metadata", "time_unit"}


def read_json(path: Path, content: bytes, reading: Reading = NOTHING_SAID) -> list[Keys]:
    """Read an object with `names`, `times` and absolute `angles` (or `keys`); times may be one list for all joints."""
    found = parse(JsonObject, text_of(path, content), str(path))
    angles = found.get("angles", found.get("keys"))
    if angles is None or "names" not in found or "times" not in found:
        raise FileFormatError(
            f"{path}: should hold `names`, `times` and `angles`, "
            f"but holds {', '.join(map(str, found))[:200] or 'nothing'}."
        )
    if "angles" in found and "keys" in found:
        raise FileFormatError(f"{path}: holds both `angles` and `keys`, expected one of them.")
    for name, value in found.items():
        bare = name.lower().replace("_", "")
        if bare in _ABSOLUTE and value is not _ABSOLUTE[bare]:
            raise FileFormatError(f"{path}: angles are relative (`{name}` is {value!r:.20}); expected absolute ones.")
    unit = found.get("unit")
    if unit is not None and str(unit).lower() not in _UNITS:
        raise FileFormatError(f"{path}: `unit` is {str(unit)[:40]!r}, expected radians or degrees.")
    scale = found.get("time_unit")
    if scale is not None and scale not in TIME_UNITS_S:
        raise FileFormatError(f"{path}: `time_unit` is {str(scale)[:40]!r}, expected {', '.join(TIME_UNITS_S)}.")
    keys = keys_of(path, found["names"], found["times"], angles)
    if scale is not None:
        keys.times = [times * TIME_UNITS_S[scale] for times in keys.times]
        keys.seconds_known = True
        keys.notes += [f"times read in {scale}"] if scale != "s" else []
    keys.unit = None if unit is None else _UNITS[str(unit).lower()]
    others = [name for name in found if name not in _KNOWN_KEYS and name.lower().replace("_", "") not in _ABSOLUTE]
    if others:
        keys.notes.append(f"left out: {', '.join(f'`{name[:40]}`' for name in others)[:300]}")
    metadata = found.get("metadata", {})
    keys.metadata = metadata if isinstance(metadata, dict) else {}
    return [keys]


def keys_of(path: Path, names: object, times: object, angles: object) -> Keys:
    """Turn three parallel lists of equal length into keys: angles, or angles with their two Bezier handles.

    A name alone stands for a list of one, and its angles and times may be lists of numbers; `LArm` and the like stand
    for the joints of a chain.
    """
    if isinstance(names, str):
        if names not in CHAINS:
            times, angles = ([_listed(one)] if not _nested(one) else one for one in (times, angles))
        names = [names]
    told = parse(JointNames, names, f"{path}: `names`")
    when, where = parse(list[Any], times, f"{path}: `times`"), parse(list[Any], angles, f"{path}: `angles`")
    joints = whole_chains(path, told, len(where))
    if when and not any(isinstance(row, list | tuple) for row in when):
        when = [when] * len(joints)
    if len(when) != len(joints) or len(where) != len(joints):
        raise FileFormatError(
            f"{path}: {len(joints)} names, {len(when)} lists of times and {len(where)} lists of angles, "
            "expected as many of each."
        )
    bent = False
    all_times, all_angles = [], []
    for joint, row_times, row_angles in zip(joints, when, where, strict=True):
        of = f"of {joint[:40]}"
        row = parse(list[Any], row_angles, f"{path}: `angles` {of}")
        bent = bent or any(isinstance(key, list | tuple) for key in row)
        points = [key[0] if isinstance(key, list | tuple) and len(key) == 3 else key for key in row]
        all_angles.append(np.array(parse(list[float], points, f"{path}: `angles` {of}"), dtype=np.float64))
        all_times.append(np.array(parse(list[float], row_times, f"{path}: `times` {of}"), dtype=np.float64))
    notes = ["Bezier handles were left out; between keys a monotone cubic is taken"] if bent else []
    if joints != told:
        notes.append(f"{' and '.join(name for name in told if name in CHAINS)} read as {', '.join(joints)}")
    return Keys(joints, all_times, all_angles, notes=notes)


def _listed(value: object) -> object:
    return value if isinstance(value, list | tuple) else [value]


def _nested(value: object) -> bool:
    """Whether a value is a list of lists of keys, not the keys of one joint, which may have handles."""
    rows = value if isinstance(value, list | tuple) else ()
    return (
        bool(rows)
        and all(isinstance(row, list | tuple) for row in rows)
        and not (all(len(row) == 3 and isinstance(row[1], list | tuple) for row in rows))
    )


_SHORTEST_S = 0.02  # the robot's motion process takes a new target every 20 ms; more keys would be lost


def write_script(motion: Motion, path: Path) -> list[str]:
    """Write the program; finer ticks than 20 ms are brought to 20 ms first."""
    notes = []
    if motion.dt_s < _SHORTEST_S * (1.0 - 1e-9):
        notes.append(f"keys every {motion.dt_s:g} s brought to {_SHORTEST_S:g} s, {1 / _SHORTEST_S:.0f} a second")
        times = np.arange(len(motion.angles)) * motion.dt_s
        fine = resample(times, motion.angles, _SHORTEST_S) if len(times) > 1 else motion.angles
        motion = dataclasses.replace(motion, angles=fine, dt_s=_SHORTEST_S)
    environment = jinja2.Environment(  # noqa: S701 - a program, no page: every value is a Python literal
        loader=jinja2.PackageLoader("creative_nao.exchange"),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
    )
    text = environment.get_template("naoqi_program.py.jinja").render(
        file="".join(c if c.isascii() and (c.isalnum() or c in "._-") else "_" for c in path.name),
        approach=APPROACH_SPEED_RAD_S,
        names=[ascii(joint) for joint in motion.joints],
        times=[repr(motion.times_s(motion.lead_s()))] * len(motion.joints),
        keys=[repr(column.tolist()) for column in motion.angles.T],
        metadata=ascii(json.dumps(motion.metadata)),
    )
    storage.write_text(path, text)
    path.chmod(path.stat().st_mode | 0o111)
    return [*notes, f"the first posture is reached after {motion.lead_s():g} s"]


MAX_XML_BYTES, MAX_ELEMENTS = 8_000_000, 250_000
MAX_DEPTH = 100  # elements within each other; boxes of boxes have some ten
_CURVE_UNITS = {"0": "degrees", "degree": "degrees", "degrees": "degrees", "deg": "degrees"}
_CURVE_UNITS |= {"radian": "radians", "radians": "radians", "rad": "radians"}
_PLAIN = {"1", "dimensionless"}  # of a hand
_OFF = {"0", "false"}


class _Xml:
    """What a project, an animation or a posture library of Choregraphe says about joints.

    Timelines have frames a second and curves of keys; postures have motors. Nothing is expanded, nothing else opened:
    a document type, which is where entities are declared, is refused, and so are more than `MAX_ELEMENTS`.
    """

    def __init__(self, path: Path) -> None:
        from xml.parsers import expat

        self.path, self.timelines, self.postures = path, list[dict[str, Any]](), list[dict[str, Any]]()
        self.parser = expat.ParserCreate("utf-8")
        self.parser.buffer_text = True
        self.parser.StartElementHandler, self.parser.EndElementHandler = self._start, self._end
        self.parser.CharacterDataHandler, self.parser.StartDoctypeDeclHandler = self._text, self._doctype
        self._open, self._boxes, self._words = list[str](), list[str](), list[str]()
        self._active: list[dict[str, Any]] = []
        self._motor: dict[str, str] | None = None
        self._n_elements = 0

    def fault(self, told: str) -> FileFormatError:
        """Return an error that names the line."""
        return FileFormatError(f"{self.path}: line {self.parser.CurrentLineNumber}: {told}.")

    def parse(self, content: bytes) -> None:
        from xml.parsers.expat import ExpatError

        if len(content) > MAX_XML_BYTES:
            raise FileFormatError(f"{self.path}: has {len(content)} bytes, expected at most {MAX_XML_BYTES} of XML.")
        try:
            self.parser.Parse(content, True)
        except ExpatError as error:
            raise self.fault(f"not XML ({str(error)[:80]})") from None
        except (ValueError, LookupError, UnicodeError) as error:
            if isinstance(error, FileFormatError):
                raise
            raise self.fault(f"not XML ({str(error)[:80]})") from None

    def _doctype(self, *_: object) -> None:
        raise self.fault("has a document type, in which entities could be declared; expected none")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        tag = tag.rpartition(":")[2].lower()
        self._n_elements += 1
        self._open.append(tag)
        self._words = []
        if self._n_elements > MAX_ELEMENTS or len(self._open) > MAX_DEPTH:
            much = f"more than {MAX_ELEMENTS} elements" if self._n_elements > MAX_ELEMENTS else "elements too deep"
            raise self.fault(f"has {much}")
        found = {name.rpartition(":")[2].lower(): value.strip() for name, value in attributes.items()}
        if tag == "box":
            self._boxes.append(found.get("name", ""))
        elif tag in ("timeline", "animation"):
            line, box = self.parser.CurrentLineNumber, self._boxes[-1] if self._boxes else ""
            self._active.append(found | {"curves": [], "line": line, "box": box})
            self.timelines.append(self._active[-1])
        elif tag == "actuatorcurve" and self._active:
            curve = found | {"keys": [], "lines": [], "bent": False, "line": self.parser.CurrentLineNumber}
            self._active[-1]["curves"].append(curve)
        elif tag == "key" and self._active and self._active[-1]["curves"]:
            curve = self._active[-1]["curves"][-1]
            curve["keys"].append((self._number(found, "frame"), self._number(found, "value")))
            curve["lines"].append(self.parser.CurrentLineNumber)
        elif tag == "tangent" and self._active and self._active[-1]["curves"]:
            self._active[-1]["curves"][-1]["bent"] = True
        elif tag == "position":
            self.postures.append({"version": found.get("version"), "motors": {}})
        elif tag == "motor" and self.postures:
            self._motor = {name: found[name] for name in ("name", "value") if name in found}

    def _text(self, text: str) -> None:
        if self.postures:
            self._words.append(text)

    def _end(self, tag: str) -> None:
        tag = tag.rpartition(":")[2].lower()
        self._open.pop()
        word = "".join(self._words).strip()
        self._words = []
        if tag == "box":
            self._boxes.pop()
        elif tag in ("timeline", "animation"):
            self._active.pop()
        elif tag in ("name", "value") and self._motor is not None:
            self._motor[tag] = word
        elif tag == "version" and self.postures:
            self.postures[-1]["version"] = word
        elif tag == "motor" and self._motor is not None:
            name, motors = self._motor.get("name", ""), self.postures[-1]["motors"]
            if name in motors:
                raise self.fault(f"`{name[:40]}` stands in the posture twice")
            motors[name] = self._number(self._motor, "value")
            self._motor = None

    def _number(self, found: dict[str, str], name: str) -> float:
        try:
            return cell_number(found[name])
        except (KeyError, ValueError):
            raise self.fault(f"`{name}` is {found.get(name, '')[:40]!r}, expected a number") from None


def read_timeline(path: Path, content: bytes, reading: Reading = NOTHING_SAID) -> list[Keys]:
    """Read the timelines of a project (`.xar`) or an animation, or the postures of a library (`.xap`).

    Each timeline with curves is a movement: degrees unless a curve says radians, frames at its frames a second. The
    postures of a library follow each other at `reading.rate`.
    """
    xml = _Xml(path)
    xml.parse(text_of(path, content).encode())
    found = [keys for timeline in xml.timelines if timeline["curves"] for keys in _timeline(path, timeline)]
    if found and reading.rate is not None:
        raise FileFormatError(f"{path}: has frames a second of its own, so --rate is not for it; leave it out.")
    if not found and xml.postures:
        return [_postures(path, xml.postures, reading)]
    if not found:
        raise FileFormatError(f"{path}: no timeline with curves of joints and no posture in it.")
    return found


def _timeline(path: Path, timeline: dict[str, Any]) -> list[Keys]:
    place = f"{path}: line {timeline['line']}"
    called = f"the timeline of box {timeline['box'][:40]!r}" if timeline["box"] else "the timeline"
    if timeline.get("enable", "1").lower() in _OFF:
        return []
    notes, curves, units = list[str](), [], set[str | None]()
    for curve in timeline["curves"]:
        name, line = curve.get("actuator", ""), curve["line"]
        unit = curve.get("unit", "").lower()
        if curve.get("mute", "0").lower() not in _OFF:
            notes.append(f"left out: {name[:40]}, which is muted in line {line}")
        elif not curve["keys"]:
            notes.append(f"left out: {name[:40]}, which has no keys in line {line}")
        elif unit in _PLAIN and name not in JOINTS:
            notes.append(f"left out: {name[:40]}, which has no angle")
        elif unit and unit not in _CURVE_UNITS:
            raise FileFormatError(f"{path}: line {line}: `unit` of {name[:40]} is {unit[:20]!r}, expected 0 or degree.")
        else:
            curves.append(curve)
            units.add(_CURVE_UNITS.get(unit))
    if not curves:
        return []
    if len(units) > 1:
        raise FileFormatError(f"{place}: {called} has curves in different units, expected one.")
    joints, times, angles, fps = [], [], [], 0.0
    for curve in curves:
        rate = curve.get("fps") or timeline.get("fps") or ""
        try:
            fps = cell_number(rate)
        except ValueError:
            fps = 0.0
        if not 0 < fps <= 1000:
            raise FileFormatError(f"{path}: line {curve['line']}: `fps` is {rate[:20]!r}, expected frames a second.")
        frames, values = np.array(curve["keys"]).T
        _within_frames(path, timeline, frames, curve["lines"])
        joints.append(curve.get("actuator", ""))
        times.append(frames / fps)
        angles.append(values)
    if any(curve["bent"] for curve in curves):
        notes.append("tangents were left out; between keys a monotone cubic is taken")
    if timeline.get("repeatcycles", "1") not in ("", "0", "1"):
        notes.append(f"repeated {timeline['repeatcycles'][:10]} times there, read once")
    notes.append(f"frames read at {fps:g} a second")
    lines = [curve["lines"] for curve in curves]
    where = f"line {timeline['line']}" + (f", box {timeline['box'][:40]}" if timeline["box"] else "")
    return [
        Keys(
            tuple(joints), times, angles, units.pop(), notes=notes, lines=lines, seconds_known=True, place=where
        )
    ]  # fmt: skip


def _within_frames(path: Path, timeline: dict[str, Any], frames: np.ndarray, lines: list[int]) -> None:
    """Refuse keys before the first or after the last frame that a timeline plays."""
    for name, sign in (("start_frame", -1.0), ("end_frame", 1.0)):
        try:
            last = cell_number(timeline.get(name) or "-1")
        except ValueError:
            last = math.nan
        if not math.isfinite(last):
            told = f"`{name}` is {timeline[name][:20]!r}, expected a number"
            raise FileFormatError(f"{path}: line {timeline['line']}: {told}.")
        outside = np.flatnonzero(sign * (frames - last) > 0)
        if last > 1 and len(outside):
            raise FileFormatError(
                f"{path}: line {lines[outside[0]]}: a key at frame {frames[outside[0]]:g}, but the timeline's "
                f"`{name}` is {last:g}; what it plays cannot be told."
            )


def _postures(path: Path, postures: list[dict[str, Any]], reading: Reading) -> Keys:
    """Return the postures of a library one after the other, as many a second as `reading` says."""
    if len(postures) > 1 and reading.rate is None:
        raise FileFormatError(f"{path}: {len(postures)} postures without times; say with --rate how many a second.")
    joints = tuple(postures[0]["motors"])
    versions = {one["version"] for one in postures}
    if len(versions) > 1 or any(set(one["motors"]) != set(joints) for one in postures):
        raise FileFormatError(f"{path}: its postures have different joints or versions, expected the same.")
    if not joints:
        raise FileFormatError(f"{path}: its postures have no motors.")
    version = versions.pop()
    unit = None if version is None else "radians" if version not in ("0", "1") else "degrees"
    angles = np.array([[one["motors"][joint] for joint in joints] for one in postures])
    times = np.arange(len(postures)) / (reading.rate or 1.0)
    notes = [f"{len(postures)} postures, {reading.rate or 1.0:g} a second"]
    return Keys(joints, [times] * len(joints), list(angles.T.copy()), unit, notes=notes, seconds_known=True)
