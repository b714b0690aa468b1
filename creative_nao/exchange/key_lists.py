"""NAOqi's own form, names, times and angles as parallel lists: as JSON, and how such lists become keys.

The JSON object maps one to one onto `ALMotion.angleInterpolation(names, angles, times, isAbsolute)`; it needs neither
Choregraphe nor this package. Every bit of every angle comes back, times to the nanosecond.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao import atomic
from creative_nao.errors import FileFormatError
from creative_nao.exchange import reading
from creative_nao.exchange.keys import Keys
from creative_nao.exchange.motion import Motion

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
    atomic.write_text(path, "{\n" + ",\n".join(lines) + "\n}\n")
    return [f"the first posture is reached after {lead:g} s"]


def _rows(value: Any) -> str:
    """One joint a line: readable, and short enough to compare by eye."""
    if isinstance(value, list) and value and isinstance(value[0], list):
        return "[\n    " + ",\n    ".join(json.dumps(row) for row in value) + "\n  ]"
    return json.dumps(value, allow_nan=False)


def read_json(path: Path, content: bytes) -> Keys:
    """Read an object with `names`, `times` and `angles` (or `keys`); times may be one list for all joints.

    Raises:
        FileFormatError: If a list is missing or of the wrong kind, or the angles are relative.
    """
    found = reading.as_json(path, reading.as_text(path, content))
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
    """Turn three parallel lists into keys; a key may be an angle or an angle with its two Bezier handles.

    Raises:
        FileFormatError: If they are not lists of numbers of matching lengths.
    """
    joints = reading.names(names, path, "`names`")
    when, where = reading.listed(times, path, "`times`"), reading.listed(angles, path, "`angles`")
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
        row = reading.listed(row_angles, path, f"`angles` of {joint[:40]}")
        bent = bent or any(isinstance(key, list | tuple) for key in row)
        all_angles.append(np.array([_angle(key, path, joint) for key in row], dtype=np.float64))
        row = reading.listed(row_times, path, f"`times` of {joint[:40]}")
        all_times.append(np.array([reading.number(t, path, f"a time of {joint[:40]}") for t in row], dtype=np.float64))
    notes = ["Bezier handles were left out; between keys a monotone cubic is taken"] if bent else []
    return Keys(joints, all_times, all_angles, notes=notes)


def _angle(key: object, path: Path, joint: str) -> float:
    value = key[0] if isinstance(key, list | tuple) and len(key) == 3 else key
    return reading.number(value, path, f"an angle of {joint[:40]}")
