"""Every figure of the compiled robot that is published: joints, links, postures, sensors, sizes, derived checks."""

import csv
from pathlib import Path

import mujoco
import numpy as np
import pytest

from creative_nao.joints import ENCODER_STEP_RAD, MAX_SPEED_RAD_S
from creative_nao.robot import POSTURES
from creative_nao.robot.postures import keeps_sign

FINGERS_KG = 0.001  # an estimate, taken off the published mass of the hand, which contains them
COUPLED = "RHipYawPitch"  # turned by the motor of the left one
REFERENCE = Path(__file__).parents[1] / "reference"


def rows(name):
    lines = (REFERENCE / name).read_text(encoding="utf-8").splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def vector(text):
    return np.array([float(part) for part in text.split()])


JOINT_ROWS, LINK_ROWS, POSTURE_ROWS = rows("nao_joints.csv"), rows("nao_links.csv"), rows("nao_postures.csv")
SIDED = [row for row in LINK_ROWS if row["link"][0] == "L"]

INERTIA_AT_JOINT = {  # felt in the zero pose without rotor [kg m2]; derived from the link table
    "ShoulderPitch": (0.0094, 5e-5),
    "ShoulderRoll": (0.0094, 5e-5),
    "ElbowYaw": (0.0001, 5e-5),
    "ElbowRoll": (0.0017, 5e-5),
    "WristYaw": (0.00007, 5e-6),
    "HipPitch": (0.024, 5e-4),
    "KneePitch": (0.006, 5e-4),
    "AnklePitch": (0.0007, 5e-5),
}
SENSORS_MM = {  # parent and place in its joint frame; [U5, U6, BH-D], feet on the sole of [A-L33]
    "accelerometer": ("Torso", (-8, 6.06, 27)),
    "gyrometer": ("Torso", (-8, 6, 29)),
    "LFoot_front_outer": ("LFoot", (70.25, 29.9, -45.19)),
    "LFoot_front_inner": ("LFoot", (70.25, -23.1, -45.19)),
    "LFoot_rear_outer": ("LFoot", (-30.25, 29.9, -45.19)),
    "LFoot_rear_inner": ("LFoot", (-29.65, -19.1, -45.19)),
    "RFoot_front_outer": ("RFoot", (70.25, -29.9, -45.19)),
    "RFoot_front_inner": ("RFoot", (70.25, 23.1, -45.19)),
    "RFoot_rear_outer": ("RFoot", (-30.25, -29.9, -45.19)),
    "RFoot_rear_inner": ("RFoot", (-29.65, 19.1, -45.19)),
}
SHELL_MM = {  # extents of the published shells in the link's joint frame at the zero pose [U5 outlines, as in OP]
    "Head": ((-60.6, -66.4, 0.1), (58.7, 66.4, 114.5)),
    "LUpperArm": ((-47, -25, -41), (122, 37, 41)),
    "LForearm": ((-15.7, -22, -23), (56.4, 28, 29)),
    "LHand": ((0, -34, -32), (85, 34, 31)),
    "LPelvis": ((-58.9, -39, -15), (23.9, 16, 43)),
    "LThigh": ((-45, -42, -127), (51, 49, 22)),
    "LTibia": ((-39, -41, -126), (52, 51, 25)),
    "LFoot": ((-60.7, -39.6, -45.9), (103.1, 52.6, 19.9)),
    "Torso": ((-52.5, -87.0, -95.9), (59.2, 87.0, 135.1)),
}


@pytest.fixture
def at_zero(scene, data):
    mujoco.mj_resetData(scene.model, data)
    data.qpos[scene.index.torso_qpos + 3] = 1.0
    for row in scene.index.qpos.values():
        data.qpos[row] = 0.0
    mujoco.mj_forward(scene.model, data)
    return data


@pytest.mark.parametrize("row", JOINT_ROWS, ids=lambda row: row["joint"])
def test_a_joint_turns_where_and_how_far_the_documentation_says(scene, row):
    joint = scene.model.joint(f"nao/{row['joint']}")
    body = scene.model.body(joint.bodyid[0])
    np.testing.assert_allclose(joint.pos, 0, atol=1e-12)
    np.testing.assert_allclose(body.pos, vector(row["offset_mm"]) / 1000, atol=1e-9)
    np.testing.assert_allclose(body.quat, [1, 0, 0, 0], atol=1e-12)
    if row["axis"]:
        np.testing.assert_allclose(joint.axis, vector(row["axis"]), atol=1e-4)
    assert tuple(joint.range) == (float(row["low_rad"]), float(row["high_rad"]))
    assert joint.limited[0] == 1


@pytest.mark.parametrize("row", JOINT_ROWS, ids=lambda row: row["joint"])
def test_a_motor_has_the_effort_and_the_speed_published_for_it(scene, row):
    effort, speed = float(row["effort_nm"]), float(row["speed_rad_s"])
    assert MAX_SPEED_RAD_S.get(row["joint"], speed) == speed
    if row["joint"] != COUPLED:
        actuator = scene.model.actuator(f"nao/{row['joint']}")
        assert tuple(actuator.forcerange) == (-effort, effort)
        assert tuple(actuator.ctrlrange) == (float(row["low_rad"]), float(row["high_rad"]))


def test_all_26_hinges_and_25_motors_are_those_of_the_table(scene):
    assert {row["joint"] for row in JOINT_ROWS} == set(scene.index.qpos)
    assert {row["joint"] for row in JOINT_ROWS} - {COUPLED} == set(scene.index.actuator)


def inertia_in_torso_axes(model, name):
    body = model.body(f"nao/{name}")
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, body.iquat)
    return turn.reshape(3, 3) @ np.diag(body.inertia) @ turn.reshape(3, 3).T


def expected_inertia(row, mirror):
    xx, yy, zz, xy, xz, yz = (float(row[name]) for name in ("xx", "yy", "zz", "xy", "xz", "yz"))
    xy, yz = mirror * xy, mirror * yz
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@pytest.mark.parametrize(
    ("row", "name", "mirror"),
    [(row, row["link"], 1) for row in LINK_ROWS] + [(row, "R" + row["link"][1:], -1) for row in SIDED],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_link_has_the_published_mass_centre_and_inertia_on_either_side(scene, row, name, mirror):
    body = scene.model.body(f"nao/{name}")
    fingers = FINGERS_KG if name.endswith("Hand") else 0.0
    assert body.mass[0] + fingers == pytest.approx(float(row["mass_kg"]), abs=1e-9)
    np.testing.assert_allclose(body.ipos, vector(row["com_mm"]) * [1, mirror, 1] / 1000, atol=1e-9)
    found = inertia_in_torso_axes(scene.model, name) * 1e6
    np.testing.assert_allclose(found, expected_inertia(row, mirror), atol=0.01)


def test_the_links_add_up_to_the_published_total():
    one_side = sum(float(row["mass_kg"]) for row in SIDED)
    trunk = sum(float(row["mass_kg"]) for row in LINK_ROWS if row not in SIDED)
    assert trunk + 2 * one_side == pytest.approx(5.35975, abs=1e-5)


@pytest.mark.parametrize("name", ["StandZero", "Stand", "StandInit", "Crouch"])
def test_a_predefined_posture_has_the_published_angles(name):
    published = {row["joint"]: float(row[name]) for row in POSTURE_ROWS}
    for joint in [row["joint"] for row in JOINT_ROWS]:
        left = "L" + joint[1:]
        same = joint[0] == "R" and keeps_sign(joint)
        expected = published.get(left if same else joint, 0.0)
        assert POSTURES[name].get(joint, 0.0) == pytest.approx(expected, abs=1e-12), joint


@pytest.mark.parametrize("joint", INERTIA_AT_JOINT)
def test_the_arms_and_legs_are_as_heavy_to_turn_as_their_links_make_them(scene, at_zero, joint):
    """Four public simulators count the parallel-axis shift twice: a thigh of theirs turns three times as heavily."""
    expected, tolerance = INERTIA_AT_JOINT[joint]
    full = np.zeros((scene.model.nv, scene.model.nv))
    mujoco.mj_fullM(scene.model, at_zero, full)
    for side in "LR":
        row = scene.index.dof[side + joint]
        felt = full[row, row] - scene.model.dof_armature[row]
        assert felt == pytest.approx(expected, abs=tolerance)


def test_a_horizontal_straight_arm_needs_the_derived_torque(scene, at_zero):
    rows_ = [scene.index.dof[side + "ShoulderPitch"] for side in "LR"]
    np.testing.assert_allclose(np.abs(at_zero.qfrc_bias[rows_]), 0.54, atol=0.005)


def test_the_straight_arm_is_as_long_as_the_links_say(at_zero):
    for side in "LR":
        reach = at_zero.site(f"nao/{side}Fist").xpos - at_zero.body(f"nao/{side}Shoulder").xpos
        assert reach[0] == pytest.approx(0.2187, abs=1e-9)


@pytest.mark.parametrize("name", SENSORS_MM)
def test_a_sensor_sits_at_its_published_place(scene, name):
    parent, place = SENSORS_MM[name]
    site = scene.model.site(f"nao/{name}")
    assert scene.model.body(site.bodyid[0]).name == f"nao/{parent}"
    np.testing.assert_allclose(site.pos, np.array(place) / 1000, atol=1e-9)


def test_an_encoder_has_twelve_bits():
    assert pytest.approx(0.001534, abs=1e-6) == ENCODER_STEP_RAD


def extent_mm(model, geom):
    """Axis-aligned box of a geom in its body's frame, lower and upper corner."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    axes, size, kind = turn.reshape(3, 3), model.geom_size[geom], model.geom_type[geom]
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        half = np.abs(axes[:, 2]) * size[1] + size[0]
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        half = np.abs(axes) @ size
    else:  # spheres and ellipsoids
        radii = size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else np.full(3, size[0])
        half = np.sqrt((axes**2) @ radii**2)
    return 1000 * (model.geom_pos[geom] - half), 1000 * (model.geom_pos[geom] + half)


@pytest.mark.parametrize("link", SHELL_MM)
def test_contact_shapes_stay_within_the_published_shells(scene, link):
    """To 17 mm: so far the published sphere of the pelvis sticks out and the forearm reaches into the hand."""
    low, high = (np.array(corner) for corner in SHELL_MM[link])
    body = scene.model.body(f"nao/{link}").id
    geoms = [geom for geom in np.flatnonzero(scene.index.robot_geoms) if scene.model.geom_bodyid[geom] == body]
    assert geoms
    for geom in geoms:
        found_low, found_high = extent_mm(scene.model, geom)
        assert (found_low >= low - 17).all()
        assert (found_high <= high + 17).all()
    middle = np.mean([np.add(*extent_mm(scene.model, geom)) / 2 for geom in geoms], axis=0)
    np.testing.assert_allclose(middle, (low + high) / 2, atol=36)
