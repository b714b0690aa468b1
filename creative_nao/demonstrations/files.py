"""A set of basic actions as a folder: one CSV file an action, named after it, and `record.json` beside them."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from creative_nao import atomic, provenance
from creative_nao.demonstrations.csv_format import TIME_COLUMN, column_names, load_trajectory, save_trajectory
from creative_nao.demonstrations.dataset import Demonstrations
from creative_nao.demonstrations.keyframes import ACTIONS, DT_S
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError
from creative_nao.fields import Fields, is_plain_name, shown
from creative_nao.joints import JOINTS
from creative_nao.untrusted import as_json, read_text

SHIPPED_FOLDER = Path(__file__).parent / "data"
"""The six basic actions that come with the package."""

RECORD_NAME = "record.json"
MAX_ACTIONS = 1_000


def load_demonstrations(
    folder: str | os.PathLike[str] | None = None, dt_s: float = DT_S, joints: tuple[str, ...] | None = JOINTS
) -> Demonstrations:
    """Load basic actions: the six that ship with the package, or every CSV file of a folder.

    The paper's six stand first, in its order; other actions follow by the alphabet. Files may hold further columns
    (a wrist, a current); they are left out and named in the record under `ignored_columns`.

    Args:
        folder: Folder of CSV files as `csv_format.py` describes; each action is named after its file. None: the six.
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
    folder = SHIPPED_FOLDER if folder is None else Path(folder)
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
    if joints is None:
        joints = tuple(name for name in column_names(files[0]) if name != TIME_COLUMN)
    trajectories = [load_trajectory(path, dt_s, joints) for path in files]
    ignored = {path.name: [c for c in column_names(path) if c not in (TIME_COLUMN, *joints)] for path in files}
    record: dict[str, Any] = {
        "files": {path.name: provenance.sha256(path) for path in files},
        "ignored_columns": {name: columns for name, columns in ignored.items() if columns},
        "taught": _read_record(folder / RECORD_NAME),
    }
    return Demonstrations(tuple(path.stem for path in files), trajectories, dt_s, joints, record)


def save_demonstrations(folder: str | os.PathLike[str], demos: Demonstrations) -> Path:
    """Write each action as `<name>.csv` and the record as `record.json`, every file in one step; return the folder.

    Raises:
        NotFoundError: If files vanished while the others were written: fewer actions must not pass for all.
        SettingsError: If a name would lead out of the folder.
    """
    folder = Path(folder)
    for name in demos.names:
        if not is_plain_name(name):
            raise SettingsError(f"an action that becomes a file should have a plain name, but is called {shown(name)}.")
    paths = [folder / f"{name}.csv" for name in demos.names]
    for path, trajectory in zip(paths, demos.trajectories, strict=True):
        save_trajectory(path, trajectory, demos.dt_s, demos.joints)
    atomic.write_text(folder / RECORD_NAME, json.dumps(demos.record, indent=2) + "\n")
    if gone := [path.name for path in paths if not path.exists()]:
        raise NotFoundError(f"{folder}: {gone[0]} vanished while the others were written; write them again.")
    return folder


def _read_record(path: Path) -> dict[str, Any] | None:
    if not path.is_file():
        return None
    return Fields(as_json(read_text(path, "record of demonstrations"), str(path)), str(path)).values
