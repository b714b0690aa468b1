"""Movements in and out of the page: an upload is read by a process of its own that can be stopped; exports.

That process, `main(NAME, TICK)`, reads an upload from its standard input and answers in JSON.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from creative_nao.errors import CreativeNaoError, FileFormatError, NotFoundError, SettingsError
from creative_nao.exchange import FORMATS, WRITABLE, Motion, Reading, Recording, read_content, write
from creative_nao.exchange.motion import resample
from creative_nao.joints import JOINTS, limits
from creative_nao.runtime import python_command, python_environment

if TYPE_CHECKING:  # reading an upload needs no network
    from creative_nao.model import Memory

MAX_UPLOAD_BYTES = 4_000_000
MAX_TICKS = 2000
MAX_MOVEMENTS = 24
"""Of a file: the first so many are offered."""
LONGEST_TAKE_S = 12.0
"""A take in which no hand goes out and comes back is one movement if it is no longer than this [s]."""
READ_S = 30.0
"""How long reading an upload may take [s], most of which is starting the process on a busy machine."""
READ_CPU_S, READ_MEMORY_BYTES = 10, 4_000_000_000


def read_upload(name: str, content: bytes, dt_s: float, deadline_s: float = READ_S) -> list[Recording]:
    """Read the movements of an upload at a tick [s] in a process of its own; of its name only a known ending counts.

    A recording holds joint angles; motion capture of a body, BVH or landmarks, is cut where a hand goes out and comes
    back and brought to the robot's arms. What was converted is in the notes of each.

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
    if isinstance(answer, dict):
        kind = SettingsError if answer["kind"] == "SettingsError" else FileFormatError
        raise kind(answer["error"])
    return [
        Recording(Motion(np.array(one["angles"]), dt_s, JOINTS), one["format"], tuple(one["notes"]), one["place"])
        for one in answer
    ]


def _read(name: str, content: bytes, dt_s: float) -> list[dict[str, Any]]:
    if _is_take(content):
        return _from_body(name, content, dt_s)
    ending = PurePath(name).suffix.lower()
    known = any(ending in exchange_format.endings for exchange_format in FORMATS.values())
    source = Path(name if known else f"{name}.csv")
    found = []
    recordings = read_content(source, content, dt_s, JOINTS, reading=Reading(fill="guard"), beyond="refuse")
    for one in recordings[:MAX_MOVEMENTS]:
        n_ticks = len(one.motion.angles)
        if not 2 <= n_ticks <= MAX_TICKS:
            raise FileFormatError(
                f"{source}: a recording should have 2 to {MAX_TICKS} ticks of {dt_s} s, but has {n_ticks}"
            )
        inside = np.clip(one.motion.angles, *limits())
        beyond = np.abs(one.motion.angles - inside).max(axis=0)
        clipped = [f"{JOINTS[beyond.argmax()]} is {beyond.max():.3f} rad beyond its range and set to it"]
        notes = [*one.notes, *(clipped if beyond.max() > 1e-9 else [])]
        found.append({"angles": inside.tolist(), "format": one.format, "notes": notes, "place": one.place})
    return found


def _is_take(content: bytes) -> bool:
    """Tell whether an upload is a body's movement: a BVH skeleton, or a table whose columns are places."""
    head = content[:20_000].decode("utf-8", "replace").lstrip("\ufeff \t\r\n")
    cells = [cell.strip(' "') for line in head.splitlines()[:2] for cell in re.split("[,;\t]", line)]
    return head.startswith("HIERARCHY") or sum(bool(_is_place(cell)) for cell in cells) >= 6


_is_place = re.compile(r".*[A-Za-z0-9][ ._]?[XYZ]|.+[ ._][xyz]|[xyz][ ._]?\d+").fullmatch


def _from_body(name: str, content: bytes, dt_s: float) -> list[dict[str, Any]]:
    """Return what a person's hands did, as `creative-nao teach --from` brings it to the robot; physics is not asked."""
    from creative_nao.demonstrations.retargeting import from_motion
    from creative_nao.demonstrations.take import ProposedCut, load_take, propose_cuts

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / (PurePath(name).name or "take")
        path.write_bytes(content)
        try:
            take = load_take(path)
        except CreativeNaoError as error:
            raise FileFormatError(str(error).replace(f"{folder}{os.sep}", "")) from None
    length_s = (len(take.places) - 1) * take.dt_s
    cuts = propose_cuts(take) or [ProposedCut(0.0, length_s, "both", 0.0)]
    if cuts[0].arm == "both" and length_s > LONGEST_TAKE_S:
        raise FileFormatError(
            f"{name}: no hand goes out and comes back in its {length_s:.0f} s; `creative-nao teach --from` cuts it as "
            "you say"
        )
    found, left_out = [], []
    for cut in cuts[:MAX_MOVEMENTS]:
        place = f"{cut.arm} arm{'s' if cut.arm == 'both' else ''}, {cut.start_s:.2f} to {cut.end_s:.2f} s"
        try:
            (action,) = from_motion(take, {"cut": [(cut.start_s, cut.end_s)]})
            refused = action.refused
        except CreativeNaoError as error:
            action, refused = None, str(error)
        if action is None or refused:
            left_out.append(f"{place} is left out: {refused}")
            continue
        report = action.report
        notes = [
            *take.notes, f"a body's {place}, brought to the robot: upper arm {report['upper_arm_error_deg'][0]:.0f}, "
            f"forearm {report['forearm_error_deg'][0]:.0f} degrees beside the person's on average",
            f"faces {report['facing']}", "led from the guard and back to it",
            *([f"slowed down {report['stretch']:.2f} times for the motors"] if report["stretch"] > 1.005 else []),
            f"brought to a tick of {dt_s:g} s",
        ]  # fmt: skip
        angles = np.clip(resample(np.arange(len(action.angles)) * action.dt_s, action.angles, dt_s), *limits())
        found.append({"angles": angles.tolist(), "format": "body", "notes": notes, "place": place})
    if not found:
        raise FileFormatError(f"{name}: {left_out[0]}")
    found[0]["notes"] += left_out
    return found


def _limit() -> None:
    try:
        import resource
    except ImportError:  # Windows: the deadline is all there is
        return
    resource.setrlimit(resource.RLIMIT_CPU, (READ_CPU_S, READ_CPU_S))
    resource.setrlimit(resource.RLIMIT_AS, (READ_MEMORY_BYTES, READ_MEMORY_BYTES))
    resource.setrlimit(
        resource.RLIMIT_FSIZE, (2 * MAX_UPLOAD_BYTES, 2 * MAX_UPLOAD_BYTES)
    )  # a take is read from a file
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
