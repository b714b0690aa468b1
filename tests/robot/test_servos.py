"""Stiffness limits the torque of single motors at run time."""

import numpy as np
import pytest

from creative_nao.errors import SettingsError
from creative_nao.joints import JOINTS
from creative_nao.robot import Scene, ServoSettings


@pytest.fixture(scope="module")
def own_scene():
    return Scene(with_bag=False)


def test_stiffness_scales_the_torque_of_the_named_joints_only(own_scene):
    full = own_scene.model.actuator_forcerange.copy()
    own_scene.stiffness.set(JOINTS[:4], 0.25)
    arms = own_scene.index.arm_actuator
    scaled = own_scene.model.actuator_forcerange
    np.testing.assert_array_equal(scaled[arms[:4]], 0.25 * full[arms[:4]])
    np.testing.assert_array_equal(scaled[arms[4:]], full[arms[4:]])
    own_scene.stiffness.set(JOINTS[:4], 0.5)
    np.testing.assert_array_equal(own_scene.model.actuator_forcerange[arms[:4]], 0.5 * full[arms[:4]])
    own_scene.stiffness.reset()
    np.testing.assert_array_equal(own_scene.model.actuator_forcerange, full)


GAINS = ("actuator_gainprm", "actuator_biasprm", "dof_damping", "dof_frictionloss")


def test_the_gains_of_the_model_file_are_the_defaults_of_the_settings(own_scene):
    explicit = Scene(with_bag=False, servos=ServoSettings()).model
    for array in GAINS:
        np.testing.assert_array_equal(getattr(explicit, array), getattr(own_scene.model, array), err_msg=array)


def test_other_gains_reach_their_joints():
    settings = ServoSettings(arm_kp=30.0, arm_kd=0.8, leg_kp=90.0, hand_kd=0.01, damping=0.1, friction_loss=0.0)
    scene = Scene(servos=settings)
    for joint, kp, kd in (
        ("RElbowRoll", 30.0, 0.8),
        ("HeadYaw", 30.0, 0.8),
        ("LKneePitch", 90.0, 2.0),
        ("LHand", 1.0, 0.01),
    ):
        row = scene.index.actuator[joint]
        assert scene.model.actuator_gainprm[row, 0] == kp
        assert scene.model.actuator_biasprm[row, :3].tolist() == [0, -kp, -kd]
    hinges = list(scene.index.dof.values())
    assert set(scene.model.dof_damping[hinges]) == {0.1}
    assert set(scene.model.dof_frictionloss[hinges]) == {0.0}
    assert scene.model.dof_damping[scene.model.joint("bag/swing_x").dofadr[0]] == 0.6


@pytest.mark.parametrize("stiffness", [-0.1, 1.1, float("nan")])
def test_stiffness_lies_between_limp_and_full(own_scene, stiffness):
    with pytest.raises(SettingsError, match=r"`stiffness` should be (at least 0|at most 1|a finite number)"):
        own_scene.stiffness.set(JOINTS, stiffness)


def test_a_joint_without_a_motor_of_its_own_is_named(own_scene):
    with pytest.raises(SettingsError, match="'RHipYawPitch' is none of"):
        own_scene.stiffness.set(("RHipYawPitch",), 0.5)
