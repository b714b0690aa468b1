"""Choose how MuJoCo draws before it is first imported, so that physics runs on a machine without display or GL.

MuJoCo and dm_control read MUJOCO_GL once, when they are imported, and a back end that cannot be loaded breaks that very
import.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys

_EGL_PLATFORM_DEVICE = 0x313F
_MAX_DEVICES = 16

ON = ("egl", "osmesa", "glfw")
"""What MUJOCO_GL may name."""

OFF = ("disable", "disabled", "off", "false", "0")
"""What MUJOCO_GL says to do without GL."""

PACKAGES = {
    "egl": "libegl1 libgl1-mesa-dri libopengl0",
    "osmesa": "libosmesa6",
    "glfw": "xvfb",
}
"""What Debian and Ubuntu call the packages of each back end; glfw needs a display, here a virtual one."""

nothing_found = False
"""Whether `prepare` set MUJOCO_GL to `disable` because nothing works here; then not the user chose so."""


def prepare() -> None:
    """Set MUJOCO_GL to `egl`, `osmesa` or `disable`, the first that works here, unless the user or a display decides.

    Nothing happens when MUJOCO_GL is set, when a display is there, or off Linux. If MuJoCo is already imported,
    dm_control, which reads the variable for itself, still profits.
    """
    if os.environ.get("MUJOCO_GL") or not sys.platform.startswith("linux"):
        return
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        return
    global nothing_found
    os.environ["MUJOCO_GL"] = working_backend()
    nothing_found = os.environ["MUJOCO_GL"] == "disable"


def working_backend() -> str:
    """Return the best off-screen back end that this machine can start: `egl`, `osmesa` or `disable`."""
    if _egl_starts() and (_loads("libOpenGL.so.0") or _loads("libGL.so.1")):
        return "egl"
    if _loads("libOSMesa.so.8") or _loads("libOSMesa.so.6"):
        return "osmesa"
    return "disable"


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
    command = [sys.executable, "-W", "ignore", "-c", code]
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
    if backend == "glfw" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return "no display; xvfb-run gives a virtual one"
    if backend == "osmesa" and not (_loads("libOSMesa.so.8") or _loads("libOSMesa.so.6")):
        return "libOSMesa is missing"
    if backend == "egl" and not _loads("libEGL.so.1"):
        return "libEGL is missing"
    return ""


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
