"""Draw the robot without a display: frames as arrays, from any of the ring's cameras.

GL is loaded when the first frame is asked for, never before. The drawing context is made here rather than by MuJoCo's
own renderer, which can only use the back end that was chosen when MuJoCo was imported.
"""

# MuJoCo and PyMJCF tell type checkers nothing about their members.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false, reportMissingImports=false
from __future__ import annotations

import os
import sys
from types import TracebackType
from typing import Any

import mujoco
import numpy as np

from creative_nao.errors import MissingDependencyError, NotFoundError, SettingsError, nearest_name
from creative_nao.robot import headless
from creative_nao.robot.arena import CAMERAS

_MAX_GEOMS = 2000
_HOW_TO_DRAW = (
    "drawing needs off-screen OpenGL, which this machine cannot start: on Debian or Ubuntu run "
    "`apt-get install libegl1 libgl1-mesa-dri libopengl0` (or `libosmesa6` and set MUJOCO_GL=osmesa)"
)


class Renderer:
    """Draws states of one model into arrays; use it as a context manager, or call `close`.

    Shadows and smooth edges cost most of the time and are off unless asked for.

    Args:
        model: The compiled `mujoco.MjModel`, for instance `scene.model`.
        width: Width of a frame in pixels.
        height: Height of a frame in pixels.
        shadows: Draw shadows.
        smooth: Draw everything this many times larger and average (1 leaves edges as they are).

    Raises:
        SettingsError: If a size is not positive.
        MissingDependencyError: If off-screen OpenGL cannot be started; the message names the packages.
    """

    def __init__(
        self, model: Any, width: int = 640, height: int = 480, *, shadows: bool = False, smooth: int = 1
    ) -> None:
        if min(width, height, smooth) < 1:
            raise SettingsError(
                f"`width`, `height` and `smooth` should be at least 1, but are {width}, {height} and {smooth}."
            )
        self._model, self._smooth = model, smooth
        self._data = mujoco.MjData(model)
        self._scene = mujoco.MjvScene(model, _MAX_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        self._option = mujoco.MjvOption()
        self._rect = mujoco.MjrRect(0, 0, width * smooth, height * smooth)
        self._gl = _gl_context(width * smooth, height * smooth)
        self._gl.make_current()
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_resizeOffscreen(width * smooth, height * smooth, self._context)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)

    def frame(self, qpos: np.ndarray, camera: str = "close") -> np.ndarray:
        """Draw one state.

        Args:
            qpos: Positions of everything, shape (nq,), for instance a row of `Performance.frames`.
            camera: One of `arena.CAMERAS`.

        Returns:
            uint8 of shape (height, width, 3).

        Raises:
            NotFoundError: If there is no such camera.
        """
        if camera not in CAMERAS:
            raise NotFoundError(
                f"no camera `{camera}`{nearest_name(camera, CAMERAS)}; the known ones are {', '.join(CAMERAS)}."
            )
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        view = mujoco.MjvCamera()
        view.type = mujoco.mjtCamera.mjCAMERA_FIXED
        view.fixedcamid = mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_CAMERA, camera)
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, self._data, self._option, None, view, everything, self._scene)
        self._gl.make_current()
        mujoco.mjr_render(self._rect, self._scene, self._context)
        pixels = np.empty((self._rect.height, self._rect.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._rect, self._context)
        return self._averaged(pixels[::-1])

    def _averaged(self, pixels: np.ndarray) -> np.ndarray:
        if self._smooth == 1:
            return np.ascontiguousarray(pixels)
        n = self._smooth
        height, width = pixels.shape[0] // n, pixels.shape[1] // n
        return pixels.reshape(height, n, width, n, 3).mean(axis=(1, 3)).round().astype(np.uint8)

    def close(self) -> None:
        """Free the drawing context; do so before the program ends, or GL complains at exit."""
        if self._gl is not None:
            self._gl.make_current()
            self._context.free()
            self._gl.free()
            self._gl = None

    def __enter__(self) -> Renderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def can_draw() -> bool:
    """Tell whether frames can be drawn on this machine."""
    try:
        _gl_context(16, 16).free()
    except MissingDependencyError:
        return False
    return True


def _gl_context(width: int, height: int) -> Any:
    """Start off-screen GL with the back end of MUJOCO_GL, or the first that works."""
    backend = os.environ.get("MUJOCO_GL", "").lower()
    if backend in ("", "disable", "disabled", "off", "false", "0"):
        backend = headless.working_backend() if sys.platform.startswith("linux") else "glfw"
    try:
        if backend == "egl":
            from mujoco.egl import GLContext
        elif backend == "osmesa":
            from mujoco.osmesa import GLContext
        elif backend == "glfw":
            from mujoco.glfw import GLContext
        else:
            raise RuntimeError(f"no back end `{backend}`")
        return GLContext(width, height)
    except Exception as error:  # each back end fails in its own way, down to missing C symbols
        raise MissingDependencyError(f"{_HOW_TO_DRAW} (MUJOCO_GL={backend}: {error}).") from error
