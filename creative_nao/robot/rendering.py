"""Draw the robot without a display: frames as arrays, from any of the ring's cameras.

GL is loaded when the first frame is asked for, never before. The drawing context is made here rather than by MuJoCo's
own renderer, which can only use the back end that was chosen when MuJoCo was imported. Where no GL starts, frames are
drawn in software (`software_rendering.py`): slower, without shadows, but they are drawn.
"""

# MuJoCo and PyMJCF tell type checkers nothing about their members.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false, reportMissingImports=false
from __future__ import annotations

import os
import sys
import warnings
from types import TracebackType
from typing import Any, Literal

import mujoco
import numpy as np

from creative_nao.errors import MissingDependencyError, NotFoundError, SettingsError, nearest_name
from creative_nao.robot import headless
from creative_nao.robot.arena import CAMERAS
from creative_nao.robot.software_rendering import SoftwareCanvas

Backend = Literal["auto", "gl", "software"]

_MAX_GEOMS = 2000
_BACKENDS = ("auto", "gl", "software")
_HOW_TO_DRAW = (
    "drawing needs off-screen OpenGL, which this machine cannot start: on Debian or Ubuntu run "
    "`apt-get install libegl1 libgl1-mesa-dri libopengl0` (or `libosmesa6` and set MUJOCO_GL=osmesa)"
)


class Renderer:
    """Draws states of one model into arrays; use it as a context manager, or call `close`.

    Shadows and smooth edges cost most of the time and are off unless asked for. With MUJOCO_GL=disable, or where no
    off-screen OpenGL can be started, frames are drawn in software; the latter is said once, in a RuntimeWarning.

    Args:
        model: The compiled `mujoco.MjModel`, for instance `scene.model`.
        width: Width of a frame in pixels.
        height: Height of a frame in pixels.
        shadows: Draw shadows; software has none.
        smooth: Draw everything this many times larger and average (1 leaves edges as they are).
        backend: `auto`, or insist on `gl` or `software`.

    Attributes:
        software: Whether frames are drawn in software.

    Raises:
        SettingsError: If a size is not positive or there is no such back end.
        MissingDependencyError: If `gl` is insisted on, or MUJOCO_GL names no known back end, and off-screen OpenGL
            cannot be started; the message names the packages.
    """

    def __init__(
        self,
        model: Any,
        width: int = 640,
        height: int = 480,
        *,
        shadows: bool = False,
        smooth: int = 1,
        backend: Backend = "auto",
    ) -> None:
        if min(width, height, smooth) < 1:
            raise SettingsError(
                f"`width`, `height` and `smooth` should be at least 1, but are {width}, {height} and {smooth}."
            )
        if backend not in _BACKENDS:
            raise SettingsError(f"`backend` should be one of {', '.join(_BACKENDS)}, but is {backend!r}.")
        self._model, self._smooth = model, smooth
        self._data = mujoco.MjData(model)
        self._scene = mujoco.MjvScene(model, _MAX_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        self._option = mujoco.MjvOption()
        self._canvas: _GLCanvas | SoftwareCanvas | None
        self._canvas = _canvas(model, width * smooth, height * smooth, backend)
        self.software = isinstance(self._canvas, SoftwareCanvas)
        if isinstance(self._canvas, _GLCanvas):
            self._rect, self._gl, self._context = self._canvas.rect, self._canvas.gl, self._canvas.context

    def frame(self, qpos: np.ndarray, camera: str = "close") -> np.ndarray:
        """Draw one state.

        Args:
            qpos: Positions of everything, shape (nq,), for instance a row of `Performance.frames`.
            camera: One of `arena.CAMERAS`.

        Returns:
            uint8 of shape (height, width, 3).

        Raises:
            NotFoundError: If there is no such camera.
            SettingsError: If the renderer is closed.
        """
        if self._canvas is None:
            raise SettingsError("this renderer is closed; make a new one.")
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
        return self._averaged(self._canvas.draw(self._scene))

    def depth(self, qpos: np.ndarray, camera: str = "close") -> np.ndarray:
        """Measure one state: how far what each pixel shows is from the camera's plane [m], float32, (height, width).

        Arguments and errors are those of `frame`.
        """
        self.frame(qpos, camera)
        assert self._canvas is not None
        return self._canvas.depth()[:: self._smooth, :: self._smooth].astype(np.float32)

    def _averaged(self, pixels: np.ndarray) -> np.ndarray:
        if self._smooth == 1:
            return np.ascontiguousarray(pixels)
        n = self._smooth
        height, width = pixels.shape[0] // n, pixels.shape[1] // n
        return pixels.reshape(height, n, width, n, 3).mean(axis=(1, 3)).round().astype(np.uint8)

    def close(self) -> None:
        """Free the drawing context; do so before the program ends, or GL complains at exit."""
        if isinstance(self._canvas, _GLCanvas):
            self._canvas.close()
        self._canvas = None

    def __enter__(self) -> Renderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class _GLCanvas:
    """Draws prepared scenes of one model with off-screen OpenGL."""

    def __init__(self, model: Any, width: int, height: int) -> None:
        self.rect = mujoco.MjrRect(0, 0, width, height)
        self.gl = _gl_context(width, height)
        self.gl.make_current()
        self.context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        self.context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR  # keeps what is far apart in float32
        mujoco.mjr_resizeOffscreen(width, height, self.context)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self.context)
        self._near, self._far = (
            float(plane) * model.stat.extent for plane in (model.vis.map.znear, model.vis.map.zfar)
        )

    def draw(self, scene: Any) -> np.ndarray:
        self.gl.make_current()
        mujoco.mjr_render(self.rect, scene, self.context)
        pixels = np.empty((self.rect.height, self.rect.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(pixels, None, self.rect, self.context)
        return pixels[::-1]

    def depth(self) -> np.ndarray:
        """Return the distance of what was drawn last from the camera's plane [m], (height, width)."""
        self.gl.make_current()
        raw = np.empty((self.rect.height, self.rect.width), np.float32)
        mujoco.mjr_readPixels(None, raw, self.rect, self.context)
        # As read here the buffer is 1 at the near plane and 0 at the far one.
        return self._near * self._far / (self._near + raw[::-1].astype(np.float64) * (self._far - self._near))

    def close(self) -> None:
        self.gl.make_current()
        self.context.free()
        self.gl.free()


def _canvas(model: Any, width: int, height: int, backend: Backend) -> _GLCanvas | SoftwareCanvas:
    """Open the back end asked for, or the best there is."""
    if backend == "gl":
        return _GLCanvas(model, width, height)
    chosen = os.environ.get("MUJOCO_GL", "").lower()
    if backend == "software" or (chosen in headless.OFF and not headless.nothing_found):
        return SoftwareCanvas(model, width, height)
    try:
        return _GLCanvas(model, width, height)
    except (MissingDependencyError, mujoco.FatalError) as error:
        if chosen not in (*headless.OFF, *headless.ON, ""):
            raise
        _warn_once(f"frames are drawn in software, slowly and without shadows: {error}")
        return SoftwareCanvas(model, width, height)


def _warn_once(message: str) -> None:
    global _warned
    if not _warned:
        _warned = True
        warnings.warn(message, RuntimeWarning, stacklevel=4)


_warned = False


def can_draw() -> bool:
    """Tell whether off-screen OpenGL works on this machine; without it frames are drawn in software."""
    try:
        _gl_context(16, 16).free()
    except MissingDependencyError:
        return False
    return True


def _gl_context(width: int, height: int) -> Any:
    """Start off-screen GL with the back end of MUJOCO_GL, or the first that works."""
    backend = os.environ.get("MUJOCO_GL", "").lower()
    if backend in ("", *headless.OFF):
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
