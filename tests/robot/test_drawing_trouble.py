"""Drawing never breaks what needs no drawing: odd environments, threads, forks, import orders, ends without `close`."""

import os
import subprocess
import sys
import threading

import numpy as np
import pytest

from creative_nao.errors import MissingDependencyError
from creative_nao.robot import Renderer, can_draw, opengl

needs_gl = pytest.mark.skipif(not can_draw(), reason="this machine has no off-screen GL")
MENTAL = "CreativeNao/BoxingMental-v0"


def run(code, *arguments, timeout=120, **environment):
    """Run code in a fresh interpreter; return its exit code, output and errors."""
    kept = {name: value for name, value in os.environ.items() if name not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")}
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, env=kept | environment, capture_output=True, text=True, timeout=timeout)
    return done.returncode, done.stdout, done.stderr


@needs_gl
def test_a_second_thread_draws_the_same_frame(attempt, scene):
    attempt("drawing", "threads that draw with the same renderer, and with their own, at once", "the same frames", n=8)
    guard, frames, errors = scene.guard_qpos(), [], []
    with Renderer(scene.model, 64, 48) as shared:
        expected = shared.frame(guard, "side")

        def draw(own):
            try:
                if own:
                    with Renderer(scene.model, 64, 48) as renderer:
                        frames.append(renderer.frame(guard, "side"))
                else:
                    frames.append(shared.frame(guard, "side"))
            except Exception as error:
                errors.append(error)

        threads = [threading.Thread(target=draw, args=(k % 2,)) for k in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert np.array_equal(shared.frame(guard, "side"), expected)
    assert not errors
    assert len(frames) == 8
    assert all(np.array_equal(frame, expected) for frame in frames)


def test_without_a_display_a_window_is_refused_in_words(attempt, monkeypatch):
    attempt(
        "drawing", "render_mode=human without a display, or with a dead one", "MissingDependencyError; Python goes on"
    )
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert opengl.missing_window() == "no display; xvfb-run gives a virtual one"


SHORT = """
import gymnasium as gym, creative_nao
env = gym.make("CreativeNao/Boxing-v0", render_mode="rgb_array")
env.reset(seed=0)
print(env.step([0.1, 0.2])[1])
print(env.render().shape, env.render().std() > 20)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "environment",
    [
        {"MUJOCO_GL": "osmesa"}, {"MUJOCO_GL": "EGL"}, {"MUJOCO_GL": "vulkan"}, {"MUJOCO_GL": "glfw"},
        {"MUJOCO_GL": "1"}, {"MUJOCO_GL": " "}, {"MUJOCO_GL": "off"}, {"MUJOCO_GL": "glx"},
        {"PYOPENGL_PLATFORM": "osmesa"}, {"PYOPENGL_PLATFORM": "glx"}, {"PYOPENGL_PLATFORM": "nonsense"},
        {"DISPLAY": ":77"},
        {"MUJOCO_EGL_DEVICE_ID": "9"}, {"MUJOCO_EGL_DEVICE_ID": "x"}, {"MUJOCO_GL": "egl", "PYOPENGL_PLATFORM": "glx"},
    ],
    ids=str,
)  # fmt: skip
def test_physics_and_frames_come_whatever_the_environment_says(attempt, environment):
    attempt(
        "drawing", "words about OpenGL in the environment that do not work here", "physics and a frame; doctor ends"
    )
    code, said, errors = run(SHORT, **environment)
    assert code == 0, errors
    assert "Traceback" not in errors
    assert said.split("\n")[1] == "(480, 640, 3) True"
    done = subprocess.run(
        [sys.executable, "-m", "creative_nao", "doctor"], env=os.environ | environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert "dm_control task      works" in done.stdout or "needs dm-control" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize(
    "first",
    ["dm_control", "dm_control.mujoco", "dm_control.suite", "mujoco", "mujoco.egl", "OpenGL.GL", "glfw", "torch",
     "stable_baselines3", "matplotlib.pyplot", "creative_nao.robot"],
)  # fmt: skip
@needs_gl
def test_any_order_of_imports_draws_here_and_in_dm_control(attempt, first):
    pytest.importorskip("dm_control", reason="pip cannot install it on Python 3.13")
    attempt("drawing", "another library imported first", "a frame here and in dm_control")
    code = """
import importlib, sys
importlib.import_module(sys.argv[1])
import creative_nao.envs as envs, gymnasium as gym, threading
task = envs.load("boxing")
task.reset()
print(task.physics.render(64, 64).std() > 20)
thread = threading.Thread(target=lambda: print(task.physics.render(64, 64, camera_id="side").std() > 20))
thread.start()
thread.join()
env = gym.make("CreativeNao/BoxingMental-v0", render_mode="rgb_array")
env.reset()
print(env.render().std() > 20)
"""
    code, said, errors = run(code, first)
    assert code == 0, errors
    assert said == "True\n" * 3
    assert "Traceback" not in errors


@pytest.mark.slow
@needs_gl
@pytest.mark.parametrize("end", ["", "env.close()", "import sys; sys.exit(0)", "del env", "raise SystemExit"])
def test_a_program_ends_quietly(attempt, end):
    attempt("drawing", "a program that ends without close()", "nothing on standard error")
    assert run(f"{SHORT}\n{end}")[::2] == (0, "")


FORKED = """
import multiprocessing, sys
import gymnasium as gym, numpy as np

def make():
    return gym.make("creative_nao:CreativeNao/BoxingMental-v0", render_mode="rgb_array")

def draw(queue, env=None):
    env = env or make()
    env.reset(seed=0)
    queue.put(env.render().std() > 20)

if __name__ == "__main__":
    env = make()
    env.reset(seed=0)
    env.render()
    if "closed" in sys.argv:
        env.close()
    if "vector" in sys.argv:
        many = gym.vector.AsyncVectorEnv([make, make])
        many.reset(seed=0)
        many.call_async("render")
        print([bool(frame.std() > 20) for frame in many.call_wait(timeout=60)])
        many.close()
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    worker = context.Process(target=draw, args=(queue, env if "mine" in sys.argv else None))
    worker.start()
    print(queue.get(timeout=60))
    worker.join(60)
    print(worker.exitcode, env.render().std() > 20)
"""


@pytest.mark.slow
@needs_gl
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
@pytest.mark.parametrize("arguments", [(), ("closed",), ("mine",), ("vector", "closed")], ids=str)
def test_a_worker_forked_after_the_parent_has_drawn_draws_in_software(attempt, arguments):
    attempt("drawing", "a forked worker after the parent has drawn", "a frame in software, with one warning")
    code, said, errors = run(FORKED, *arguments)
    assert code == 0, errors
    assert said.endswith("True\n0 True\n")
    assert "OpenGL does not survive a fork" in errors
    assert "Traceback" not in errors


DRAWN_BY_OTHERS = """
import multiprocessing, sys
if sys.argv[1] == "mujoco":
    import mujoco
    renderer = mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 32, 32)
else:
    from dm_control import suite
    env = suite.load("cartpole", "swingup")
    env.physics.render(32, 32)

def draw(queue):
    import creative_nao, gymnasium
    env = gymnasium.make("CreativeNao/BoxingMental-v0", render_mode="rgb_array", width=64, height=48)
    env.reset()
    queue.put(env.render().shape)

context = multiprocessing.get_context("fork")
queue = context.Queue()
context.Process(target=draw, args=(queue,)).start()
print(queue.get(timeout=60))
"""


@pytest.mark.slow
@needs_gl
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
@pytest.mark.parametrize("library", ["mujoco", "dm_control"])
def test_a_worker_forked_after_another_library_has_drawn_draws_in_software(attempt, library):
    if library == "dm_control":
        pytest.importorskip("dm_control", reason="pip cannot install it on Python 3.13")
    attempt("drawing", "a forked worker after another library has drawn in the parent", "a frame in software")
    code, said, errors = run(DRAWN_BY_OTHERS, library, MUJOCO_GL="egl")
    assert code == 0, errors
    assert said == "(48, 64, 3)\n"
    assert "OpenGL does not survive a fork" in errors


@pytest.mark.slow
@pytest.mark.parametrize("display", ["", ":77"])
def test_human_without_a_display_leaves_python_alive(display):
    code = """
import gymnasium as gym, creative_nao
env = gym.make("CreativeNao/BoxingMental-v0", render_mode="human")
env.reset(seed=0)
try:
    env.step(env.action_space.sample())
except creative_nao.MissingDependencyError as error:
    print(error)
"""
    code, said, errors = run(code, DISPLAY=display, WAYLAND_DISPLAY="")
    assert code == 0, errors
    assert said.startswith('render_mode="human" opens a window, which needs a display (')
    assert 'use "rgb_array"' in said


@needs_gl
def test_insisting_on_opengl_in_a_forked_worker_is_refused(scene, monkeypatch):
    monkeypatch.setattr(opengl, "_inherited", True)
    with pytest.raises(MissingDependencyError, match="OpenGL does not survive a fork"):
        Renderer(scene.model, 8, 8, backend="gl")
