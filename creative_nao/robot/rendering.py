"""Choose how MuJoCo draws, and draw the robot without a display: frames as arrays, from any camera of the model.

MuJoCo and dm_control read MUJOCO_GL once, when they are imported, and a back end that cannot be loaded breaks that very
import. So `choose_backend` runs when `creative_nao.robot` is imported, and MuJoCo is loaded here only where something
is drawn. The drawing context is made here rather than by MuJoCo's own renderer, which can only use the back end that
was chosen at its import. Where no OpenGL starts, frames are drawn in software: slower, without shadows.
"""

# The bindings of MuJoCo have no static types.
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

import ctypes
import importlib
import os
import subprocess
import sys
import warnings
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from creative_nao.errors import MissingDependencyError, NotFoundError, SettingsError, nearest_name

if TYPE_CHECKING:
    from creative_nao.robot.software_rendering import SoftwareCanvas

Backend = Literal["auto", "gl", "software"]

ON = ("egl", "osmesa", "glfw")  # what MUJOCO_GL may name
OFF = ("disable", "disabled", "off", "false", "0")  # what MUJOCO_GL says to do without OpenGL
PACKAGES = {"egl": "libegl1 libgl1-mesa-dri libopengl0", "osmesa": "libosmesa6", "glfw": "xvfb"}
"""What Debian and Ubuntu call the packages of each back end; glfw needs a display, here a virtual one."""

_MAX_GEOMS = 2000
_BACKENDS = ("auto", "gl", "software")
_EGL_PLATFORM_DEVICE = 0x313F
_MAX_DEVICES = 16
_HOW_TO_DRAW = (
    "drawing needs off-screen OpenGL, which this machine cannot start: on Debian or Ubuntu run "
    f"`apt-get install {PACKAGES['egl']}` (or `{PACKAGES['osmesa']}` and set MUJOCO_GL=osmesa)"
)

_none_works = False
"""Whether `choose_backend` set MUJOCO_GL to `disable` because nothing works here, rather than the user."""
_warned = False


def choose_backend() -> None:
    """Set MUJOCO_GL to `egl`, `osmesa` or `disable`, the first that works here, unless the user or a display decides.

    Nothing happens when MUJOCO_GL is set, when a display is there, or off Linux. If MuJoCo is already imported,
    dm_control, which reads the variable for itself, still profits.
    """
    global _none_works
    if os.environ.get("MUJOCO_GL") or not sys.platform.startswith("linux") or _has_display():
        return
    os.environ["MUJOCO_GL"] = working_backend()
    _none_works = os.environ["MUJOCO_GL"] == "disable"


def working_backend() -> str:
    """Return the best off-screen back end that this machine can start: `egl`, `osmesa` or `disable`."""
    if _egl_starts() and (_loads("libOpenGL.so.0") or _loads("libGL.so.1")):
        return "egl"
    return "osmesa" if _has_osmesa() else "disable"


def can_draw() -> bool:
    """Tell whether off-screen OpenGL works on this machine; without it frames are drawn in software."""
    try:
        _gl_context(16, 16).free()
    except MissingDependencyError:
        return False
    return True


def probe(backend: str, timeout_s: float = 60.0) -> str:
    """Start one of `ON` in a process of its own, as drawing would; return an empty text if it works, else why not."""
    missing = _missing(backend)
    if missing:
        return missing
    code = (
        f"import mujoco; from mujoco.{backend} import GLContext; gl = GLContext(16, 16); gl.make_current(); "
        "mujoco.MjrContext(mujoco.MjModel.from_xml_string('<mujoco/>'), mujoco.mjtFontScale.mjFONTSCALE_100).free(); "
        "gl.free()"
    )
    command = [sys.executable, "-P", "-W", "ignore", "-c", code]
    environment = {name: value for name, value in os.environ.items() if name != "PYOPENGL_PLATFORM"}
    try:
        done = subprocess.run(  # noqa: S603 - our own words and one of three names
            command, env=environment | {"MUJOCO_GL": backend}, capture_output=True, text=True, timeout=timeout_s
        )
    except subprocess.TimeoutExpired:
        return f"no answer within {timeout_s:g} s"
    if done.returncode == 0:
        return ""
    said = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    return said[-1][:200] if said else f"the process ended with {done.returncode}"


def _missing(backend: str) -> str:
    """Return what a back end obviously lacks, in words that its own failure would not find."""
    if not sys.platform.startswith("linux"):
        return ""
    if backend == "glfw":
        return "" if _has_display() else "no display; xvfb-run gives a virtual one"
    if backend == "osmesa":
        return "" if _has_osmesa() else "libOSMesa is missing"
    return "" if backend != "egl" or _loads("libEGL.so.1") else "libEGL is missing"


def _has_display() -> bool:
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _has_osmesa() -> bool:
    return _loads("libOSMesa.so.8") or _loads("libOSMesa.so.6")


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _egl_starts() -> bool:
    """Try to start a device: the library alone, without a driver, makes the import of dm_control fail."""
    try:
        egl = ctypes.CDLL("libEGL.so.1")
        address = egl.eglGetProcAddress
    except (OSError, AttributeError):
        return False
    address.restype, address.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
    query, display_of = address(b"eglQueryDevicesEXT"), address(b"eglGetPlatformDisplayEXT")
    if not query or not display_of:
        return False
    handle, integer = ctypes.c_void_p, ctypes.c_int
    query_devices = ctypes.CFUNCTYPE(ctypes.c_uint, integer, ctypes.POINTER(handle), ctypes.POINTER(integer))(query)
    get_display = ctypes.CFUNCTYPE(handle, ctypes.c_uint, handle, handle)(display_of)
    egl.eglInitialize.argtypes = [handle, handle, handle]
    devices, count = (handle * _MAX_DEVICES)(), integer(0)
    if not query_devices(_MAX_DEVICES, devices, ctypes.byref(count)):
        return False
    displays = (get_display(_EGL_PLATFORM_DEVICE, devices[number], None) for number in range(count.value))
    return any(display and egl.eglInitialize(display, None, None) for display in displays)


class Renderer:
    """Draws states of one model into arrays; use it as a context manager, or call `close`.

    Shadows and smooth edges cost most of the time and are off unless asked for. With MUJOCO_GL=disable, or where no
    off-screen OpenGL can be started, frames are drawn in software, which the attribute `software` tells; the latter is
    said once, in a RuntimeWarning.

    Args:
        model: The compiled `mujoco.MjModel`, for instance `scene.model`.
        width: Width of a frame in pixels.
        height: Height of a frame in pixels.
        shadows: Draw shadows; software has none.
        smooth: Draw everything this many times larger and average (1 leaves edges as they are).
        backend: `auto`, or insist on `gl` or `software`.

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
        import mujoco

        from creative_nao.robot.software_rendering import SoftwareCanvas
        from creative_nao.schema import Count, checked

        global _warned
        width, height = checked(Count, width, "width"), checked(Count, height, "height")
        smooth = checked(Count, smooth, "smooth")
        if backend not in _BACKENDS:
            raise SettingsError(f"`backend` should be one of {', '.join(_BACKENDS)}, but is {backend!r}.")
        self._model, self._smooth = model, smooth
        self._data = mujoco.MjData(model)
        self._cameras = [model.camera(number).name for number in range(model.ncam)]
        self._canvas: _GLCanvas | SoftwareCanvas | None
        size, chosen = (width * smooth, height * smooth), os.environ.get("MUJOCO_GL", "").lower()
        self.software = backend == "software" or (backend == "auto" and chosen in OFF and not _none_works)
        if not self.software:
            try:
                self._canvas = _GLCanvas(model, *size, shadows)
            except (MissingDependencyError, mujoco.FatalError) as error:
                if backend == "gl" or chosen not in (*OFF, *ON, ""):
                    raise
                self.software = True
                if not _warned:
                    _warned = True
                    told = f"frames are drawn in software, slowly and without shadows: {error}"
                    warnings.warn(told, RuntimeWarning, stacklevel=2)
        if self.software:
            self._canvas = SoftwareCanvas(model, *size)

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
        self.frame(qpos, camera)
        assert self._canvas is not None
        return self._canvas.depth()[:: self._smooth, :: self._smooth].astype(np.float32)

    def close(self) -> None:
        """Free the drawing context; do so before the program ends, or GL complains at exit."""
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
        self._gl = _gl_context(width, height)
        self._gl.make_current()
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR  # keeps what is far apart in float32
        mujoco.mjr_resizeOffscreen(width, height, self._context)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
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
        self._gl.make_current()
        mujoco.mjr_render(self._rect, self._scene, self._context)
        pixels = np.empty((self._rect.height, self._rect.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._rect, self._context)
        return pixels[::-1]

    def depth(self) -> np.ndarray:
        """Return the distance of what was drawn last from the camera's plane [m], (height, width)."""
        self._gl.make_current()
        raw = np.empty((self._rect.height, self._rect.width), np.float32)
        self._mujoco.mjr_readPixels(None, raw, self._rect, self._context)
        # As read here the buffer is 1 at the near plane and 0 at the far one.
        return self._near * self._far / (self._near + raw[::-1].astype(np.float64) * (self._far - self._near))

    def close(self) -> None:
        self._gl.make_current()
        self._context.free()
        self._gl.free()


def _gl_context(width: int, height: int) -> Any:
    """Start off-screen GL with the back end of MUJOCO_GL, or the first that works."""
    backend = os.environ.get("MUJOCO_GL", "").lower()
    if backend in ("", *OFF):
        backend = working_backend() if sys.platform.startswith("linux") else "glfw"
    try:
        if backend not in ON:
            raise RuntimeError(f"no back end `{backend}`")
        return importlib.import_module(f"mujoco.{backend}").GLContext(width, height)
    except Exception as error:  # each back end fails in its own way, down to missing C symbols
        raise MissingDependencyError(f"{_HOW_TO_DRAW} (MUJOCO_GL={backend}: {error}).") from error
