"""Basic actions in files: a folder holds one recording an action, named after it, and `record.json`.

What is written is CSV: the header `time_s,RShoulderPitch,...`, then one posture a line, in seconds and radians. What is
read may have any format of `creative_nao.exchange`, and any rate: recordings are brought to the network's tick.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao import runtime, storage
from creative_nao.demonstrations.dataset import Demonstrations
from creative_nao.demonstrations.keyframes import ACTIONS
from creative_nao.errors import FileFormatError, NotFoundError
from creative_nao.exchange.formats import FORMATS, read, read_all
from creative_nao.exchange.keys import Reading, Recording
from creative_nao.exchange.motion import DT_S, MAX_STEPS, Tick, check_duration
from creative_nao.exchange.table import csv_text
from creative_nao.joints import JOINTS, joint_angles
from creative_nao.schema import JsonObject, Names, PlainName, checked, checked_path, parse


def load_trajectory(
    path: str | os.PathLike[str],
    dt_s: float = DT_S,
    joints: tuple[str, ...] | None = JOINTS,
    *,
    reading: Reading | None = None,
) -> np.ndarray:
    """Read the one movement of a file of any known format and bring it to the tick `dt_s`.

    Args:
        path: The file.
        dt_s: Tick of the result [s]; `exchange.motion.resample` tells how another rate is brought to it.
        joints: Joints to read, in this order. None reads all, in the file's order.
        reading: What the file does not say about itself, such as the posture that fills a recording of one arm.

    Returns:
        Joint angles [rad], shape (n_steps, n_joints).

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If the file does not hold a movement, or angles more than 0.02 rad beyond a joint's range; the
            message says where and why.
    """
    dt_s = checked(Tick, dt_s, "dt_s")
    return _at_tick(read(path, dt_s, joints, reading=reading, beyond="refuse"), checked_path(path))


def _at_tick(recording: Recording, path: Path) -> np.ndarray:
    motion = recording.motion
    check_duration(max(motion.duration_s, motion.dt_s), motion.dt_s, MAX_STEPS, f"{path}")
    return motion.angles


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
    text = csv_text(joint_angles(trajectory, "trajectory", joints), dt_s, joints)
    return storage.write_text(checked_path(path), text)


SHIPPED_FOLDER = Path(__file__).parent / "data"  # the six basic actions that come with the package
RECORD_NAME = "record.json"
MAX_ACTIONS = 1_000


def load_demonstrations(
    folder: str | os.PathLike[str] | None = None,
    dt_s: float = DT_S,
    joints: tuple[str, ...] | None = JOINTS,
    *,
    reading: Reading | None = None,
) -> Demonstrations:
    """Load basic actions: the six that ship with the package, or every recording of a folder.

    The paper's six stand first, in its order; other actions follow by the alphabet. A file with several movements gives
    as many actions, numbered from 1. What was left out, filled or converted is in the record, file by file, under
    `notes`.

    Args:
        folder: Folder of recordings, in any format of `exchange.FORMATS`; each action is named after its file. Other
            files are left alone, and so are records, whose names end in `record.json`. None: the six.
        dt_s: Tick of the result [s]; files of another rate are resampled.
        joints: Joints to read. None takes every joint of the first file, for a robot other than NAO.
        reading: What the files do not say about themselves.

    Returns:
        The basic actions, with the SHA-256 of every file in their record.

    Raises:
        NotFoundError: If the folder does not exist or holds no recording.
        FileFormatError: If a file does not hold a movement; the message says where and why.

    Example:
        >>> demos = load_demonstrations()
        >>> demos.names[0], len(demos), demos.trajectories[0].shape
        ('left_jab', 6, (50, 8))
    """
    folder, dt_s = SHIPPED_FOLDER if folder is None else checked_path(folder, "folder"), checked(Tick, dt_s, "dt_s")
    if not folder.is_dir():
        raise NotFoundError(
            f"no folder of basic actions at {folder}; make one with `creative-nao teach --out {folder}`."
        )
    paper = list(ACTIONS)
    files = sorted(
        (path for path in folder.iterdir() if _is_recording(path)),
        key=lambda path: (paper.index(path.stem) if path.stem in paper else len(paper), path.stem),
    )
    if len(files) > MAX_ACTIONS:
        raise FileFormatError(f"{folder}: holds {len(files)} recordings, expected at most {MAX_ACTIONS} actions.")
    if not files:
        raise NotFoundError(f"no recording in {folder}; make some with `creative-nao teach --out {folder}`.")
    names, trajectories, notes = list[str](), list[np.ndarray](), dict[str, list[str]]()
    for path in files:
        recordings = read_all(path, dt_s, joints, reading=reading, beyond="refuse")
        for number, recording in enumerate(recordings, start=1):
            name = path.stem if len(recordings) == 1 else f"{path.stem}_{number}"
            if name in names:
                raise FileFormatError(f"{folder}: two recordings are called {name}, {path.name} is one; rename it.")
            joints = recording.motion.joints if joints is None else joints
            names.append(name)
            trajectories.append(_at_tick(recording, path))
            if recording.notes:
                notes[path.name if len(recordings) == 1 else f"{path.name}, {recording.place}"] = list(recording.notes)
    beside, taught = folder / RECORD_NAME, None
    if beside.is_file():
        taught = parse(JsonObject, storage.read_json(beside, "record of demonstrations"), f"{beside}")
    record: dict[str, Any] = {
        "files": {path.name: runtime.sha256(path) for path in files}, "notes": notes, "taught": taught,
    }  # fmt: skip
    return Demonstrations(tuple(names), trajectories, dt_s, joints or JOINTS, record)


def _is_recording(path: Path) -> bool:
    known = any(path.suffix.lower() in one.endings for one in FORMATS.values())
    is_record = path.name.endswith(RECORD_NAME)
    return known and not is_record and not path.name.startswith(".") and path.is_file()


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
