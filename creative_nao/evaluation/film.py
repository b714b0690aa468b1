"""The best finds of an episode as film strips: the robot as the memory imagines it, a row a movement."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from creative_nao.errors import MissingDependencyError, NotFoundError
from creative_nao.evaluation.drawing import figure
from creative_nao.evaluation.palette import agent_label
from creative_nao.evaluation.protocol import Episode
from creative_nao.joints import JOINTS
from creative_nao.model import Memory, load_memory

if TYPE_CHECKING:
    from creative_nao.robot.scene import Scene

N_ROWS = 4
"""Finds that are shown: those that earned most."""
TICKS = (0, 3, 5, 7, 9, 11, 13, 16)
"""Ticks that are drawn, the first punch or what stands in its place: a movement repeats itself after it."""
SIZE_PX = (170, 190)
CAMERA = "close"


def memory_of(name: str, folder: Path) -> Memory | None:
    """Return a memory of a suite, from the run folder if it was trained there; None if it is no NAO's."""
    own = folder / "memories" / f"{name.replace('/', '-')}.safetensors"
    try:
        memory = load_memory(own if own.is_file() else name)
    except NotFoundError:
        return None
    return memory if tuple(memory.demonstrations.joints) == tuple(JOINTS) else None


def film(memory: Memory, episode: Episode) -> Figure | None:
    """Draw the finds of an episode that earned most.

    Args:
        memory: The memory that was searched; its joints are those of NAO.
        episode: What was found.

    Returns:
        The figure; None where this machine cannot draw the robot, or nothing was found.
    """
    best = sorted((action for action in episode.actions if action.appropriate), key=lambda action: -action.reward)
    if not best:
        return None
    best = best[:N_ROWS]
    moves = memory.generate(np.array([[action.pb_1, action.pb_2] for action in best]))
    try:
        strips = [_strip(move, float(memory.demonstrations.dt_s)) for move in moves]
    except MissingDependencyError:
        return None
    drawn, axes = figure(8.6, 1.42 * len(best) + 0.3, len(best), 1)
    for ax, strip, action in zip(axes, strips, best, strict=True):
        ax.imshow(strip, interpolation="lanczos")
        ax.set_title(
            f"action {action.step} of {agent_label(episode.agent)}: reward {action.reward:.2f}, most like "
            f"{action.nearest.replace('_', ' ')}, {action.distance:.0f} rad from it",
            fontsize=9.0,
            fontweight="normal",
        )
        ax.set_axis_off()
    return drawn


def _strip(move: np.ndarray, dt_s: float) -> np.ndarray:
    """Return the drawn ticks of a movement side by side, uint8 of shape (height, width, 3)."""
    from creative_nao.robot.film import imagined_frames, pictures  # loads MuJoCo

    frames = imagined_frames(_scene(), move, dt_s, frame_dt_s=dt_s)
    chosen = frames[[min(tick, len(frames) - 1) for tick in TICKS]]
    width, height = SIZE_PX
    images = pictures(_scene(), chosen, camera=CAMERA, width=width, height=height)
    gap = np.full((height, 4, 3), 255, dtype=np.uint8)
    pieces = [piece for image in images for piece in (image, gap)]
    return np.concatenate(pieces[:-1], axis=1)


@functools.cache
def _scene() -> Scene:
    from creative_nao.robot.scene import Scene

    return Scene(with_bag=False)  # it would hide an arm
