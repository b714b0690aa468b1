"""Movements as tables: CSV with a column for the time and one for each joint.

Commas, semicolons or tabs stand between the columns; with semicolons a decimal comma is one. A first line `sep=;`, as
spreadsheets write it, is followed. A column is a joint's if it has the joint's name, alone, with a unit
(`RElbowYaw_deg`) or as the robot's memory calls it (`Device/SubDeviceList/RElbowYaw/Position/Sensor/Value`).
"""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import numpy as np

from creative_nao import storage
from creative_nao.errors import FileFormatError
from creative_nao.exchange.keys import NOTHING_SAID, TIME_UNITS_S, Keys, Reading, text_of
from creative_nao.exchange.motion import Motion
from creative_nao.joints import JOINTS

TIME_COLUMN = "time_s"
MAX_CELLS = 1_200_000  # of a table: 16 MB of numbers with all their digits are a million
_TIME_NAMES = {"time", "t", "timestamp", "stamp", "seconds", "secs", "sec", "elapsed"}
_UNIT = re.compile(r"(.*?)[ _]?[\[(]?(s|sec|seconds|ms|us|ns|rad|radians|deg|degrees)[\])]?", re.IGNORECASE)
_MEMORY_KEY = re.compile(r"(?:Device/SubDeviceList/)?(\w+)/Position/(Sensor|Actuator)/Value")
_SINCE_1970 = {"s": 1e8, "ms": 1e11, "us": 1e14, "ns": 1e17}  # clocks that count from 1970 stand above, after 1973


def csv_text(angles: np.ndarray, dt_s: float, joints: tuple[str, ...]) -> str:
    """Return `time_s` and one column for each joint as CSV, to the bit; angles [rad], shape (n_steps, n_joints)."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([TIME_COLUMN, *joints])
    for step, posture in enumerate(angles):
        writer.writerow([repr(round(step * dt_s, 9)), *(repr(float(angle)) for angle in posture)])
    return text.getvalue()


def write_csv(motion: Motion, path: Path) -> list[str]:
    """Write `time_s` and one column for each joint."""
    storage.write_text(path, csv_text(motion.angles, motion.dt_s, motion.joints))
    return []


def read_csv(path: Path, content: bytes, reading: Reading = NOTHING_SAID) -> list[Keys]:
    """Read a table; errors name line and column, and what is wrong in a column that nobody wants does no harm."""
    header, rows, notes = read_table(path, text_of(path, content))
    if len(rows) < 2:
        raise FileFormatError(f"{path}: has {len(rows)} postures below its header, expected at least 2.")
    comma = any("semicolons" in note for note in notes)
    columns = list(zip(*[row for _, row in rows], strict=True))
    lines = [line for line, _ in rows]
    time = _time_column(path, header, reading)
    faults: dict[str, str] = {}
    joints, angles, unit = [], [], None
    for name, cells in zip(header, columns, strict=True):
        if name == time:
            continue
        joint, said = _joint(name)
        if said and unit not in (None, said):
            raise FileFormatError(f"{path}: line 1: columns in radians and in degrees, expected one unit.")
        unit = unit or said
        values, fault = _numbers(cells, lines, joint, comma)
        if fault:
            faults.setdefault(joint, fault)
        joints.append(joint)
        angles.append(values)
    joints, angles = _measured(joints, angles, [name for name in header if name != time], notes)
    if comma and any("," in cell for row in columns for cell in row):
        notes.append("decimal commas read as points")
    known = False
    if time is None:
        times = np.arange(len(rows)) / (reading.rate or 1.0)
        known = True
        notes.append(f"times made from --rate: {reading.rate:g} postures a second")
    else:
        times, fault = _numbers(columns[header.index(time)], lines, time, comma)
        if fault:
            raise FileFormatError(f"{path}: {fault}.")
        times, known = _seconds(times, time, reading, notes)
    return [
        Keys(
            tuple(joints), [times] * len(joints), angles, unit, notes=notes, faults=faults, lines=[lines] * len(joints),
            seconds_known=known, asked=True, time_step_s=4e-7 if len(times) and abs(times[0]) > 1e8 else 0.0,
        )
    ]  # fmt: skip


def _time_column(path: Path, header: list[str], reading: Reading) -> str | None:
    """Return the name of the column that holds the time; None where `--rate` stands for one."""
    wanted = reading.time_column
    found = [name for name in header if _time_name(name)] if wanted is None else [n for n in header if n == wanted]
    if TIME_COLUMN in found:
        found = [name for name in found if name == TIME_COLUMN]
    told = f"the first line has {', '.join(header)[:200]}"
    if wanted is None and reading.rate is not None:
        if found:
            raise FileFormatError(f"{path}: has the times `{found[0]}`, so --rate is not for it; leave --rate out.")
        return None
    if not found:
        called = f"`{wanted}`" if wanted else f"`{TIME_COLUMN}`"
        raise FileFormatError(
            f"{path}: no column {called} for the time; {told}; say which one with --time-column, or --rate for "
            "postures a second."
        )
    if len(found) > 1:
        raise FileFormatError(
            f"{path}: {len(found)} columns may be the time: {', '.join(found)[:200]}; say which with --time-column."
        )
    return found[0]


def _time_name(name: str) -> bool:
    bare = _UNIT.fullmatch(name)
    return name.lower() in _TIME_NAMES or (bare is not None and bare[1].lower() in _TIME_NAMES)


def _seconds(times: np.ndarray, name: str, reading: Reading, notes: list[str]) -> tuple[np.ndarray, bool]:
    """Return times in seconds from the first on, and whether the unit is certain."""
    said = _UNIT.fullmatch(name)
    unit = reading.time_unit or (said[2].lower().replace("seconds", "s").replace("sec", "s") if said else None)
    unit = unit if unit in TIME_UNITS_S else None
    first = abs(float(times[0])) if len(times) else 0.0
    since = next((u for u in ("ns", "us", "ms", "s") if first >= _SINCE_1970[u]), None)
    if unit is None and since is not None:
        unit = since
        notes.append(f"`{name}` counts from 1970 in {unit}; the first posture is at 0 s")
        return (times - times[0]) * TIME_UNITS_S[unit], True
    if unit not in (None, "s"):
        notes.append(f"`{name}` read in {unit}")
    if name != TIME_COLUMN and unit is None:
        notes.append(f"`{name}` taken for the time in seconds")
    certain = reading.time_unit is not None or unit not in (None, "s")
    return (times - (times[0] if len(times) and since else 0.0)) * TIME_UNITS_S[unit or "s"], certain


def _joint(name: str) -> tuple[str, str | None]:
    """Return the joint that a column is of, and its unit if the name says one."""
    if found := _MEMORY_KEY.fullmatch(name):
        return found[1], None
    found = _UNIT.fullmatch(name)
    if found and found[1] in JOINTS and found[2].lower().startswith(("rad", "deg")):
        return found[1], "degrees" if found[2].lower().startswith("deg") else "radians"
    return name, None


def _measured(
    joints: list[str], angles: list[np.ndarray], names: list[str], notes: list[str]
) -> tuple[list[str], list[np.ndarray]]:
    """Leave out the commands of joints whose measured angles are there too."""
    measured = {joint for joint, name in zip(joints, names, strict=True) if "/Sensor/" in name}
    kept = [k for k, name in enumerate(names) if not ("/Actuator/" in name and joints[k] in measured)]
    if len(kept) < len(joints):
        notes.append("left out: what was commanded, where what was measured is there")
    return [joints[k] for k in kept], [angles[k] for k in kept]


def _numbers(cells: tuple[str, ...], lines: list[int], name: str, comma: bool) -> tuple[np.ndarray, str]:
    """Return cells as numbers, and what is wrong with the first that is none."""
    values, fault = np.full(len(cells), np.nan), ""
    for place, cell in enumerate(cells):
        try:
            values[place] = cell_number(cell.replace(",", ".") if comma and "." not in cell else cell)
        except ValueError:
            hint = "; a decimal comma? expected a point" if "," in cell and not comma else ""
            fault = fault or f"line {lines[place]}: `{name}` is `{cell[:40]}`, expected a number{hint}"
        else:
            if not np.isfinite(values[place]):
                fault = fault or f"line {lines[place]}: `{name}` is `{cell[:40]}`, expected a finite number"
    return values, fault


def read_table(path: Path, text: str) -> tuple[list[str], list[tuple[int, list[str]]], list[str]]:
    """Return the header of CSV text, its lines that are not empty, each with its number, and what was recognised.

    FileFormatError tells where a line is not as wide as the header, or that there are more than `MAX_CELLS` cells.
    """
    notes: list[str] = []
    first, _, rest = text.partition("\n")
    mark, skipped = "", 0
    if first.strip().strip('"').lower().startswith("sep=") and len(first.strip().strip('"')) == 5:
        mark, text, skipped = first.strip().strip('"')[4], rest, 1
        notes.append(f"the line `sep={mark}` followed")
    elif not first.strip():
        first = next((line for line in text.splitlines() if line.strip()), "")
    if not mark:
        counts = {one: first.count(one) for one in ",;\t"}
        mark = "," if counts[","] else max(";\t", key=counts.__getitem__) if max(counts.values()) else ","
    if mark not in ",;\t|":
        raise FileFormatError(f"{path}: line 1: `sep={mark}`, expected a comma, a semicolon or a tab.")
    if mark != ",":
        notes.append(f"columns parted by { ({';': 'semicolons', chr(9): 'tabs'}.get(mark, mark)) }")
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=mark)
    table, n_cells = [], 0
    try:
        for row in reader:
            n_cells += max(len(row), 1)  # a file of empty lines ends, too
            if n_cells > MAX_CELLS:
                raise FileFormatError(
                    f"{path}: line {reader.line_num + skipped}: has more than {MAX_CELLS} cells to here."
                )
            if any(cells := [cell.strip() for cell in row]):
                table.append((reader.line_num + skipped, cells))
    except csv.Error as error:
        raise FileFormatError(f"{path}: line {reader.line_num + skipped}: not a line of CSV ({error}).") from None
    if not table:
        raise FileFormatError(f"{path}: is empty, expected the header `{TIME_COLUMN},{','.join(JOINTS)}`.")
    header = table[0][1]
    for line, row in table[1:]:
        if len(row) != len(header):
            hint = "; perhaps a comma is the decimal mark" if len(row) > len(header) and mark == "," else ""
            raise FileFormatError(
                f"{path}: line {line}: has {len(row)} columns, expected {len(header)} as the header{hint}"
            )
    return header, table[1:], notes


def cell_number(cell: str) -> float:
    """Return a cell as a number, else raise ValueError; 1_000 is none, although Python reads it so."""
    if "_" in cell:
        raise ValueError(f"{cell[:40]} should be a number")
    return float(cell)
