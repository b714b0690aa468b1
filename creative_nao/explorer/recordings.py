"""Movements in and out of the page: an upload is read by a process of its own that can be stopped; exports.

That process, `main(NAME, TICK)`, reads an upload from its standard input and answers in JSON.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from creative_nao.errors import CreativeNaoError, FileFormatError, NotFoundError, SettingsError
from creative_nao.exchange import FORMATS, WRITABLE, Motion, Reading, Recording, read_content, write
from creative_nao.joints import JOINTS
from creative_nao.runtime import python_command, python_environment

if TYPE_CHECKING:  # reading an upload needs no network
    from creative_nao.model import Memory

MAX_UPLOAD_BYTES = 2_000_000
MAX_TICKS = 2000
READ_S = 20.0
"""How long reading an upload may take [s], most of which is starting the process on a busy machine."""
READ_CPU_S, READ_MEMORY_BYTES = 10, 4_000_000_000


def read_upload(name: str, content: bytes, dt_s: float, deadline_s: float = READ_S) -> Recording:
    """Read an uploaded movement at a tick [s] in a process of its own; of its name only a known ending counts.

    Raises:
        FileFormatError: If it is too large or too long, holds no movement, or cannot be read in `deadline_s` [s].
        SettingsError: If its format is not recognised.
    """
    shown = "".join(mark for mark in PurePath(name.replace("\\", "/")).name if mark.isprintable())[-60:] or "recording"
    if len(content) > MAX_UPLOAD_BYTES:
        raise FileFormatError(f"{shown}: a recording may have {MAX_UPLOAD_BYTES} bytes, this one has {len(content)}")
    command = python_command("creative_nao.explorer.recordings", shown, repr(float(dt_s)))
    try:
        done = subprocess.run(  # noqa: S603 - our own module
            command, input=content, capture_output=True, timeout=deadline_s, env=python_environment(), check=False
        )
    except subprocess.TimeoutExpired:
        raise FileFormatError(f"{shown}: reading it took more than {deadline_s:g} s and was stopped") from None
    if done.returncode:
        raise FileFormatError(f"{shown}: reading it took too much time or memory and was stopped")
    answer = json.loads(done.stdout)
    if "error" in answer:
        kind = SettingsError if answer["kind"] == "SettingsError" else FileFormatError
        raise kind(answer["error"])
    return Recording(Motion(np.array(answer["angles"]), dt_s, JOINTS), answer["format"], tuple(answer["notes"]))


def _read(name: str, content: bytes, dt_s: float) -> dict[str, Any]:
    ending = PurePath(name).suffix.lower()
    known = any(ending in exchange_format.endings for exchange_format in FORMATS.values())
    source = Path(name if known else f"{name}.csv")
    recordings = read_content(source, content, dt_s, JOINTS, reading=Reading(fill="guard"), beyond="refuse")
    n_ticks = len(recordings[0].motion.angles)
    if not 2 <= n_ticks <= MAX_TICKS:
        raise FileFormatError(
            f"{source}: a recording should have 2 to {MAX_TICKS} ticks of {dt_s} s, but has {n_ticks}"
        )
    found = recordings[0]
    several = [f"the file holds {len(recordings)} movements, this is the first"] if len(recordings) > 1 else []
    return {"angles": found.motion.angles.tolist(), "format": found.format, "notes": [*several, *found.notes]}


def _limit() -> None:
    try:
        import resource
    except ImportError:  # Windows: the deadline is all there is
        return
    resource.setrlimit(resource.RLIMIT_CPU, (READ_CPU_S, READ_CPU_S))
    resource.setrlimit(resource.RLIMIT_AS, (READ_MEMORY_BYTES, READ_MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def main(arguments: list[str]) -> int:
    """Read an upload from standard input; print what it holds, or what is wrong with it, as JSON."""
    _limit()
    content = sys.stdin.buffer.read(MAX_UPLOAD_BYTES + 1)
    try:
        answer = _read(arguments[0], content, float(arguments[1]))
    except CreativeNaoError as error:
        answer = {"error": str(error), "kind": type(error).__name__}
    sys.stdout.write(json.dumps(answer))
    return 0


def export(
    memory: Memory, points: Sequence[Sequence[float]], trajectory: np.ndarray, format_name: str
) -> tuple[str, bytes, tuple[str, ...]]:
    """Return file name, content and changes of a movement in one of the exchange formats; NotFoundError of another.

    A movement too fast or too wide is clipped and slowed down for formats that a robot plays, and kept otherwise.
    """
    if format_name not in WRITABLE:
        raise NotFoundError(f"no format `{format_name:.40}`; there are {', '.join(WRITABLE)}")
    chosen = FORMATS[format_name]
    metadata = {"memory": memory.name, "pb": [list(point) for point in points]}
    motion = Motion(trajectory, memory.dt_s, JOINTS, metadata if chosen.holds_metadata else {})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"movement{chosen.endings[0]}"
        written = write(path, motion, format_name, unsafe="clip" if chosen.for_robots else "keep")
        return path.name, path.read_bytes(), written.changes
