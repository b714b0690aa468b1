"""Captions on frames, for those who want them: by default a frame is clean.

Also here:
- Show what was performed: single frames, films, a window. Everything is loaded at the first wish for a picture.
- What `render` shows: the movements since the last call, as a picture, a film, distances or in a window.
"""

from __future__ import annotations

import functools
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from creative_nao.envs.executors import FRAME_DT_S, Performed, SharedScene
from creative_nao.errors import MissingDependencyError, SettingsError

if TYPE_CHECKING:
    from creative_nao.robot.rendering import Renderer
    from creative_nao.robot.scene import Scene


_SHADE = (16, 18, 24)
_INK = (240, 240, 240)


@functools.cache
def _font(size: int) -> Any:
    from PIL import ImageFont

    return ImageFont.load_default(size)


def caption(frame: np.ndarray, text: str) -> np.ndarray:
    """Return a copy of a frame with a line of text on a dark bar at its lower edge.

    Args:
        frame: uint8 of shape (height, width, 3).
        text: The line.
    """
    from PIL import Image, ImageDraw

    if not text:
        return frame.copy()
    height, width = frame.shape[:2]
    bar = max(14, height // 16)
    picture = Image.fromarray(frame)
    drawing = ImageDraw.Draw(picture)
    drawing.rectangle((0, height - bar, width, height), fill=_SHADE)
    drawing.text((bar // 2, height - bar // 2), text, fill=_INK, font=_font(bar * 5 // 8), anchor="lm")
    return np.asarray(picture).copy()


# MuJoCo tells type checkers nothing about its members.
# pyright: reportAttributeAccessIssue=false


CAMERA = "close"


class Stage:
    """Draws snapshots of the robot in its ring.

    Args:
        scene: Where the robot stands.
        width: Width of a frame in pixels.
        height: Height of a frame in pixels.
    """

    def __init__(self, scene: Scene, width: int = 640, height: int = 480) -> None:
        self.scene = scene
        self._size = width, height
        self._renderer: Renderer | None = None
        self._window: Any = None

    def widest(self, frames: np.ndarray) -> np.ndarray:
        """Return the snapshot in which the arms are farthest from where they began: (n_frames, nq) into (nq,)."""
        arms = frames[:, self.scene.index.arm_qpos]
        return frames[int(np.linalg.norm(arms - arms[0], axis=1).argmax())]

    def draw(self, snapshot: np.ndarray) -> np.ndarray:
        """Draw one snapshot, (nq,), as uint8 of shape (height, width, 3).

        Raises:
            MissingDependencyError: If this machine cannot draw; the message names the packages.
        """
        return self._drawing().frame(snapshot, CAMERA)

    def depth(self, snapshot: np.ndarray) -> np.ndarray:
        """Measure how far away everything is in one snapshot [m], float32 of shape (height, width).

        Raises:
            MissingDependencyError: If this machine cannot draw; the message names the packages.
        """
        return self._drawing().depth(snapshot, CAMERA)

    def _drawing(self) -> Renderer:
        if self._renderer is None:
            from creative_nao.robot.rendering import Renderer

            self._renderer = Renderer(self.scene.model, *self._size)
        return self._renderer

    def play(self, frames: np.ndarray, frame_dt_s: float) -> None:
        """Play snapshots, (n_frames, nq), in a window at real speed; the window opens with the first.

        Raises:
            MissingDependencyError: If there is no display to open a window on.
        """
        import mujoco
        import mujoco.viewer

        if self._window is None:
            self._data = mujoco.MjData(self.scene.model)
            try:
                self._window = mujoco.viewer.launch_passive(
                    self.scene.model, self._data, show_left_ui=False, show_right_ui=False
                )
            except Exception as error:  # whatever the window system says
                raise MissingDependencyError(
                    f'render_mode="human" opens a window, which needs a display ({error}); '
                    'without one use "rgb_array" or "rgb_array_list"'
                ) from error
        for snapshot in frames:
            if not self._window.is_running():
                return
            began = time.monotonic()
            self._data.qpos[:] = snapshot
            mujoco.mj_forward(self.scene.model, self._data)
            self._window.sync()
            time.sleep(max(0.0, frame_dt_s - (time.monotonic() - began)))

    def close(self) -> None:
        """Close the window and free the drawing context; may be called again."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
        if self._window is not None:
            self._window.close()
            self._window = None


RENDER_MODES = ("human", "rgb_array", "rgb_array_list", "depth_array")


@dataclass(frozen=True)
class Take:
    """One performed movement on film."""

    frames: np.ndarray
    frame_dt_s: float
    text: str


class Screen:
    """Keeps the films of one or many robots and shows them.

    Args:
        shared: Ring, robot and bag.
        mode: One of `RENDER_MODES` or None.
        overlay: Whether colour frames tell outcome, nearest basic action and reward.
        n_robots: How many robots.

    Raises:
        SettingsError: If there is no such mode.
    """

    def __init__(self, shared: SharedScene, mode: str | None, overlay: bool = False, n_robots: int = 1) -> None:
        if mode is not None and mode not in RENDER_MODES:
            raise SettingsError(f"`render_mode` should be one of {', '.join(RENDER_MODES)} or None, but is {mode!r}")
        self._shared, self.mode, self._overlay = shared, mode, overlay
        self._films: list[list[Take]] = [[] for _ in range(n_robots)]
        self._stage: Stage | None = None

    @property
    def wanted(self) -> bool:
        """Whether movements have to be filmed."""
        return self.mode is not None

    def clear(self, robot: int = 0) -> None:
        """Forget the film of a robot."""
        self._films[robot] = []

    def remember(self, robot: int, performed: Performed, text: str) -> None:
        """Keep the snapshots of a performance for `show`."""
        if performed.frames is None:
            return
        if self.mode in ("rgb_array", "depth_array"):
            self._films[robot].clear()  # only the last movement is ever asked for
        self._films[robot].append(Take(performed.frames, performed.frame_dt_s, text))

    def show(self, robot: int = 0) -> Any:
        """Show the film of a robot since the last call, as the environment's `render` tells."""
        if self.mode is None or (self.mode == "human" and not self._films[robot]):
            return None
        if self._stage is None:
            self._stage = Stage(self._shared.scene)
        stage = self._stage
        film = self._films[robot] or [Take(self._shared.scene.guard_qpos()[None], FRAME_DT_S, "")]
        if self.mode in ("rgb_array", "depth_array"):
            widest = stage.widest(film[-1].frames)
            return stage.depth(widest) if self.mode == "depth_array" else self._drawn(stage, widest, film[-1].text)
        self._films[robot] = []
        if self.mode == "human":
            for take in film:
                stage.play(take.frames, take.frame_dt_s)
            return None
        return [self._drawn(stage, snapshot, take.text) for take in film for snapshot in take.frames]

    def _drawn(self, stage: Stage, snapshot: np.ndarray, text: str) -> np.ndarray:
        frame = stage.draw(snapshot)
        if not (self._overlay and text):
            return frame
        return caption(frame, text)

    def close(self) -> None:
        """Close the window and free what drawing took; may be called again."""
        if self._stage is not None:
            self._stage.close()
            self._stage = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_stage": None}  # windows and drawing contexts stay where they are
