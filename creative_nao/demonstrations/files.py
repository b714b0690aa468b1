"""Basic actions in files: a folder holds one CSV file an action, named after it, and `record.json`.

A CSV file has the header `time_s,RShoulderPitch,...`, then one posture a line, in seconds and radians. Recordings of
any rate are brought to the network's tick (`resample`).
"""

from __future__ import annotations

import csv
import io
import os
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao import runtime, storage
from creative_nao.demonstrations.dataset import Demonstrations, Tick, outside_range
from creative_nao.demonstrations.keyframes import ACTIONS, DT_S
from creative_nao.errors import FileFormatError, NotFoundError, nearest_name
from creative_nao.joints import JOINTS, joint_angles
from creative_nao.schema import JsonObject, Names, PlainName, checked, checked_path, parse
from creative_nao.storage import read_text

TIME_COLUMN = "time_s"
MAX_FILE_BYTES = 20_000_000
MAX_CELLS = 2_000_000  # of a table: 20 MB of numbers with all their digits are a million
LARGEST_TIME_S = 1e12  # clocks that count from 1970 stand at 2e9
SHORTEST_STEP_S = 1e-6
MAX_STEPS = 10_000  # longest trajectory a file may hold, in ticks; more is a mistake in the unit of time
GRID_TOLERANCE_S = 1e-6  # times this close to the tick's grid are on it [s]
_WINDOW_POINTS = 33


def load_trajectory(
    path: str | os.PathLike[str], dt_s: float = DT_S, joints: tuple[str, ...] | None = JOINTS
) -> np.ndarray:
    """Read a trajectory from a CSV file and bring it to the tick `dt_s`.

    Args:
        path: The file: UTF-8 text, commas between columns, a point as decimal mark.
        dt_s: Tick of the result [s]; `resample` tells how another rate is brought to it.
        joints: Columns to read, in this order. None reads every column but the time, in the file's order.

    Returns:
        Joint angles [rad], shape (n_steps, n_joints).

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If the file does not hold a trajectory; the message says where and why.
    """
    dt_s, path = checked(Tick, dt_s, "dt_s"), checked_path(path)
    header, rows = read_table(path, read_text(path, "trajectory", MAX_FILE_BYTES))
    if len(rows) < 2:
        raise FileFormatError(f"{path}: has {len(rows)} postures, expected at least 2.")
    present = tuple(name for name in header if name != TIME_COLUMN)
    wanted = present if joints is None else checked(Names, joints, "joints")
    for name in (TIME_COLUMN, *wanted):
        if name not in header:
            raise FileFormatError(
                f"{path}: column `{name}` is missing{nearest_name(name, header)}; "
                f"the first line, which should name the columns, has {', '.join(header)[:200]}."
            )
        if header.count(name) > 1:
            raise FileFormatError(f"{path}: column `{name}` stands in the first line more than once.")
    columns = [header.index(name) for name in (TIME_COLUMN, *wanted)]
    values = np.array([[_number(row[c], header[c], path, line) for c in columns] for line, row in rows])
    times, angles = values[:, 0], values[:, 1:]

    if np.abs(times).max() > LARGEST_TIME_S:
        k = int(np.abs(times).argmax())
        raise FileFormatError(f"{path}: line {rows[k][0]}: `{TIME_COLUMN}` is {times[k]:g}, expected seconds.")
    late = np.flatnonzero(np.diff(times) < SHORTEST_STEP_S)
    if len(late):
        k = int(late[0]) + 1
        raise FileFormatError(
            f"{path}: line {rows[k][0]}: `{TIME_COLUMN}` should rise from line to line, "
            f"but is {times[k]:g} after {times[k - 1]:g}."
        )
    found = outside_range(angles, wanted)
    if found:
        row, column, clause = found
        raise FileFormatError(f"{path}: line {rows[row][0]}: `{wanted[column]}` {clause}.")
    check_duration(float(times[-1] - times[0]), dt_s, MAX_STEPS, f"{path}")
    return resample(times, angles, dt_s)


def n_ticks(duration_s: float, dt_s: float) -> int:
    """Return how many postures at `dt_s` fit a recording of `duration_s` seconds, the first one at its start."""
    return int(np.floor(duration_s / dt_s + GRID_TOLERANCE_S)) + 1


def check_duration(duration_s: float, dt_s: float, most: int, where: str) -> None:
    """Raise FileFormatError for a recording shorter than a tick or longer than `most` ticks; `where` names it."""
    if duration_s < dt_s * (1.0 - 1e-6):
        raise FileFormatError(f"{where}: lasts {duration_s:g} s, shorter than one tick of {dt_s:g} s.")
    if duration_s / dt_s > most:
        raise FileFormatError(
            f"{where}: lasts {duration_s:g} s, {n_ticks(duration_s, dt_s)} ticks of {dt_s:g} s, "
            f"expected at most {most}; are the times in seconds, not milliseconds?"
        )


def resample(times_s: np.ndarray, angles: np.ndarray, dt_s: float) -> np.ndarray:
    """Return the recorded postures at every `dt_s` seconds, from the first sample on.

    Between the samples a monotone cubic (Fritsch and Butland 1984) never overshoots a posture that was recorded. A
    recording finer than the tick holds movement that the tick cannot (tremor at 10 Hz against 3.3 Hz), which plain
    picking would turn into a slow wobble that nobody made. So each posture is a mean over a Hann window, as wide as the
    tick less the spacing of the recording: of a 50 Hz recording read at 0.15 s, a 1.5 Hz swing keeps 98 % of its size
    and a 10 Hz tremor less than 30 %. A recording at the tick itself is taken as it is.

    Args:
        times_s: When each posture was recorded [s], strictly rising, shape (n,), at least two; spacing may vary.
        angles: Recorded postures [rad], shape (n, n_joints).
        dt_s: The tick [s].

    Returns:
        Postures [rad], shape (n_steps, n_joints).
    """
    times = np.asarray(times_s, dtype=np.float64) - times_s[0]
    ticks = np.arange(n_ticks(times[-1], dt_s)) * dt_s
    if len(ticks) == len(times) and np.abs(ticks - times).max() <= GRID_TOLERANCE_S:
        return np.array(angles, dtype=np.float64)
    width = dt_s - float(np.median(np.diff(times)))
    if width <= 0:
        return monotone_cubic(times, angles, ticks)
    share = (np.arange(_WINDOW_POINTS) + 0.5) / _WINDOW_POINTS
    weights = np.sin(np.pi * share) ** 2
    weights /= weights.sum()
    around = ticks[:, None] + width * (share - 0.5)
    fine = monotone_cubic(times, angles, around.ravel())
    return np.einsum("w,nwj->nj", weights, fine.reshape(len(ticks), _WINDOW_POINTS, -1))


def monotone_cubic(times_s: np.ndarray, angles: np.ndarray, wanted_s: np.ndarray) -> np.ndarray:
    """Return the monotone cubic through `(times_s, angles)` at `wanted_s`, the end postures held outside."""
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(times_s, angles, axis=0)(np.clip(wanted_s, times_s[0], times_s[-1]))


def save_trajectory(
    path: str | os.PathLike[str], trajectory: np.ndarray, dt_s: float = DT_S, joints: tuple[str, ...] = JOINTS
) -> Path:
    """Write a trajectory as CSV, in one step, so that `load_trajectory` gives back the same bits; return the path.

    Args:
        path: Where to write.
        trajectory: Joint angles [rad], shape (n_steps, n_joints).
        dt_s: Time from one posture to the next [s].
        joints: Name of each column.

    Raises:
        ShapeError: If the trajectory is not a finite array of that shape.
    """
    dt_s, joints = checked(Tick, dt_s, "dt_s"), checked(Names, joints, "joints")
    angles = joint_angles(trajectory, "trajectory", joints)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([TIME_COLUMN, *joints])
    for step, posture in enumerate(angles):
        writer.writerow([repr(round(step * dt_s, 9)), *(repr(float(angle)) for angle in posture)])
    return storage.write_text(checked_path(path), text.getvalue())


def _columns(path: Path) -> tuple[str, ...]:
    """Return the names of all columns of a file but the time."""
    header, _ = read_table(path, read_text(path, "trajectory", MAX_FILE_BYTES))
    return tuple(name for name in header if name != TIME_COLUMN)


def read_table(path: Path, text: str) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Return the header of CSV text and its lines that are not empty, each with its number, all as wide as the header.

    FileFormatError tells where it is no such table, or has more than `MAX_CELLS` cells.
    """
    reader = csv.reader(io.StringIO(text, newline=""))
    table, n_cells = [], 0
    try:
        for row in reader:
            n_cells += len(row)
            if n_cells > MAX_CELLS:
                raise FileFormatError(f"{path}: line {reader.line_num}: has more than {MAX_CELLS} cells to here.")
            if any(cells := [cell.strip() for cell in row]):
                table.append((reader.line_num, cells))
    except csv.Error as error:
        raise FileFormatError(f"{path}: line {reader.line_num}: not a line of CSV ({error}).") from None
    if not table:
        raise FileFormatError(f"{path}: is empty, expected the header `{TIME_COLUMN},{','.join(JOINTS)}`.")
    header = table[0][1]
    if len(header) == 1 and (";" in header[0] or "\t" in header[0]):
        mark = "semicolons" if ";" in header[0] else "tabs"
        raise FileFormatError(
            f"{path}: line {table[0][0]}: has {mark} between the columns, expected commas, and a point as decimal mark."
        )
    for line, row in table[1:]:
        if len(row) != len(header):
            hint = "; perhaps a comma is the decimal mark" if len(row) > len(header) else ""
            raise FileFormatError(
                f"{path}: line {line}: has {len(row)} columns, expected {len(header)} as the header{hint}"
            )
    return header, table[1:]


def cell_number(cell: str) -> float:
    """Return a cell as a number, else raise ValueError; 1_000 is none, although Python reads it so."""
    if "_" in cell:
        raise ValueError(f"{cell[:40]} should be a number")
    return float(cell)


def _number(cell: str, column: str, path: Path, line: int) -> float:
    try:
        value = cell_number(cell)
    except ValueError:
        hint = "; a decimal comma? expected a point" if "," in cell else ""
        raise FileFormatError(f"{path}: line {line}: `{column}` is `{cell[:40]}`, expected a number{hint}.") from None
    if not np.isfinite(value):
        raise FileFormatError(f"{path}: line {line}: `{column}` is `{cell[:40]}`, expected a finite number.")
    return value


SHIPPED_FOLDER = Path(__file__).parent / "data"  # the six basic actions that come with the package
RECORD_NAME = "record.json"
MAX_ACTIONS = 1_000


def load_demonstrations(
    folder: str | os.PathLike[str] | None = None, dt_s: float = DT_S, joints: tuple[str, ...] | None = JOINTS
) -> Demonstrations:
    """Load basic actions: the six that ship with the package, or every CSV file of a folder.

    The paper's six stand first, in its order; other actions follow by the alphabet. Files may hold further columns
    (a wrist, a current); they are left out and named in the record under `ignored_columns`.

    Args:
        folder: Folder of CSV files as the module describes; each action is named after its file. None: the six.
        dt_s: Tick of the result [s]; files of another rate are resampled.
        joints: Columns to read. None takes every column of the first file, for a robot other than NAO.

    Returns:
        The basic actions, with the SHA-256 of every file in their record.

    Raises:
        NotFoundError: If the folder does not exist or holds no CSV file.
        FileFormatError: If a file does not hold a trajectory; the message says where and why.

    Example:
        >>> demos = load_demonstrations()
        >>> demos.names[0], len(demos), demos.trajectories[0].shape
        ('left_jab', 6, (50, 8))
    """
    folder = SHIPPED_FOLDER if folder is None else checked_path(folder, "folder")
    if not folder.is_dir():
        raise NotFoundError(
            f"no folder of basic actions at {folder}; make one with `creative-nao teach --out {folder}`."
        )
    paper = list(ACTIONS)
    files = sorted(
        (path for path in folder.iterdir() if path.suffix.lower() == ".csv" and not path.name.startswith(".")),
        key=lambda path: (paper.index(path.stem) if path.stem in paper else len(paper), path.stem),
    )
    if len(files) > MAX_ACTIONS:
        raise FileFormatError(f"{folder}: holds {len(files)} CSV files, expected at most {MAX_ACTIONS} actions.")
    if not files:
        raise NotFoundError(f"no CSV file in {folder}; make some with `creative-nao teach --out {folder}`.")
    joints = _columns(files[0]) if joints is None else joints
    trajectories = [load_trajectory(path, dt_s, joints) for path in files]
    ignored = {path.name: [name for name in _columns(path) if name not in joints] for path in files}
    beside, taught = folder / RECORD_NAME, None
    if beside.is_file():
        taught = parse(JsonObject, storage.read_json(beside, "record of demonstrations"), f"{beside}")
    record: dict[str, Any] = {
        "files": {path.name: runtime.sha256(path) for path in files},
        "ignored_columns": {name: columns for name, columns in ignored.items() if columns},
        "taught": taught,
    }
    return Demonstrations(tuple(path.stem for path in files), trajectories, dt_s, joints, record)


def save_demonstrations(folder: str | os.PathLike[str], demos: Demonstrations) -> Path:
    """Write each action as `<name>.csv` and the record as `record.json`, every file in one step; return the folder.

    Raises:
        NotFoundError: If files vanished while the others were written: fewer actions must not pass for all.
        SettingsError: If a name would lead out of the folder.
    """
    folder, demos = checked_path(folder, "folder"), checked(Demonstrations, demos, "demos")
    names = [checked(PlainName, name, f"names[{place}]") for place, name in enumerate(demos.names)]
    paths = [folder / f"{name}.csv" for name in names]
    for path, trajectory in zip(paths, demos.trajectories, strict=True):
        save_trajectory(path, trajectory, demos.dt_s, demos.joints)
    storage.write_json(folder / RECORD_NAME, demos.record)
    if gone := [path.name for path in paths if not path.exists()]:
        raise NotFoundError(f"{folder}: {gone[0]} vanished while the others were written; write them again.")
    return folder
