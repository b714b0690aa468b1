"""Without any OpenGL the same picture comes out, a little slower: robot, colours, movement, silhouette."""

import os
import subprocess
import sys
import time

import mujoco
import numpy as np
import pytest

from creative_nao.errors import SettingsError
from creative_nao.robot import Renderer, can_draw, imagined_frames
from creative_nao.robot.software_rendering import SoftwareCanvas

needs_gl = pytest.mark.skipif(not can_draw(), reason="this machine has no off-screen GL to compare with")

WITHOUT_GL = """
import sys, time, numpy as np
from creative_nao.robot import Renderer, Scene, imagined_frames
from creative_nao.demonstrations import load_demonstrations
scene = Scene()
demos = load_demonstrations()
frames = imagined_frames(scene, demos.trajectory("right_straight"), demos.dt_s)
away = frames[0].copy()
away[scene.index.torso_qpos] -= 50
with Renderer(scene.model, 160, 120) as renderer:
    print(renderer.software, any(name.startswith("OpenGL") for name in sys.modules))
    np.savez(sys.argv[1], *(renderer.frame(qpos) for qpos in (frames[0], frames[len(frames) // 6], away)))
"""


def without_gl(tmp_path, **environment):
    """Draw guard, punch and empty ring in a fresh interpreter; return the pictures, stdout and stderr."""
    path = tmp_path / "frames.npz"
    command = [sys.executable, "-W", "error", "-c", WITHOUT_GL, str(path)]
    done = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    with np.load(path) as found:
        return [found[name] for name in found.files], done.stdout.split(), done.stderr


def test_with_mujoco_gl_disabled_frames_come_out_without_a_word(tmp_path):
    (guard, punch, empty), said, errors = without_gl(tmp_path, MUJOCO_GL="disable")

    assert (said, errors) == (["True", "False"], "")
    assert guard.shape == (120, 160, 3)
    assert guard.dtype == np.uint8
    red = (guard[..., 0] > 150) & (guard[..., 1] < 60)
    white = (guard > 200).all(axis=2)
    assert red.sum() > 50, "the gloves"
    assert white.sum() > 300, "the shell"
    assert 0.05 < (guard != empty).any(axis=2).mean() < 0.5
    assert 0.005 < (guard != punch).any(axis=2).mean() < 0.3


@pytest.fixture(scope="module")
def punch(scene, demos):
    frames = imagined_frames(scene, demos.trajectory("right_straight"), demos.dt_s)
    arms = frames[:, scene.index.arm_qpos]
    return frames[int(np.abs(arms - arms[0]).sum(axis=1).argmax())]


@needs_gl
@pytest.mark.parametrize("camera", ["close", "ringside", "side", "left"])
def test_the_silhouette_is_that_of_opengl(scene, punch, camera):
    away = punch.copy()
    away[scene.index.torso_qpos] -= 50
    masks, pictures = [], []
    for backend in ("gl", "software"):
        with Renderer(scene.model, 320, 240, backend=backend) as renderer:
            pictures.append(renderer.frame(punch, camera).astype(int))
            masks.append((np.abs(pictures[-1] - renderer.frame(away, camera)) > 8).any(axis=2))
    gl, software = masks

    assert (gl & software).sum() / (gl | software).sum() > 0.97
    assert np.abs(pictures[0] - pictures[1]).mean() < 6  # of 255


@needs_gl
def test_distances_are_those_of_opengl(scene, punch):
    depths = []
    for backend in ("gl", "software"):
        with Renderer(scene.model, 160, 120, backend=backend) as renderer:
            depths.append(renderer.depth(punch, "close"))
    off = np.abs(depths[0] - depths[1])[depths[1] < 10] > 0.01  # OpenGL's sky is a box 18 m away, here it is the end

    assert depths[1].dtype == np.float32
    assert len(off) > 10_000
    assert off.mean() < 0.03  # edges, where neighbouring pixels see different things
    assert np.median(np.abs(depths[0] - depths[1])) < 1e-3


def test_a_small_frame_takes_less_than_a_second(scene, punch):
    """Processor time: the machine may be busy with other things."""
    with Renderer(scene.model, 320, 240, backend="software") as renderer:
        renderer.frame(punch)
        began = time.process_time()
        renderer.frame(punch)
        assert time.process_time() - began < 1.0


def test_equal_states_give_equal_frames_and_smooth_ones_are_softer(scene, punch):
    with Renderer(scene.model, 80, 60, backend="software") as plain:
        assert np.array_equal(plain.frame(punch), plain.frame(punch))
        hard = plain.frame(punch)
    with Renderer(scene.model, 80, 60, backend="software", smooth=2) as renderer:
        soft = renderer.frame(punch)
    assert soft.shape == hard.shape
    assert len(np.unique(soft.reshape(-1, 3), axis=0)) > len(np.unique(hard.reshape(-1, 3), axis=0))


def test_a_closed_renderer_and_an_unknown_back_end_are_told(scene):
    renderer = Renderer(scene.model, 8, 8, backend="software")
    renderer.close()
    with pytest.raises(SettingsError, match="this renderer is closed"):
        renderer.frame(scene.guard_qpos())
    with pytest.raises(SettingsError, match="`backend` should be one of auto, gl, software, but is 'cpu'"):
        Renderer(scene.model, 8, 8, backend="cpu")


def test_a_model_without_sky_and_without_materials():
    """A red pane before a green wall, lit from everywhere; above the wall, nothing."""
    xml = """<mujoco><visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual><worldbody>
      <geom type="box" size="0.3 0.01 0.3" pos="0 1 0" rgba="1 0 0 1"/>
      <geom type="box" size="3 0.01 1" pos="0 2 0" rgba="0 1 0 1"/>
      <camera name="eye" pos="0 0 0" xyaxes="1 0 0 0 0 1" fovy="60"/></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    canvas = SoftwareCanvas(model, 40, 30)
    picture = canvas.draw(data, 0)

    assert picture[15, 20].tolist() == [255, 0, 0]
    assert picture[15, 3].tolist() == [0, 255, 0]
    assert picture[0, 20].tolist() == [31, 31, 31]
    assert canvas.depth()[15, 20] == pytest.approx(0.99)
    assert canvas.depth()[15, 3] == pytest.approx(1.99)
