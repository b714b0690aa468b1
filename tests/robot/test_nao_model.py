"""The compiled robot has the published masses, lengths and ranges."""

import mujoco
import numpy as np
import pytest

from creative_nao.joints import JOINTS, LIMITS_RAD, MAX_SPEED_RAD_S
from creative_nao.robot import Nao, place, tables
from creative_nao.robot.nao import COUPLED, MOTOR_JOINTS
from creative_nao.robot.shells import shapes

COM_ABOVE_SOLE_M = {"StandZero": 0.300, "Stand": 0.280, "StandInit": 0.274, "Crouch": 0.201}
TORSO_ABOVE_SOLE_M = {"StandZero": 0.333, "Stand": 0.332, "StandInit": 0.320, "Crouch": 0.228}
COM_AHEAD_OF_ANKLE_M = {"StandZero": 0.021, "Stand": -0.010, "StandInit": 0.023, "Crouch": 0.020}

# ShoulderPitch, ShoulderRoll, ElbowYaw, ElbowRoll, WristYaw of the right arm; fist centre in the torso frame.
RIGHT_FIST_IN_TORSO_M = [
    ((0.5, 0.0, 1.2, 1.54, 0), (0.144, -0.060, 0.137)),
    ((0.6, 0.1, 1.2, 1.54, 0), (0.143, -0.050, 0.125)),
    ((1.0, 0.1, 1.3, 1.54, -1.6), (0.156, -0.071, 0.060)),
    ((0.0, 0.15, 1.2, 0.05, 0), (0.216, -0.067, 0.101)),
    ((-0.1, 0.2, 1.2, 0.05, 0), (0.213, -0.056, 0.122)),
    ((0.2, -1.0, 0.0, 1.4, 0), (0.143, -0.150, 0.058)),
]


def body(scene, data, name):
    return data.body(f"nao/{name}")


def test_the_robot_weighs_what_its_links_weigh(scene):
    assert scene.model.body_subtreemass[scene.index.torso] == pytest.approx(5.36, abs=1e-3)
    assert scene.model.body_subtreemass[scene.index.torso] == pytest.approx(tables.TOTAL_MASS_KG, abs=1e-9)


@pytest.mark.parametrize("name", COM_ABOVE_SOLE_M)
def test_the_centre_of_mass_is_where_the_reference_has_it(scene, data, name):
    scene.place(data, name)
    torso = scene.index.torso
    com, ankle = data.subtree_com[torso], body(scene, data, "LFoot").xpos
    along_foot = body(scene, data, "LFoot").xmat.reshape(3, 3)[:, 0]
    assert com[2] == pytest.approx(COM_ABOVE_SOLE_M[name], abs=0.003)
    assert data.xpos[torso][2] == pytest.approx(TORSO_ABOVE_SOLE_M[name], abs=0.003)
    assert (com - ankle) @ along_foot == pytest.approx(COM_AHEAD_OF_ANKLE_M[name], abs=0.004)


@pytest.mark.parametrize("side", ["R", "L"])
@pytest.mark.parametrize(("angles", "expected"), RIGHT_FIST_IN_TORSO_M)
def test_the_fist_is_where_the_reference_has_it(scene, data, side, angles, expected):
    mirror = np.ones(5) if side == "R" else np.array([1, -1, -1, -1, -1])
    for joint, angle in zip((*JOINTS[:4], "RWristYaw"), np.array(angles) * mirror, strict=True):
        data.qpos[scene.index.qpos[side + joint[1:]]] = angle
    mujoco.mj_kinematics(scene.model, data)
    torso = body(scene, data, "Torso")
    fist = torso.xmat.reshape(3, 3).T @ (data.site(f"nao/{side}Fist").xpos - torso.xpos)
    reflected = np.array(expected) * [1, 1 if side == "R" else -1, 1]
    np.testing.assert_allclose(fist, reflected, atol=0.002)


def test_limits_of_the_arms_are_those_of_the_joint_table(scene):
    for joint in JOINTS:
        assert tuple(scene.model.joint(f"nao/{joint}").range) == LIMITS_RAD[joint]
        assert tuple(scene.model.actuator(f"nao/{joint}").ctrlrange) == LIMITS_RAD[joint]


def test_every_motor_is_limited_to_its_published_effort(scene):
    for link in tables.links():
        if link.joint in MOTOR_JOINTS:
            effort = link.motor.effort_nm
            assert tuple(scene.model.actuator(f"nao/{link.joint}").forcerange) == (-effort, effort)


def test_motors_are_no_faster_than_the_joint_table_says():
    speeds = {link.joint: link.motor.speed_rad_s for link in tables.links()}
    assert {joint: speeds[joint] for joint in JOINTS} == MAX_SPEED_RAD_S


def test_one_motor_turns_both_hips(scene, data):
    assert len(MOTOR_JOINTS) == scene.model.nu == 25
    scene.place(data, "StandInit")
    data.ctrl[scene.index.actuator[COUPLED[0]]] = -0.3
    mujoco.mj_step(scene.model, data, nstep=200)
    left, right = (data.qpos[scene.index.qpos[joint]] for joint in COUPLED)
    assert left < -0.1
    assert left == pytest.approx(right, abs=0.02)


@pytest.mark.parametrize("name", ["StandZero", "Stand", "StandInit", "Crouch"])
def test_left_and_right_mirror_each_other(scene, data, name):
    place(scene.model, data, scene.index, name)
    torso = body(scene, data, "Torso")
    turn = torso.xmat.reshape(3, 3)
    for link in tables.LEFT:
        if name == "Stand" and link.name in ("LHand", "LFingers"):
            continue  # the published Stand turns both wrists by the same angle, which is no mirror image
        left, right = (
            turn.T @ (body(scene, data, part).xipos - torso.xpos) for part in (link.name, tables.other_side(link.name))
        )
        np.testing.assert_allclose(right, left * [1, -1, 1], atol=1e-6)


def test_inertia_of_the_left_is_reflected_to_the_right():
    left = next(link for link in tables.LEFT if link.name == "LUpperArm")
    right = tables.mirrored(left)
    assert right.inertia_e6 == (95.29, 272.74, 248.17, 40.11, -13.74, 4.35)
    assert right.com_mm == (24.55, -5.63, 3.30)
    assert right.range_rad == (-1.3265, 0.3142)
    assert tables.mirrored(right).inertia_e6 == left.inertia_e6


def test_the_robot_is_as_tall_as_the_data_sheet_says(scene, data):
    scene.place(data, "StandZero")
    skull = data.geom("nao/skull")
    top = skull.xpos[2] + scene.model.geom("nao/skull").size[2]
    assert top == pytest.approx(0.574, abs=0.001)


def test_shapes_add_no_mass_and_only_named_ones_touch(scene):
    assert all(bool(shape.name) == shape.contact for shape in shapes())
    touching = np.flatnonzero(scene.index.robot_geoms)
    assert len(touching) == sum(shape.contact for shape in shapes())
    assert scene.model.body("nao/Head").mass[0] == pytest.approx(0.65973)


def test_the_robot_brings_no_physics_options_of_its_own():
    """Options of an attached model would silently change those of the ring."""
    assert "<option" not in Nao().mjcf_model.to_xml_string()
