"""CSV as in `demonstrations/csv_format.py` and NPZ without pickle: every bit of every angle comes back.

CSV is read less strictly here than where a network learns from it: degrees are recognised, and angles beyond a range
are left to the check before an export.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao import atomic, npz
from creative_nao.demonstrations import csv_format
from creative_nao.errors import FileFormatError
from creative_nao.exchange import reading
from creative_nao.exchange.keys import Keys
from creative_nao.exchange.motion import Motion
from creative_nao.fields import only_arrays


def write_csv(motion: Motion, path: Path) -> list[str]:
    """Write `time_s` and one column for each joint."""
    csv_format.save_trajectory(path, motion.angles, motion.dt_s, motion.joints)
    return []


def read_csv(path: Path, content: bytes) -> Keys:
    """Read a CSV file with a column `time_s` in seconds.

    Raises:
        FileFormatError: If it is not such a table; the message names line and column.
    """
    table = csv_format.split_table(path, reading.as_text(path, content))
    header = table[0][1] if table else []
    time = csv_format.TIME_COLUMN
    if header.count(time) != 1 or len(header) < 2:
        raise FileFormatError(
            f"{path}: the first line should be `{time}` and joint names, but is {', '.join(header)[:200]}."
        )
    for line, row in table[1:]:
        if len(row) != len(header):
            raise FileFormatError(f"{path}: line {line}: has {len(row)} columns, expected {len(header)} as the header.")
    columns = [[_cell(row[c], header[c], path, line) for line, row in table[1:]] for c in range(len(header))]
    times = np.array(columns.pop(header.index(time)))
    joints = tuple(name for name in header if name != time)
    if np.isnan(times).any():
        raise FileFormatError(f"{path}: `{time}` holds something that is not a number.")
    return Keys(joints, [times] * len(joints), [np.array(column) for column in columns])


def _cell(cell: str, column: str, path: Path, line: int) -> float:
    """Return a number; what is none becomes NaN, since a column nobody wants may hold text."""
    try:
        if "_" in cell:
            raise ValueError
        return float(cell)
    except ValueError:
        if "," in cell:
            raise FileFormatError(f"{path}: line {line}: `{column}` is `{cell[:40]}`; a decimal comma?") from None
        return float("nan")


def write_npz(motion: Motion, path: Path) -> list[str]:
    """Write the arrays `angles`, `dt_s`, `joints` and `metadata` (JSON text)."""
    with atomic.replacing(path) as temporary, open(temporary, "wb") as stream:
        np.savez(
            stream,
            angles=motion.angles,
            dt_s=np.array(motion.dt_s),
            joints=np.array(motion.joints),
            metadata=np.array(json.dumps(motion.metadata)),
        )
    return []


def read_npz(path: Path, content: bytes) -> Keys:
    """Read what `write_npz` writes; `times_s`, shape (n_steps,), may stand in the place of `dt_s`.

    Raises:
        FileFormatError: If an array is missing, torn, pickled, or has the wrong type or shape.
    """
    arrays = npz.unpack_npz(path, "movement", content, reading.MAX_FILE_BYTES)
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
    metadata = _metadata(path, arrays)
    columns = [column.astype(np.float64) for column in angles.T]
    return Keys(tuple(str(name) for name in joints), [times] * len(columns), columns, "radians", metadata=metadata)


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


def _metadata(path: Path, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    if "metadata" not in arrays:
        return {}
    if arrays["metadata"].dtype.kind != "U" or arrays["metadata"].shape != ():
        raise FileFormatError(f"{path}: `metadata` should be JSON text, but is {arrays['metadata'].dtype}.")
    return reading.as_json(path, str(arrays["metadata"]))
