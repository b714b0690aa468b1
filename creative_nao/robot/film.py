"""Films of a performance, or of a trajectory without physics: film strips (PNG) and animations (GIF, MP4)."""

from __future__ import annotations

import importlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from creative_nao import storage
from creative_nao.errors import MissingDependencyError, SettingsError, ShapeError
from creative_nao.joints import JOINTS, joint_angles
from creative_nao.robot import interpolation
from creative_nao.robot.rendering import Renderer
from creative_nao.robot.scene import Scene
from creative_nao.schema import Count, Field, Positive, checked

_GAP_PX = 4
_PALETTE_SAMPLES = 4
_QUALITY = 7  # of an MP4, of 10; about 60 KiB a second at 640 x 480


def imagined_frames(scene: Scene, trajectory: np.ndarray, dt_s: float, *, frame_dt_s: float = 0.05) -> np.ndarray:
    """Return `qpos` snapshots, (n_frames, nq), of a trajectory without physics: only the arms move, exactly along it.

    Args:
        scene: Where the robot stands.
        trajectory: Joint angles [rad], shape (n_steps, 8), columns in the order of `joints.JOINTS`.
        dt_s: Time between rows [s].
        frame_dt_s: Wanted time between snapshots [s]; rounded so that ticks are among them.
    """
    trajectory = joint_angles(trajectory, "trajectory", JOINTS)
    dt_s, frame_dt_s = checked(Positive, dt_s, "dt_s"), checked(Positive, frame_dt_s, "frame_dt_s")
    arms = interpolation.refine(trajectory, dt_s, max(1, round(dt_s / frame_dt_s)))
    frames = np.repeat(scene.guard_qpos()[None], len(arms), axis=0)
    frames[:, scene.index.arm_qpos] = arms
    return frames


def moments(frames: np.ndarray, n_moments: int) -> np.ndarray:
    """Return `n_moments` of the frames, evenly spaced, with the first and the last among them."""
    rows = np.linspace(0, len(frames) - 1, checked(Count, n_moments, "n_moments")).round().astype(int)
    return frames[rows]


def pictures(
    scene: Scene,
    frames: np.ndarray,
    *,
    camera: str = "side",
    width: int = 480,
    height: int = 480,
    shadows: bool = False,
    smooth: int = 1,
) -> list[np.ndarray]:
    """Draw snapshots, each as uint8 of shape (height, width, 3); errors are those of `Renderer`."""
    with Renderer(scene.model, width, height, shadows=shadows, smooth=smooth) as renderer:
        return [renderer.frame(qpos, camera) for qpos in frames]


def film_strip(images: Sequence[np.ndarray], path: str | os.PathLike[str]) -> Path:
    """Write pictures side by side into one PNG, earliest at the left, and return its path."""
    from PIL import Image

    _check(images)
    gap = np.full((len(images[0]), _GAP_PX, 3), 255, dtype=np.uint8)
    strip = np.concatenate([part for image in images for part in (gap, image)][1:], axis=1)
    with storage.replacing(path) as temporary:
        Image.fromarray(strip).save(temporary, format="PNG")
    return Path(path)


def write_gif(images: Sequence[np.ndarray], path: str | os.PathLike[str], *, frame_dt_s: float) -> Path:
    """Write pictures as an endless GIF and return its path; GIF knows steps of 10 ms only."""
    from PIL import Image

    _check(images)
    checked(Annotated[float, Field(ge=0.02)], frame_dt_s, "frame_dt_s")  # the shortest that viewers keep
    # One palette for all pictures, made from a sample of them: with one each, the background flickers.
    sample = np.concatenate(moments(np.stack(images), min(len(images), _PALETTE_SAMPLES)))
    # The one colour left over stands for pixels that stay as they are, which halves the file.
    palette = Image.fromarray(sample).quantize(colors=255, method=Image.Quantize.MEDIANCUT)
    first, *rest = [Image.fromarray(image).quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    with storage.replacing(path) as temporary:
        first.save(
            temporary, format="GIF", save_all=True, append_images=rest, duration=round(frame_dt_s * 1000), loop=0,
            optimize=True, disposal=1,
        )  # fmt: skip
    return Path(path)


def ffmpeg() -> Any:
    """Return the module of the optional package that writes MP4; without it MissingDependencyError is raised."""
    try:
        return importlib.import_module("imageio_ffmpeg")
    except ImportError as error:
        raise MissingDependencyError(
            "an MP4 needs imageio-ffmpeg (the extra `video`): run `pip install imageio-ffmpeg`, "
            "or write a GIF (`robot.write_gif`), which needs nothing."
        ) from error


def check_even(width: int, height: int) -> None:
    """Refuse pictures that no MP4 can hold."""
    if width % 2 or height % 2:
        raise SettingsError(f"width and height of an MP4 should be even, but are {width} and {height}.")


def write_mp4(images: Sequence[np.ndarray], path: str | os.PathLike[str], *, frame_dt_s: float) -> Path:
    """Write pictures of even width and height as an MP4 and return its path; it needs the extra `video`."""
    _check(images)
    height, width = images[0].shape[:2]
    check_even(width, height)
    fps = 1 / checked(Positive, frame_dt_s, "frame_dt_s")
    with storage.replacing(path) as temporary:
        film = ffmpeg().write_frames(
            str(temporary), (width, height), fps=fps, codec="libx264", quality=_QUALITY, macro_block_size=2
        )
        try:
            film.send(None)
            for image in images:
                film.send(np.ascontiguousarray(image))
        finally:
            film.close()
    return Path(path)


def _check(images: Sequence[np.ndarray]) -> None:
    if len(images) == 0:
        raise ShapeError("`images` should hold at least one picture, but is empty.")
    shapes = {image.shape for image in images}
    if len(shapes) > 1 or images[0].ndim != 3 or images[0].shape[2] != 3:
        raise ShapeError(f"`images` should be pictures of one size, (height, width, 3), but are {sorted(shapes)}.")
