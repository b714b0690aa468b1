"""Choose how MuJoCo draws without a display, and start off-screen OpenGL.

MuJoCo and dm_control read MUJOCO_GL once, when they are imported, and a back end that cannot be loaded breaks that very
import. So `choose_backend` runs when `creative_nao.robot` is imported. EGL is called directly, not by PyOpenGL: so
neither PYOPENGL_PLATFORM nor what was imported before matters. A context is current only while something is drawn, so
that any thread may draw and other programs' contexts stay as they are.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import multiprocessing
import os
import subprocess
import sys
import threading
import warnings
import weakref
from collections.abc import Iterator
from typing import Any

from creative_nao.errors import MissingDependencyError
from creative_nao.runtime import python_environment

ON = ("egl", "osmesa", "glfw")  # what MUJOCO_GL may name
OFF = ("disable", "disabled", "off", "false", "0")  # what MUJOCO_GL says to do without OpenGL
PACKAGES = {"egl": "libegl1 libgl1-mesa-dri libopengl0", "osmesa": "libosmesa6", "glfw": "xvfb"}
"""What Debian and Ubuntu call the packages of each back end; glfw needs a display, here a virtual one."""
HOW_TO_DRAW = (
    "drawing needs off-screen OpenGL, which this machine cannot start: on Debian or Ubuntu run "
    f"`apt-get install {PACKAGES['egl']}` (or `{PACKAGES['osmesa']}` and set MUJOCO_GL=osmesa)"
)

_PLATFORM_DEVICE, _OPENGL_API, _MAX_DEVICES = 0x313F, 0x30A2, 16
_ATTRIBUTES = (  # 8 bits a colour, 24 of depth, 8 of stencil; an off-screen surface; OpenGL
    0x3024, 8, 0x3023, 8, 0x3022, 8, 0x3021, 8, 0x3025, 24, 0x3026, 8, 0x303F, 0x308E, 0x3033, 1, 0x3040, 8, 0x3038,
)  # fmt: skip

asked = os.environ.get("MUJOCO_GL", "").strip().lower()
"""What MUJOCO_GL said before `choose_backend` replaced what does not work here."""
none_works = False
"""Whether `choose_backend` set MUJOCO_GL to `disable` because nothing works here, rather than the user."""
lock = threading.RLock()
"""Held while something is drawn."""
_began = False
"""Whether this process has started OpenGL by `start`."""
_inherited = False
"""Whether this process was forked from one that had drawn: OpenGL, whose threads are gone, would wait for ever."""


def choose_backend() -> None:
    """Set MUJOCO_GL to a back end that works here, unless it names one or a display decides.

    A word that does not work here is replaced by `egl`, `osmesa` or `disable`, the first that does. PYOPENGL_PLATFORM
    follows. Nothing happens off Linux. If MuJoCo is already imported, dm_control, which reads the variable for itself,
    still profits.
    """
    global asked, none_works
    asked = os.environ.get("MUJOCO_GL", "").strip().lower()
    if not sys.platform.startswith("linux") or (not asked and _has_display()):
        return
    chosen = asked
    if asked not in OFF and (asked not in ON or _missing(asked)):
        chosen = "glfw" if _has_display() else working_backend()
    os.environ["MUJOCO_GL"] = chosen
    none_works = chosen == "disable" and asked not in OFF
    if chosen in ("egl", "osmesa") and os.environ.get("PYOPENGL_PLATFORM"):
        os.environ["PYOPENGL_PLATFORM"] = chosen  # another word would break the imports of MuJoCo and dm_control


def working_backend() -> str:
    """Return the best off-screen back end that this machine can start: `egl`, `osmesa` or `disable`."""
    if _egl_starts() and (_loads("libOpenGL.so.0") or _loads("libGL.so.1")):
        return "egl"
    return "disable" if _missing("osmesa") else "osmesa"


def probe(backend: str, timeout_s: float = 60.0) -> str:
    """Start one of `ON` in a process of its own, as drawing would; return an empty text if it works, else why not."""
    missing = _missing(backend)
    if missing:
        return missing
    code = (
        f"from creative_nao.robot import opengl; gl = opengl.start_backend({backend!r}, 16, 16)\n"
        "import mujoco\n"
        "with gl.current(): mujoco.MjrContext(mujoco.MjModel.from_xml_string('<mujoco/>'), 100).free()"
    )
    command = [sys.executable, "-P", "-W", "ignore", "-c", code]
    environment = {name: value for name, value in python_environment().items() if name != "PYOPENGL_PLATFORM"}
    try:
        done = subprocess.run(  # noqa: S603 - our own words and one of three names
            command, env=environment | {"MUJOCO_GL": backend}, capture_output=True, text=True, timeout=timeout_s
        )
    except subprocess.TimeoutExpired:
        return f"no answer within {timeout_s:g} s"
    except OSError as error:
        return str(error)
    if done.returncode == 0:
        return ""
    said = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    return said[-1][:200] if said else f"the process ended with {done.returncode}"


def missing_window() -> str:
    """Return why no window can be opened, or an empty text; MuJoCo's viewer itself would end Python."""
    if missing := _missing("glfw"):
        return missing
    try:
        import glfw

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            opened = glfw.init()
    except Exception as error:  # whatever the window system says
        return str(error)
    return "" if opened else f"the display {os.environ.get('DISPLAY', '')} cannot be opened"


def _missing(backend: str) -> str:
    """Return what a back end obviously lacks, in words that its own failure would not find."""
    if not sys.platform.startswith("linux"):
        return ""
    if backend == "glfw":
        return "" if _has_display() else "no display; xvfb-run gives a virtual one"
    if backend == "osmesa":
        if not (_loads("libOSMesa.so.8") or _loads("libOSMesa.so.6")):
            return "libOSMesa is missing"
        loaded = type(getattr(sys.modules.get("OpenGL.platform"), "PLATFORM", None)).__name__
        return "" if loaded in ("NoneType", "OSMesaPlatform") else "PyOpenGL was imported before, for another back end"
    return "" if backend != "egl" or _loads("libEGL.so.1") else "libEGL is missing"


def _has_display() -> bool:
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _egl_starts() -> bool:
    """Try to start a device: the library alone, without a driver, makes the import of dm_control fail."""
    try:
        _egl_display()
    except (OSError, RuntimeError, AttributeError):
        return False
    return True


def _egl_display() -> tuple[Any, int]:
    """Return libEGL and a display of the first device that starts, or of that which MUJOCO_EGL_DEVICE_ID numbers."""
    egl = ctypes.CDLL("libEGL.so.1")
    handle, integer = ctypes.c_void_p, ctypes.c_int
    for name, result, *kinds in (
        ("eglGetProcAddress", handle, ctypes.c_char_p),
        ("eglInitialize", integer, handle, handle, handle),
        ("eglBindAPI", integer, integer),
        ("eglChooseConfig", integer, handle, handle, handle, integer, handle),
        ("eglCreateContext", handle, handle, handle, handle, handle),
        ("eglGetCurrentContext", handle),
        ("eglMakeCurrent", integer, handle, handle, handle, handle),
        ("eglDestroyContext", integer, handle, handle),
    ):
        function = getattr(egl, name)
        function.restype, function.argtypes = result, kinds
    query, display_of = map(egl.eglGetProcAddress, (b"eglQueryDevicesEXT", b"eglGetPlatformDisplayEXT"))
    if not query or not display_of:
        raise RuntimeError("libEGL has no devices")
    devices, count = (handle * _MAX_DEVICES)(), integer(0)
    query_devices = ctypes.CFUNCTYPE(ctypes.c_uint, integer, ctypes.POINTER(handle), ctypes.POINTER(integer))(query)
    get_display = ctypes.CFUNCTYPE(handle, ctypes.c_uint, handle, handle)(display_of)
    if not query_devices(_MAX_DEVICES, devices, ctypes.byref(count)):
        raise RuntimeError("libEGL does not tell its devices")
    wanted = os.environ.get("MUJOCO_EGL_DEVICE_ID", "")
    for number in range(count.value):
        if wanted in ("", str(number)):
            display = get_display(_PLATFORM_DEVICE, devices[number], None)
            if display and egl.eglInitialize(display, None, None):
                return egl, display
    which = f"with MUJOCO_EGL_DEVICE_ID={wanted} " if wanted else ""
    raise RuntimeError(f"{which}none of {count.value} devices of EGL starts")


class EGLContext:
    """Off-screen OpenGL by EGL."""

    def __init__(self) -> None:
        self._egl, self._display = _egl_display()
        with contextlib.suppress(OSError):  # drivers of graphics cards need it loaded first
            ctypes.CDLL("libOpenGL.so.0", ctypes.RTLD_GLOBAL)
        attributes, config, count = (ctypes.c_int * len(_ATTRIBUTES))(*_ATTRIBUTES), ctypes.c_void_p(), ctypes.c_int(0)
        self._egl.eglChooseConfig(self._display, attributes, ctypes.byref(config), 1, ctypes.byref(count))
        self._egl.eglBindAPI(_OPENGL_API)
        self._context = self._egl.eglCreateContext(self._display, config, None, None) if count.value else None
        if not self._context:
            raise RuntimeError("EGL gives no context of OpenGL")

    @contextlib.contextmanager
    def current(self) -> Iterator[None]:
        """Draw here; what was current in this thread before is so again afterwards."""
        self._egl.eglBindAPI(_OPENGL_API)
        before = self._egl.eglGetCurrentContext()
        if not self._egl.eglMakeCurrent(self._display, None, None, self._context):
            raise RuntimeError("EGL does not make its context current")
        try:
            yield
        finally:
            self._egl.eglMakeCurrent(self._display, None, None, before)

    def free(self) -> None:
        """Free the context, which must not be current."""
        self._egl.eglDestroyContext(self._display, self._context)


class MujocoContext:
    """Off-screen OpenGL by OSMesa, or an invisible window of GLFW, as MuJoCo starts them."""

    def __init__(self, backend: str, width: int, height: int) -> None:
        if backend not in ON:
            raise RuntimeError(f"no back end `{backend}`")
        if missing := missing_window() if backend == "glfw" else _missing(backend):
            raise RuntimeError(missing)
        self._gl = importlib.import_module(f"mujoco.{backend}").GLContext(width, height)
        self._glfw = backend == "glfw"

    @contextlib.contextmanager
    def current(self) -> Iterator[None]:
        """Draw here; afterwards nothing is current in this thread."""
        self._gl.make_current()
        try:
            yield
        finally:
            if self._glfw:
                importlib.import_module("glfw").make_context_current(None)
            else:
                importlib.import_module("OpenGL.osmesa").OSMesaMakeCurrent(None, None, 0x1406, 0, 0)

    def free(self) -> None:
        """Free the context."""
        self._gl.free()


def start_backend(backend: str, width: int, height: int) -> EGLContext | MujocoContext:
    """Start one of `ON`."""
    return EGLContext() if backend == "egl" else MujocoContext(backend, width, height)


def start(width: int, height: int) -> EGLContext | MujocoContext:
    """Start off-screen OpenGL with the back end of MUJOCO_GL, or the first that works.

    Raises:
        MissingDependencyError: If none starts, or this process was forked from one that had drawn.
    """
    global _began
    if _inherited:
        raise MissingDependencyError(
            "OpenGL does not survive a fork, and the parent of this process has drawn; start workers by `spawn` or "
            "`forkserver`, or draw in them alone"
        )
    word = os.environ.get("MUJOCO_GL", "").strip().lower()
    first, works = None, working_backend() if sys.platform.startswith("linux") else "glfw"
    for backend in dict.fromkeys(name for name in (word, works, "egl") if name in ON):
        try:
            context = start_backend(backend, width, height)
        except Exception as error:  # each fails in its own way, down to missing C symbols
            first = first or error
        else:
            _began = True
            return context
    raise MissingDependencyError(f"{HOW_TO_DRAW} (MUJOCO_GL={asked or word or works}: {first}).") from first


def free_later(owner: Any, context: EGLContext | MujocoContext, drawing: Any) -> weakref.finalize[Any, Any]:
    """Return what frees MuJoCo's `drawing` and its context: when called, when `owner` is gone, or at Python's end."""
    return weakref.finalize(owner, _free, context, drawing, os.getpid())


def _free(context: EGLContext | MujocoContext, drawing: Any, pid: int) -> None:
    if pid == os.getpid():  # after a fork it is the parent's
        with contextlib.suppress(Exception), lock:  # at the end of Python others may have ended OpenGL before
            with context.current():
                drawing.free()
            context.free()


def _others_began() -> bool:
    """Tell whether MuJoCo's own renderer or dm_control has started OpenGL."""
    contexts = getattr(sys.modules.get("dm_control._render.base"), "_CURRENT_CONTEXT_FOR_THREAD", {})
    return getattr(sys.modules.get("mujoco.egl"), "EGL_DISPLAY", None) is not None or any(contexts.values())


def _after_fork() -> None:
    """Begin anew in a forked process; remember whether OpenGL, here or elsewhere, had been started in the parent."""
    global lock, _inherited
    lock = threading.RLock()
    _inherited = _inherited or _began or _others_began()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
    # In a worker that was forked before this was imported, what others began is the parent's.
    _inherited = multiprocessing.parent_process() is not None and _others_began()
