"""Draw the robot without a display: frames as arrays, from any camera of the model.

MuJoCo is loaded here only where something is drawn. The drawing context is made by `opengl` rather than by MuJoCo's own
renderer, which can only use the back end that was chosen at its import. Where no OpenGL starts, frames are drawn in
software: slower, without shadows.
"""

# The bindings of MuJoCo have no static types.
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

import os
import warnings
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from creative_nao.errors import MissingDependencyError, NotFoundError, SettingsError, nearest_name
from creative_nao.robot import opengl

if TYPE_CHECKING:
    from creative_nao.robot.software_rendering import SoftwareCanvas

Backend = Literal["auto", "gl", "software"]

_MAX_GEOMS = 2000
_BACKENDS = ("auto", "gl", "software")
_warned = False


def can_draw() -> bool:
    """Tell whether off-screen OpenGL works on this machine; without it frames are drawn in software."""
    try:
        opengl.start(16, 16).free()
    except MissingDependencyError:
        return False
    return True


class Renderer:
    """Draws states of one model into arrays; use it as a context manager, or call `close`.

    Shadows and smooth edges cost most of the time and are off unless asked for. With MUJOCO_GL=disable, or where no
    off-screen OpenGL can be started, frames are drawn in software, which the attribute `software` tells; the latter is
    said once, in a RuntimeWarning. So it is in a process that was forked after its parent had drawn. Any thread may
    draw.

    Args:
        model: The compiled `mujoco.MjModel`, for instance `scene.model`.
        width: Width of a frame in pixels.
        height: Height of a frame in pixels.
        shadows: Draw shadows; software has none.
        smooth: Draw everything this many times larger and average (1 leaves edges as they are).
        backend: `auto`, or insist on `gl` or `software`.

    Raises:
        SettingsError: If a size is not positive or there is no such back end.
        MissingDependencyError: If `gl` is insisted on and off-screen OpenGL cannot be started; the message names the
            packages.
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
        import mujoco

        from creative_nao.schema import Count, checked

        width, height = checked(Count, width, "width"), checked(Count, height, "height")
        self._smooth = checked(Count, smooth, "smooth")
        if backend not in _BACKENDS:
            raise SettingsError(f"`backend` should be one of {', '.join(_BACKENDS)}, but is {backend!r}.")
        self._model, self._data = model, mujoco.MjData(model)
        self._cameras = [model.camera(number).name for number in range(model.ncam)]
        self._size, self._shadows, self._backend = (width * smooth, height * smooth), shadows, backend
        self._canvas = self._start()

    def _start(self) -> _GLCanvas | SoftwareCanvas:
        """Make what draws in this process."""
        import mujoco

        from creative_nao.robot.software_rendering import SoftwareCanvas

        self._pid = os.getpid()
        word = os.environ.get("MUJOCO_GL", "").lower()
        off = word in opengl.OFF and not opengl.none_works
        self.software = self._backend == "software" or (self._backend == "auto" and off)
        if not self.software:
            try:
                canvas = _GLCanvas(self._model, *self._size, self._shadows)
            except (MissingDependencyError, mujoco.FatalError) as error:
                if self._backend == "gl":
                    raise
                self.software = True
                _warn_once(f"frames are drawn in software, slowly and without shadows: {error}")
            else:
                if opengl.asked not in ("", word):
                    _warn_once(f"MUJOCO_GL={opengl.asked} does not work here; frames are drawn with {word}")
                return canvas
        return SoftwareCanvas(self._model, *self._size)

    def frame(self, qpos: np.ndarray, camera: str = "close") -> np.ndarray:
        """Draw one state as uint8 of shape (height, width, 3).

        Args:
            qpos: Positions of everything, shape (nq,), for instance a row of `Performance.frames`.
            camera: A camera of the model: `close`, `ringside`, `side` and `left` in the ring, `nao/top_camera` in the
                robot's head.

        Raises:
            NotFoundError: If there is no such camera.
            SettingsError: If the renderer is closed.
        """
        import mujoco

        from creative_nao.schema import checked

        if self._canvas is None:
            raise SettingsError("this renderer is closed; make a new one.")
        if checked(str, camera, "camera") not in self._cameras:
            raise NotFoundError(
                f"no camera `{camera}`{nearest_name(camera, self._cameras)}; "
                f"the known ones are {', '.join(self._cameras)}."
            )
        with opengl.lock:
            if self._pid != os.getpid():  # forked since: the context stayed with the parent
                self._canvas = self._start()
            self._data.qpos[:] = qpos
            mujoco.mj_kinematics(self._model, self._data)
            mujoco.mj_comPos(self._model, self._data)
            mujoco.mj_camlight(self._model, self._data)
            pixels, n = self._canvas.draw(self._data, self._cameras.index(camera)), self._smooth
        if n == 1:
            return np.ascontiguousarray(pixels)
        height, width = pixels.shape[0] // n, pixels.shape[1] // n
        return pixels.reshape(height, n, width, n, 3).mean(axis=(1, 3)).round().astype(np.uint8)

    def depth(self, qpos: np.ndarray, camera: str = "close") -> np.ndarray:
        """Measure one state: how far what each pixel shows is from the camera's plane [m], float32, (height, width).

        Arguments and errors are those of `frame`.
        """
        with opengl.lock:
            self.frame(qpos, camera)
            assert self._canvas is not None
            return self._canvas.depth()[:: self._smooth, :: self._smooth].astype(np.float32)

    def close(self) -> None:
        """Free the drawing context; what is not closed is freed when it is no longer used or Python ends."""
        if isinstance(self._canvas, _GLCanvas):
            self._canvas.close()
        self._canvas = None

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _GLCanvas:
    """Draws states of one model with off-screen OpenGL."""

    def __init__(self, model: Any, width: int, height: int, shadows: bool) -> None:
        import mujoco

        self._mujoco, self._model = mujoco, model
        self._rect = mujoco.MjrRect(0, 0, width, height)
        with opengl.lock:
            self._gl = opengl.start(width, height)
            try:
                with self._gl.current():
                    self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
                    self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR  # keeps the far apart in float32
                    mujoco.mjr_resizeOffscreen(width, height, self._context)
                    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
            except BaseException:
                self._gl.free()
                raise
        self.close = opengl.free_later(self, self._gl, self._context)
        self._scene = mujoco.MjvScene(model, _MAX_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        self._option = mujoco.MjvOption()
        self._near, self._far = (
            float(plane) * model.stat.extent for plane in (model.vis.map.znear, model.vis.map.zfar)
        )

    def draw(self, data: Any, camera: int) -> np.ndarray:
        """Draw what a fixed camera sees, as uint8 of shape (height, width, 3)."""
        mujoco = self._mujoco
        view = mujoco.MjvCamera()
        view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, camera
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, data, self._option, None, view, everything, self._scene)
        pixels = np.empty((self._rect.height, self._rect.width, 3), dtype=np.uint8)
        with self._gl.current():
            mujoco.mjr_render(self._rect, self._scene, self._context)
            mujoco.mjr_readPixels(pixels, None, self._rect, self._context)
        return pixels[::-1]

    def depth(self) -> np.ndarray:
        """Return the distance of what was drawn last from the camera's plane [m], (height, width)."""
        raw = np.empty((self._rect.height, self._rect.width), np.float32)
        with self._gl.current():
            self._mujoco.mjr_readPixels(None, raw, self._rect, self._context)
        # As read here the buffer is 1 at the near plane and 0 at the far one.
        return self._near * self._far / (self._near + raw[::-1].astype(np.float64) * (self._far - self._near))


def _warn_once(text: str) -> None:
    global _warned
    if not _warned:
        _warned = True
        warnings.warn(text, RuntimeWarning, stacklevel=4)
