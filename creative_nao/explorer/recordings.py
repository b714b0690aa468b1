"""Movements into and out of the page: uploads are parsed in memory, downloads are made in a folder of our own."""

from __future__ import annotations

import tempfile
from pathlib import Path, PurePath

from creative_nao.errors import FileFormatError
from creative_nao.exchange import FORMATS, Motion, Recording, recognise, write
from creative_nao.exchange.keys import to_motion
from creative_nao.explorer.mind import Mind, Recall
from creative_nao.joints import JOINTS

MAX_UPLOAD_BYTES = 2_000_000
MAX_TICKS = 2000
_ENDINGS = {ending for one in FORMATS.values() for ending in one.endings}


def read_upload(name: str, content: bytes, dt_s: float) -> Recording:
    """Read an uploaded movement at a tick [s]; of its name only a known ending counts, and no file is made.

    Raises:
        FileFormatError: If it is too large or too long, or holds no movement.
        SettingsError: If its format is not recognised.
    """
    if len(content) > MAX_UPLOAD_BYTES:
        raise FileFormatError(f"a recording may have {MAX_UPLOAD_BYTES} bytes, this one has {len(content)}")
    ending = PurePath(name).suffix.lower()
    source = Path(f"recording{ending if ending in _ENDINGS else '.csv'}")
    format_name = recognise(source, content)
    motion, notes = to_motion(FORMATS[format_name].read(source, content), source, dt_s, JOINTS)
    if not 2 <= len(motion.angles) <= MAX_TICKS:
        raise FileFormatError(
            f"a recording should have 2 to {MAX_TICKS} ticks of {dt_s} s, but has {len(motion.angles)}"
        )
    return Recording(motion, format_name, notes)


def export(recall: Recall, mind: Mind, format_name: str) -> tuple[str, bytes, tuple[str, ...]]:
    """Return file name, content and changes of a movement in one of the exchange formats.

    A movement too fast or too wide is clipped and slowed down for formats that a robot plays, and kept otherwise.
    """
    one = FORMATS[format_name]
    metadata = {"memory": mind.memory.name, "pb": [list(map(float, point)) for point in recall.points]}
    motion = Motion(recall.trajectory, mind.memory.dt_s, JOINTS, metadata if one.holds_metadata else {})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"movement{one.endings[0]}"
        done = write(path, motion, format_name, unsafe="clip" if one.for_robots else "keep")
        return path.name, path.read_bytes(), done.changes
