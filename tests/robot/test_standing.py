"""The robot stands on its own feet, in the guard above all."""

import mujoco
import numpy as np
import pytest

from creative_nao.errors import NotFoundError
from creative_nao.joints import JOINTS, limits
from creative_nao.robot import POSTURES, arm_angles, posture
from creative_nao.robot.performance import has_fallen, tilt_rad

THIGH_M, TIBIA_M = 0.1000, 0.1029  # hip to knee and knee to ankle, as in `nao.xml`


@pytest.mark.parametrize("name", POSTURES)
def test_it_stands_by_itself_for_ten_seconds(scene, data, name):
    scene.place(data, name)
    start = data.xpos[scene.index.torso].copy()
    mujoco.mj_step(scene.model, data, nstep=2000)
    torso = scene.index.torso_qpos
    assert tilt_rad(data.qpos[None, torso + 3 : torso + 7])[0] < 0.2
    np.testing.assert_allclose(data.xpos[scene.index.torso], start, atol=0.02)
    assert np.abs(data.qvel).max() < 0.01


def test_without_servos_it_falls(scene, data):
    """The claim above can fail."""
    scene.place(data, "Guard")
    model = scene.model
    disabled = model.opt.disableflags
    try:
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
        mujoco.mj_step(model, data, nstep=400)
    finally:
        model.opt.disableflags = disabled
    start = scene.index.torso_qpos
    torso = data.qpos[None, start : start + 7]
    assert has_fallen(torso[:, 2], tilt_rad(torso[:, 3:]))


@pytest.mark.parametrize("name", POSTURES)
def test_postures_respect_the_joint_ranges(scene, name):
    for joint, angle in posture(name).items():
        low, high = scene.model.joint(f"nao/{joint}").range
        assert low <= angle <= high, joint


def test_the_stance_has_flat_soles_and_one_foot_ahead(scene, data):
    scene.place(data, "Guard")
    left, right = (data.body(f"nao/{side}Foot") for side in "LR")
    for foot in (left, right):
        np.testing.assert_allclose(foot.xmat.reshape(3, 3), np.eye(3), atol=1e-9)
        assert foot.xpos[2] == pytest.approx(0.04519, abs=1e-9)
    assert left.xpos[0] - right.xpos[0] == pytest.approx(0.050, abs=1e-9)


@pytest.mark.parametrize(("side", "ahead_m", "outward_rad"), [("L", 0.025, 0.12), ("R", -0.025, -0.12)])
def test_the_legs_of_the_guard_put_a_flat_sole_where_the_stance_has_it(side, ahead_m, outward_rad):
    """Forward kinematics of two links in the leg's own plane, which leans outward; the torso stays upright."""
    guard = posture("Guard")
    hip, knee = guard[f"{side}HipPitch"], guard[f"{side}KneePitch"]
    forward = -THIGH_M * np.sin(hip) - TIBIA_M * np.sin(hip + knee)
    down = THIGH_M * np.cos(hip) + TIBIA_M * np.cos(hip + knee)
    assert (forward, down * np.cos(outward_rad)) == pytest.approx((ahead_m, 0.192), abs=1e-12)
    assert knee > 0
    assert hip + knee + guard[f"{side}AnklePitch"] == pytest.approx(0, abs=1e-12)
    assert (guard[f"{side}HipRoll"], guard[f"{side}AnkleRoll"]) == (outward_rad, -outward_rad)


def test_the_arms_of_the_guard_mirror_each_other():
    guard = arm_angles("Guard")
    np.testing.assert_array_equal(guard[4:], guard[:4] * [1, -1, -1, -1])
    low, high = limits(JOINTS)
    assert ((guard > low) & (guard < high)).all()


def test_an_unknown_posture_names_the_nearest():
    with pytest.raises(NotFoundError, match=r"no posture `Gard` \(did you mean `Guard`\?\)"):
        posture("Gard")


def test_a_posture_is_a_copy():
    posture("Guard")["HeadPitch"] = 99.0
    assert posture("Guard")["HeadPitch"] != 99.0
