"""`creative-nao export`: a movement for a robot, another simulator, another program, or as a film."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro

from creative_nao import exchange, runtime, storage
from creative_nao.cli.terminal import Display, print_result
from creative_nao.errors import SettingsError
from creative_nao.exchange import NOTHING_SAID, Exported, Motion, Reading, Recording, Unsafe, made_safe
from creative_nao.joints import JOINTS

FILM_ENDINGS = {"gif": (".gif",), "mp4": (".mp4",)}
"""Ending of each kind of film."""


def _film(settings: ExportSettings, motion: Motion, format: str) -> Exported:
    """Check a movement, let the robot perform it in the simulator, draw it and write the film in one step."""
    from creative_nao.robot import film

    path = settings.out
    if path.suffix.lower() not in FILM_ENDINGS[format]:
        raise SettingsError(f"a film of the format {format} should end in {FILM_ENDINGS[format][0]}, but is {path}.")
    if format == "mp4":
        film.ffmpeg()  # before minutes of drawing
        film.check_even(settings.width, settings.height)
    if motion.joints != JOINTS:
        raise SettingsError(f"the simulated robot performs {', '.join(JOINTS)}; this movement has other joints.")
    safe, changes = made_safe(motion, settings.unsafe)
    snapshots, frame_dt_s, notes = _snapshots(safe, settings.imagined)
    images = _drawn(snapshots, settings)
    write = film.write_gif if format == "gif" else film.write_mp4
    write(images, path, frame_dt_s=frame_dt_s)
    record = None
    if safe.metadata:
        record = path.with_name(path.name + ".record.json")
        storage.write_text(record, json.dumps(safe.metadata, indent=2) + "\n")
    notes.append(f"{len(images)} frames, {1 / frame_dt_s:.3g} a second")
    return Exported(path, format, safe, tuple(changes), tuple(notes), record)


def _snapshots(motion: Motion, imagined: bool) -> tuple[np.ndarray, float, list[str]]:
    """Return the robot's positions for each frame, the time between frames, and what physics had to say."""
    from creative_nao.robot import Performer, Scene, first_failure, imagined_frames

    scene = Scene()
    if imagined:
        frames = imagined_frames(scene, motion.angles, motion.dt_s)
        n_between = max(1, (len(frames) - 1) // max(1, len(motion.angles) - 1))
        return frames, motion.dt_s / n_between, ["imagined: the arms follow exactly, without physics"]
    performance = Performer(scene).perform(motion.angles, motion.dt_s, keep_frames=True)
    assert performance.frames is not None
    failure = first_failure(performance)
    notes = ["performed by the simulated robot"]
    if failure is not None:
        notes.append(f"the body did not do what was asked: {failure}")
    return performance.frames, performance.frame_dt_s, notes


def _drawn(snapshots: np.ndarray, settings: ExportSettings) -> list[np.ndarray]:
    from creative_nao.robot import Renderer, Scene

    images, model = [], Scene().model
    with Renderer(model, settings.width, settings.height) as renderer, Display({"frames": len(snapshots)}) as display:
        for qpos in snapshots:
            images.append(renderer.frame(qpos, settings.camera))
            display.show("frames", len(images))
    return images


Format = Literal["csv", "npz", "naoqi", "json", "ros", "webots", "bvh", "gif", "mp4"]


@dataclass(frozen=True)
class ExportSettings:
    """Write one movement to a file: from a PB value, a basic action, or a recording in any known format.

    Every movement is checked against the ranges and speeds of the robot's joints first.
    """

    out: Path
    """File to write; its ending tells the format, see --format."""
    memory: tyro.conf.Positional[str] = "half/0"
    """Shipped name, such as half/0, or a memory file."""
    pb: tuple[float, ...] | None = None
    """PB value in [-1, 1] from which the memory generates the movement; one number for each PB unit."""
    action: str | None = None
    """Basic action of the memory, such as left_jab, as it was taught."""
    csv: Path | None = None
    """CSV file with the header time_s,RShoulderPitch,... to take the movement from."""
    from_: Annotated[Path | None, tyro.conf.arg(name="from")] = None
    """File of any known format to take the movement from; the format is recognised. Of several movements in it each
    gets a file of its own, numbered from 1."""
    format: Format | None = None
    """csv, npz, naoqi (.py), json, ros (.yaml, .json), webots (.motion), bvh, gif or mp4; default: by the ending."""
    unsafe: Unsafe = "refuse"
    """What to do beyond the joints' ranges and speeds: clip keeps angles within and slows down; keep is for data."""
    n_steps: int | None = None
    """Ticks to generate with --pb; default: as long as the longest basic action."""
    dt_s: float | None = None
    """Tick to bring a recording to [s]; default: its own if its postures are evenly spaced, else 0.15."""
    imagined: bool = False
    """For a film: the arms follow exactly; without it the simulated robot performs the movement."""
    camera: Literal["close", "ringside", "side", "left"] = "close"
    """For a film: where to look from."""
    width: int = 480
    """For a film: width in pixels."""
    height: int = 360
    """For a film: height in pixels."""
    json: bool = False
    """Print what was written as JSON; a list where there are several files."""
    reading: Annotated[Reading, tyro.conf.OmitArgPrefixes] = NOTHING_SAID
    """What a recording does not say about itself."""


def run(settings: ExportSettings) -> int:
    """Find the movement, write the file, say what was changed for safety."""
    films = (name for name, endings in FILM_ENDINGS.items() if settings.out.suffix.lower() in endings)
    format = settings.format or next(films, None) or exchange.format_for(settings.out)
    movements = _movements(settings)
    figures, lines = [], list[str]()
    for number, (motion, notes) in enumerate(movements, start=1):
        out = settings.out
        if len(movements) > 1:
            out = out.with_name(f"{out.stem}-{number}{out.suffix}")
        one, told = _written(dataclasses.replace(settings, out=out), motion, notes, format)
        figures.append(one)
        lines += told
    print_result(figures if len(figures) > 1 else figures[0], lines, as_json=settings.json)
    return 0


def _written(
    settings: ExportSettings, motion: Motion, notes: list[str], format: str
) -> tuple[dict[str, Any], list[str]]:
    """Write one movement; return what was written, and in words."""
    if format in FILM_ENDINGS:
        done = _film(settings, motion, format)
    else:
        done = exchange.write(settings.out, motion, format, unsafe=settings.unsafe)
    notes = [*notes, *done.notes]
    figures = {
        "out": str(done.path),
        "format": done.format,
        "source": done.motion.metadata.get("source"),
        "n_steps": len(done.motion.angles),
        "dt_s": done.motion.dt_s,
        "duration_s": round(done.motion.duration_s, 9),
        "changes": list(done.changes),
        "notes": notes,
        "record": None if done.record is None else str(done.record),
    }
    lines = [
        f"{done.path}: {done.format}, {figures['source']}, {figures['n_steps']} postures, "
        f"{done.motion.duration_s:.2f} s"
    ]
    lines += [f"  {sentence}" for sentence in (*done.changes, *notes)]
    if done.record is not None:
        lines.append(f"  source, command and versions: {done.record}")
    return figures, lines


def _movements(settings: ExportSettings) -> list[tuple[Motion, list[str]]]:
    """Return the movements that were asked for, each with what was recognised in its file."""
    given = [name for name in ("pb", "action", "csv", "from_") if getattr(settings, name) is not None]
    if len(given) != 1:
        told = " and ".join(f"--{name.rstrip('_')}" for name in given) or "none of them"
        raise SettingsError(f"export: give one of --pb, --action, --csv and --from, but there is {told}")
    if settings.n_steps is not None and settings.pb is None:
        what = "a basic action" if settings.action is not None else "a recording"
        raise SettingsError(f"export: --n-steps is for --pb; {what} has its own length")
    metadata = {"command": runtime.command_line(), "versions": runtime.versions()}
    file = settings.csv or settings.from_
    if file is not None:
        format = "csv" if settings.csv else None
        found = exchange.read_all(file, settings.dt_s, format=format, reading=settings.reading)
        return [_recorded(one, file, metadata, len(found)) for one in found]
    if settings.dt_s is not None:
        raise SettingsError("export: --dt-s is for --csv and --from; a memory has its own tick")
    from creative_nao.model import load_memory

    memory = load_memory(settings.memory)
    source = {"memory": settings.memory}
    if settings.action is not None:
        angles = memory.demonstrations.trajectory(settings.action)
        source |= {"source": f"basic action {settings.action} of memory {settings.memory}", "action": settings.action}
    else:
        assert settings.pb is not None
        angles = memory.generate(np.array([settings.pb]), settings.n_steps)[0]
        source |= {"source": f"memory {settings.memory} at PB {list(settings.pb)}", "pb": list(settings.pb)}
    return [(Motion(angles, memory.dt_s, memory.joints, source | metadata), [])]


def _recorded(read: Recording, file: Path, metadata: dict[str, Any], n_found: int) -> tuple[Motion, list[str]]:
    place = f", {read.place}" if n_found > 1 else ""
    beside = {"source": f"recording {file.name}{place}", "recording": read.motion.metadata}
    if read.notes:
        beside["notes"] = list(read.notes)
    return dataclasses.replace(read.motion, metadata=beside | metadata), list(read.notes)
