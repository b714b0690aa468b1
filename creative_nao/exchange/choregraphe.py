"""NAOqi's own form, names, times and angles as parallel lists: as JSON, and as a Python program.

The JSON object maps one to one onto `ALMotion.angleInterpolation(names, angles, times, isAbsolute)`. A program that is
written runs on the robot: plain Python 2.7 or 3, no package needed but the robot's own. One that is read, such as an
export of Choregraphe, is never run. Every bit of every angle comes back, times to the nanosecond.
"""

from __future__ import annotations

import ast
import dataclasses
import json
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from creative_nao import storage
from creative_nao.demonstrations.files import resample
from creative_nao.errors import FileFormatError
from creative_nao.exchange.keys import APPROACH_SPEED_RAD_S, JointNames, Keys, Motion, text_of
from creative_nao.schema import JsonObject, parse

FORMAT_NAME = "creative-nao key lists"
_UNITS = {"rad": "radians", "radian": "radians", "radians": "radians"}
_UNITS |= {"deg": "degrees", "degree": "degrees", "degrees": "degrees"}


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


def read_json(path: Path, content: bytes) -> Keys:
    """Read an object with `names`, `times` and absolute `angles` (or `keys`); times may be one list for all joints."""
    found = parse(JsonObject, text_of(path, content), str(path))
    angles = found.get("angles", found.get("keys"))
    if angles is None or "names" not in found or "times" not in found:
        raise FileFormatError(
            f"{path}: should hold `names`, `times` and `angles`, "
            f"but holds {', '.join(map(str, found))[:200] or 'nothing'}."
        )
    if not found.get("isAbsolute", True):
        raise FileFormatError(f"{path}: angles are relative (isAbsolute is false); expected absolute ones.")
    unit = found.get("unit")
    if unit is not None and str(unit).lower() not in _UNITS:
        raise FileFormatError(f"{path}: `unit` is {str(unit)[:40]!r}, expected radians or degrees.")
    keys = keys_of(path, found["names"], found["times"], angles)
    keys.unit = None if unit is None else _UNITS[str(unit).lower()]
    metadata = found.get("metadata", {})
    keys.metadata = metadata if isinstance(metadata, dict) else {}
    return keys


def keys_of(path: Path, names: object, times: object, angles: object) -> Keys:
    """Turn three parallel lists of equal length into keys: angles, or angles with their two Bezier handles."""
    joints = parse(JointNames, names, f"{path}: `names`")
    when, where = parse(list[Any], times, f"{path}: `times`"), parse(list[Any], angles, f"{path}: `angles`")
    if when and not isinstance(when[0], list | tuple):
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
    return Keys(joints, all_times, all_angles, notes=notes)


MAX_PYTHON_BYTES = 2_000_000  # a syntax tree takes a hundred times the room of its text

_LISTS = {
    "names": "names", "jointNames": "names", "joint_names": "names",
    "times": "times", "timeLists": "times", "time_lists": "times",
    "keys": "keys", "angles": "keys", "angleLists": "keys", "angle_lists": "keys",
}  # fmt: skip
"""Names under which the three lists are known."""


def read_python(path: Path, content: bytes) -> Keys:
    """Read the three lists of a Python file without running it; each must be there once, made of literals."""
    if len(content) > MAX_PYTHON_BYTES:
        raise FileFormatError(
            f"{path}: has {len(content)} bytes, expected at most {MAX_PYTHON_BYTES} of a Python file."
        )
    text = _without_print_statements(text_of(path, content))
    try:
        tree = ast.parse(text)
        found = _gathered(path, tree)
    except (SyntaxError, ValueError, RecursionError, MemoryError, OverflowError) as error:
        if isinstance(error, FileFormatError):
            raise
        line = getattr(error, "lineno", None)
        place = f"line {line}: " if line else ""
        reason = "is nested too deeply" if isinstance(error, RecursionError | MemoryError) else "is not Python text"
        raise FileFormatError(f"{path}: {place}{reason} ({str(error)[:80]}).") from None
    missing = [name for name in ("names", "times", "keys") if not found.get(name)]
    if missing:
        raise FileFormatError(
            f"{path}: no list of {' and '.join(missing)}; expected names, times and keys (or angles)."
        )
    return keys_of(path, found["names"], found["times"], found["keys"])


def _gathered(path: Path, tree: ast.Module) -> dict[str, list[Any]]:
    """Return what is assigned and appended to the three lists, in the order of the lines."""
    found: dict[str, list[Any]] = {}
    statements = [node for node in ast.walk(tree) if isinstance(node, ast.Assign | ast.AnnAssign | ast.Expr)]
    for node in sorted(statements, key=lambda node: node.lineno):
        if isinstance(node, ast.Expr):
            call = node.value
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute) and call.func.attr == "append":
                name = _list_name(call.func.value)
                if name and len(call.args) == 1:
                    found.setdefault(name, []).append(_literal(path, call.args[0], name))
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        for name in filter(None, map(_list_name, targets)):
            if found.get(name):
                raise FileFormatError(
                    f"{path}: line {node.lineno}: `{name}` begins anew; the file holds more than one movement, "
                    "keep one."
                )
            match node.value:
                case None | ast.Call(func=ast.Name(id="list"), args=[]):
                    literal = []
                case value:
                    literal = _literal(path, value, name)
            found[name] = parse(list[Any], literal, f"{path}: line {node.lineno}: `{name}`")
    return found


def _list_name(node: ast.expr) -> str:
    name = node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""
    return _LISTS.get(name, "")


def _literal(path: Path, node: ast.expr, name: str) -> Any:
    try:
        return ast.literal_eval(node)
    except (ValueError, TypeError, SyntaxError):
        raise FileFormatError(
            f"{path}: line {node.lineno}: `{name}` should hold plain numbers and texts, but holds an expression; "
            "it is not run."
        ) from None


def _without_print_statements(text: str) -> str:
    """Make exports written for Python 2 readable: their `print err` and `except X, err` are no syntax today."""
    lines = text.splitlines()
    for place, line in enumerate(lines):
        bare = line.strip()
        space = line[: len(line) - len(line.lstrip())]
        if bare.startswith("print ") and not bare.startswith("print ("):
            lines[place] = f"{space}pass"
        elif bare.startswith("except ") and bare.endswith(":") and "," in bare and "(" not in bare:
            lines[place] = f"{space}except Exception:"
    return "\n".join(lines)


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
