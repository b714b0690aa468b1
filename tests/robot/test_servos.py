"""Stiffness limits the torque of single motors at run time."""

import numpy as np
import pytest

from creative_nao.errors import SettingsError
from creative_nao.joints import JOINTS
from creative_nao.robot import Scene


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


@pytest.mark.parametrize("stiffness", [-0.1, 1.1, float("nan")])
def test_stiffness_lies_between_limp_and_full(own_scene, stiffness):
    with pytest.raises(SettingsError, match=r"`stiffness` should lie between 0 \(limp\) and 1"):
        own_scene.stiffness.set(JOINTS, stiffness)


def test_a_joint_without_a_motor_of_its_own_is_named(own_scene):
    with pytest.raises(SettingsError, match="'RHipYawPitch' is none of"):
        own_scene.stiffness.set(("RHipYawPitch",), 0.5)
