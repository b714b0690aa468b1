"""A movement as a film: performed by the simulated robot, or only imagined, as GIF or MP4.

Films are made here, since the exporters of `exchange` know no robot.
"""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao import atomic
from creative_nao.cli.progress import Display
from creative_nao.errors import MissingDependencyError, SettingsError
from creative_nao.exchange import Exported, Motion, Unsafe, made_safe
from creative_nao.joints import JOINTS

FILM_ENDINGS = {"gif": (".gif",), "mp4": (".mp4",)}
"""Ending of each kind of film."""

_QUALITY = 7
"""Of 10; about 60 KiB a second at 640 x 480."""


def export_film(
    path: Path,
    motion: Motion,
    format: str,
    *,
    unsafe: Unsafe = "refuse",
    imagined: bool = False,
    camera: str = "close",
    width: int = 480,
    height: int = 360,
) -> Exported:
    """Check a movement, let the robot perform it in the simulator, draw it and write the film in one step.

    Args:
        path: The file.
        motion: The movement, of the eight arm joints in the order of `joints.JOINTS`.
        format: `gif` or `mp4`.
        unsafe: As in `exchange.write`.
        imagined: Let the arms follow exactly, without physics.
        camera: One of the ring's cameras.
        width: Width in pixels; even for MP4.
        height: Height in pixels; even for MP4.

    Raises:
        UnsafeMotionError: If the movement is unsafe and may not be changed.
        MissingDependencyError: If MP4 is asked for without imageio-ffmpeg.
        SettingsError: If joints, size or tick cannot be filmed.
        NotFoundError: If there is no such camera.
    """
    if path.suffix.lower() not in FILM_ENDINGS[format]:
        raise SettingsError(f"a film of the format {format} should end in {FILM_ENDINGS[format][0]}, but is {path}.")
    if format == "mp4":
        _ffmpeg()  # before minutes of drawing
        if width % 2 or height % 2:
            raise SettingsError(f"width and height of an MP4 should be even, but are {width} and {height}.")
    if motion.joints != JOINTS:
        raise SettingsError(f"the simulated robot performs {', '.join(JOINTS)}; this movement has other joints.")
    safe, changes = made_safe(motion, unsafe)
    snapshots, frame_dt_s, notes = _snapshots(safe, imagined)
    images = _drawn(snapshots, camera, width, height)
    if format == "gif":
        from creative_nao.robot import write_gif

        write_gif(images, path, frame_dt_s=frame_dt_s)
    else:
        _write_mp4(images, path, frame_dt_s)
    record = None
    if safe.metadata:
        record = path.with_name(path.name + ".record.json")
        atomic.write_text(record, json.dumps(safe.metadata, indent=2) + "\n")
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


def _drawn(snapshots: np.ndarray, camera: str, width: int, height: int) -> list[np.ndarray]:
    from creative_nao.robot import Renderer, Scene

    images = []
    with Renderer(Scene().model, width, height) as renderer, Display({"frames": len(snapshots)}) as display:
        for qpos in snapshots:
            images.append(renderer.frame(qpos, camera))
            display.show("frames", len(images))
    return images


def _ffmpeg() -> Any:
    """Return the module of the optional package."""
    try:
        return importlib.import_module("imageio_ffmpeg")
    except ImportError as error:
        raise MissingDependencyError(
            "an MP4 needs imageio-ffmpeg (the extra `video`): run `pip install imageio-ffmpeg`, "
            "or export a GIF, which needs nothing."
        ) from error


def _write_mp4(images: list[np.ndarray], path: Path, frame_dt_s: float) -> None:
    height, width = images[0].shape[:2]
    with atomic.replacing(path) as temporary:
        film = _ffmpeg().write_frames(
            str(temporary), (width, height), fps=1 / frame_dt_s, codec="libx264", quality=_QUALITY, macro_block_size=2
        )
        try:
            film.send(None)
            for image in images:
                film.send(np.ascontiguousarray(image))
        finally:
            film.close()
