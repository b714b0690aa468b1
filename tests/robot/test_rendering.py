"""Frames are drawn where off-screen GL starts; elsewhere physics runs on and the error says what to install."""

import os
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from creative_nao.errors import MissingDependencyError, NotFoundError, SettingsError, ShapeError
from creative_nao.robot import (
    Renderer,
    can_draw,
    film_strip,
    imagined_frames,
    moments,
    opengl,
    pictures,
    write_gif,
    write_mp4,
)

needs_gl = pytest.mark.skipif(not can_draw(), reason="this machine has no off-screen GL")


def run_without_gl(code):
    """Run in a fresh interpreter whose environment names no back end and in which no GL library can be loaded."""
    prelude = """
import ctypes, ctypes.util
real = ctypes.CDLL.__init__
def refuse(self, name, *arguments, **named):
    if name and any(part in str(name) for part in ("EGL", "OSMesa", "libGL", "OpenGL", "glfw")):
        raise OSError(name)
    real(self, name, *arguments, **named)
ctypes.CDLL.__init__ = refuse
"""
    names = ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY", "PYOPENGL_PLATFORM")
    environment = {key: value for key, value in os.environ.items() if key not in names}
    done = subprocess.run([sys.executable, "-c", prelude + code], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_without_gl_physics_runs_to_the_same_bits(performances):
    code = """
import os
from creative_nao.demonstrations import load_demonstrations
from creative_nao.robot import Performer
demos = load_demonstrations()
print(os.environ["MUJOCO_GL"], Performer().perform(demos.trajectories[0], demos.dt_s).measured.tobytes().hex())
"""
    backend, measured = run_without_gl(code).split()
    assert backend == "disable"
    assert measured == performances["left_jab"].measured.tobytes().hex()


def test_without_gl_frames_are_drawn_in_software_with_one_warning_naming_the_packages():
    code = """
import warnings
from creative_nao.errors import MissingDependencyError
from creative_nao.robot import Renderer, Scene, can_draw
model = Scene().model
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    for _ in range(2):
        with Renderer(model, 16, 12) as renderer:
            print(renderer.software, end=" ")
print(len(caught), caught[0].message)
try:
    Renderer(model, backend="gl")
except MissingDependencyError as error:
    print(error)
print(can_draw())
"""
    first, second, last = run_without_gl(code).splitlines()
    packages = "apt-get install libegl1 libgl1-mesa-dri libopengl0"
    assert first.startswith("True True 1 frames are drawn in software, slowly and without shadows: ")
    assert packages in first
    assert packages in second
    assert last == "False"


def test_importing_the_package_loads_neither_mujoco_nor_gl():
    code = """
import sys, creative_nao.robot
print([name for name in ("mujoco", "dm_control", "OpenGL") if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize(
    ("libraries", "egl", "expected"),
    [
        ({"libOpenGL.so.0", "libOSMesa.so.8"}, True, "egl"),
        ({"libGL.so.1"}, True, "egl"),
        (set(), True, "disable"),
        ({"libOSMesa.so.8"}, False, "osmesa"),
        (set(), False, "disable"),
    ],
)
def test_the_first_back_end_that_works_is_chosen(monkeypatch, libraries, egl, expected):
    monkeypatch.setattr(opengl, "_egl_starts", lambda: egl)
    monkeypatch.setattr(opengl, "_loads", lambda name: name in libraries)
    monkeypatch.delitem(
        sys.modules, "OpenGL.platform", raising=False
    )  # loaded for another back end it rules OSMesa out
    assert opengl.working_backend() == expected


@pytest.mark.parametrize("name", ["DISPLAY", "WAYLAND_DISPLAY"])
def test_what_a_display_decides_stays(monkeypatch, name):
    for variable in ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv(name, ":0")
    before = dict(os.environ)
    opengl.choose_backend()
    assert dict(os.environ) == before


@pytest.mark.parametrize(
    ("word", "display", "chosen"),
    [
        ("egl", "", "egl"),
        (" EGL", "", "egl"),
        ("osmesa", "", "egl"),
        ("glfw", "", "egl"),
        ("glfw", ":0", "glfw"),
        ("vulkan", "", "egl"),
        ("vulkan", ":0", "glfw"),
        ("1", "", "egl"),
        ("Off", "", "off"),
        ("disable", ":0", "disable"),
    ],
)
def test_a_word_that_works_here_stays_and_another_is_replaced(attempt, monkeypatch, word, display, chosen):
    attempt("drawing", "MUJOCO_GL in any case, unknown, or of a back end that is missing", "replaced by one that works")
    monkeypatch.setattr(opengl, "_egl_starts", lambda: True)
    monkeypatch.setattr(opengl, "_loads", lambda name: "OSMesa" not in name)
    for name, value in {"MUJOCO_GL": word, "DISPLAY": display, "PYOPENGL_PLATFORM": "glx"}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(opengl, "asked", opengl.asked)
    monkeypatch.setattr(opengl, "none_works", opengl.none_works)
    opengl.choose_backend()
    assert os.environ["MUJOCO_GL"] == chosen
    assert os.environ["PYOPENGL_PLATFORM"] == ("egl" if chosen == "egl" else "glx")


def test_a_back_end_that_does_not_start_is_reported_with_its_name(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "egl")
    monkeypatch.setenv("MUJOCO_EGL_DEVICE_ID", "77")
    monkeypatch.setattr(opengl, "_loads", lambda name: "OSMesa" not in name)
    with pytest.raises(
        MissingDependencyError, match=r"MUJOCO_EGL_DEVICE_ID=77 none of \d+ devices of EGL starts|libEGL"
    ):
        opengl.start(16, 16)


@needs_gl
def test_a_frame_shows_the_robot(scene):
    guard = scene.guard_qpos()
    away = guard.copy()
    away[scene.index.torso_qpos] -= 50
    with Renderer(scene.model, 160, 120) as renderer:
        with_robot, without = renderer.frame(guard, "close"), renderer.frame(away, "close")
        assert np.array_equal(renderer.frame(guard, "close"), with_robot)
    assert with_robot.shape == (120, 160, 3)
    assert with_robot.dtype == np.uint8
    changed = (with_robot != without).any(axis=2).mean()
    assert 0.05 < changed < 0.5
    red = (with_robot[..., 0] > 150) & (with_robot[..., 1] < 60)
    assert red.sum() > 50, "the gloves"


@needs_gl
def test_every_camera_sees_something(scene):
    with Renderer(scene.model, 64, 48) as renderer:
        for camera in ("close", "ringside", "side", "left", "nao/top_camera"):
            assert renderer.frame(scene.guard_qpos(), camera).std() > 10


@needs_gl
def test_an_unknown_camera_names_the_nearest(scene):
    with Renderer(scene.model, 64, 48) as renderer, pytest.raises(NotFoundError, match=r"did you mean `side`\?"):
        renderer.frame(scene.guard_qpos(), "sied")


def test_a_size_is_positive(scene):
    with pytest.raises(SettingsError, match="`width` should be at least 1, but is 0"):
        Renderer(scene.model, 0, 480)


@needs_gl
def test_a_film_strip_shows_moments_side_by_side(scene, performances, tmp_path):
    frames = moments(performances["right_straight"].frames, 4)
    images = pictures(scene, frames, width=80, height=60, shadows=True, smooth=2)
    path = film_strip(images, tmp_path / "strip.png")
    strip = np.asarray(Image.open(path))
    assert strip.shape == (60, 4 * 80 + 3 * 4, 3)
    assert np.array_equal(strip[:, 84:164], images[1])


def test_a_gif_keeps_its_pictures_and_pace(tmp_path):
    images = [np.full((20, 30, 3), level, dtype=np.uint8) for level in (0, 128, 255)]
    with Image.open(write_gif(images, tmp_path / "a.gif", frame_dt_s=0.05)) as gif:
        assert (gif.size, gif.n_frames, gif.info["duration"], gif.info["loop"]) == ((30, 20), 3, 50, 0)


def test_a_gif_stores_only_what_changes(tmp_path):
    """Before a busy background a square moves and two corners change: the pictures come back, none is stored whole."""
    rng = np.random.default_rng(0)
    colours = rng.integers(0, 256, (200, 3)).astype(np.uint8)
    background = colours[rng.integers(0, 200, (120, 160))]
    images = [background.copy() for _ in range(12)]
    for step, image in enumerate(images):
        image[20:26, 5 * step : 5 * step + 6] = colours[0]
        image[0, 0] = image[-1, -1] = colours[step]
    path = write_gif(images, tmp_path / "moving.gif", frame_dt_s=0.05)
    one = write_gif(images[:1], tmp_path / "one.gif", frame_dt_s=0.05)

    assert path.stat().st_size < 3 * one.stat().st_size
    with Image.open(path) as gif:
        for number, image in enumerate(images):
            gif.seek(number)
            np.testing.assert_array_equal(np.asarray(gif.convert("RGB")), image)


def test_an_mp4_says_what_it_needs_and_what_needs_nothing(tmp_path, monkeypatch):
    image = np.zeros((20, 30, 3), np.uint8)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(
        MissingDependencyError, match=r"pip install imageio-ffmpeg`, or write a GIF \(`robot.write_gif`\)"
    ):
        write_mp4([image], tmp_path / "a.mp4", frame_dt_s=0.05)
    with pytest.raises(SettingsError, match="should be even, but are 30 and 19"):
        write_mp4([image[:19]], tmp_path / "a.mp4", frame_dt_s=0.05)
    assert not list(tmp_path.iterdir())


def test_moments_keep_the_first_and_the_last():
    assert moments(np.arange(11)[:, None], 3)[:, 0].tolist() == [0, 5, 10]


def test_an_imagined_trajectory_moves_the_arms_exactly_and_nothing_else(scene, demos):
    frames = imagined_frames(scene, demos.trajectories[2], demos.dt_s)
    assert len(frames) == 49 * 3 + 1
    np.testing.assert_array_equal(frames[::3, scene.index.arm_qpos], demos.trajectories[2])
    rest = np.setdiff1d(np.arange(scene.model.nq), scene.index.arm_qpos)
    assert np.array_equal(frames[:, rest], np.repeat(frames[:1, rest], len(frames), axis=0))


def test_pictures_of_different_sizes_are_refused(tmp_path):
    with pytest.raises(ShapeError, match="pictures of one size"):
        film_strip([np.zeros((2, 2, 3), np.uint8), np.zeros((3, 2, 3), np.uint8)], tmp_path / "a.png")
    with pytest.raises(ShapeError, match="at least one picture"):
        write_gif([], tmp_path / "a.gif", frame_dt_s=0.1)
