"""Rendering of performed movements: frames, films, depth and a window. MuJoCo is loaded at the first picture."""

# The bindings of MuJoCo have no static types.
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

import functools
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from creative_nao.envs.executors import FRAME_DT_S, Execution, SharedScene
from creative_nao.errors import MissingDependencyError, SettingsError

if TYPE_CHECKING:
    from creative_nao.robot.rendering import Renderer
    from creative_nao.robot.scene import Scene

CAMERA = "close"
FRAME_SIZE = 640, 480
"""Width and height of a frame in pixels."""
RENDER_MODES = ("human", "rgb_array", "rgb_array_list", "depth_array")
_BAR_COLOUR = (16, 18, 24)
_TEXT_COLOUR = (240, 240, 240)


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
    drawing.rectangle((0, height - bar, width, height), fill=_BAR_COLOUR)
    drawing.text((bar // 2, height - bar // 2), text, fill=_TEXT_COLOUR, font=_font(bar * 5 // 8), anchor="lm")
    return np.asarray(picture).copy()


class Viewer:
    """Draws snapshots of the robot in its ring, or plays them in a window.

    Args:
        scene: Where the robot stands.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._renderer: Renderer | None = None
        self._window: Any = None

    @property
    def renderer(self) -> Renderer:
        """What draws the frames, made when first needed.

        Raises:
            MissingDependencyError: If this machine cannot draw; the message names the packages.
        """
        if self._renderer is None:
            from creative_nao.robot.rendering import Renderer

            self._renderer = Renderer(self.scene.model, *FRAME_SIZE)
        return self._renderer

    def widest(self, frames: np.ndarray) -> np.ndarray:
        """Return the snapshot in which the arms are farthest from where they began: (n_frames, nq) into (nq,)."""
        arms = frames[:, self.scene.index.arm_qpos]
        return frames[int(np.linalg.norm(arms - arms[0], axis=1).argmax())]

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
        for part in (self._renderer, self._window):
            if part is not None:
                part.close()
        self._renderer = self._window = None


@dataclass(frozen=True)
class RecordedMovement:
    """Snapshots of one performed movement, (n_frames, nq), the time between them [s] and its caption."""

    frames: np.ndarray
    frame_dt_s: float
    text: str


class Recorder:
    """Keeps the movements performed since the last `render` of one or many environments, and renders them.

    Args:
        shared: Ring, robot and bag.
        mode: One of `RENDER_MODES` or None.
        overlay: Whether colour frames carry a caption: outcome, nearest basic action, reward.
        n_envs: How many environments.

    Raises:
        SettingsError: If there is no such mode.
    """

    def __init__(self, shared: SharedScene, mode: str | None, overlay: bool = False, n_envs: int = 1) -> None:
        if mode is not None and mode not in RENDER_MODES:
            raise SettingsError(f"`render_mode` should be one of {', '.join(RENDER_MODES)} or None, but is {mode!r}")
        self._shared, self.mode, self._overlay = shared, mode, overlay
        self._movements: list[list[RecordedMovement]] = [[] for _ in range(n_envs)]
        self._viewer: Viewer | None = None

    @property
    def active(self) -> bool:
        """Whether snapshots are needed of every movement."""
        return self.mode is not None

    def clear(self, env_id: int = 0) -> None:
        """Remove the recorded movements of an environment."""
        self._movements[env_id] = []

    def record(self, env_id: int, execution: Execution, text: str) -> None:
        """Keep the snapshots of a movement for `render`; `text` is its caption."""
        if execution.frames is None:
            return
        if self.mode in ("rgb_array", "depth_array"):
            self.clear(env_id)  # only the last movement is ever rendered
        self._movements[env_id].append(RecordedMovement(execution.frames, execution.frame_dt_s, text))

    def render(self, env_id: int = 0) -> Any:
        """Render what was recorded since the last call; the results are those of the environment's `render`."""
        if self.mode is None or (self.mode == "human" and not self._movements[env_id]):
            return None
        scene = self._shared.scene
        if self._viewer is None:
            self._viewer = Viewer(scene)
        viewer = self._viewer
        movements = self._movements[env_id] or [RecordedMovement(scene.guard_qpos()[None], FRAME_DT_S, "")]
        last = movements[-1]
        if self.mode == "depth_array":
            return viewer.renderer.depth(viewer.widest(last.frames), CAMERA)
        if self.mode == "rgb_array":
            return self._frame(viewer, viewer.widest(last.frames), last.text)
        self.clear(env_id)
        if self.mode == "human":
            for movement in movements:
                viewer.play(movement.frames, movement.frame_dt_s)
            return None
        return [self._frame(viewer, snapshot, one.text) for one in movements for snapshot in one.frames]

    def _frame(self, viewer: Viewer, snapshot: np.ndarray, text: str) -> np.ndarray:
        frame = viewer.renderer.frame(snapshot, CAMERA)
        return caption(frame, text) if self._overlay and text else frame

    def close(self) -> None:
        """Close the window and free what drawing took; may be called again."""
        if self._viewer is not None:
            self._viewer.close()
            self._viewer = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_viewer": None}  # windows and drawing contexts stay in their process
