"""Show what was performed: single frames, films, a window. Everything is loaded at the first wish for a picture."""

# MuJoCo tells type checkers nothing about its members.
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from creative_nao.errors import MissingDependencyError

if TYPE_CHECKING:
    from creative_nao.robot.rendering import Renderer
    from creative_nao.robot.scene import Scene

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
