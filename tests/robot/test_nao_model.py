"""The compiled robot has the published masses, lengths and ranges."""

import csv
from pathlib import Path

import mujoco
import numpy as np
import pytest

from creative_nao.joints import JOINTS, LIMITS_RAD, MAX_SPEED_RAD_S
from creative_nao.robot import BAG_XML, NAO_XML, RING_XML, SCENE_XML, place, scene

COUPLED = ("LHipYawPitch", "RHipYawPitch")
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


SOURCES = Path(scene.__file__).with_name("nao_sources.csv")
TABLE = list(csv.reader(line for line in SOURCES.read_text(encoding="utf-8").splitlines() if line[0] != "#"))[1:]
FIGURES = {(element, figure): [float(part) for part in value.split()] for element, figure, value, _, _ in TABLE}
LEGEND = {"L", "J", "U6", "UE", "DS6", "estimate", "U6 less the fingers"}


def full_inertia(model, name):
    """xx, yy, zz, xy, xz, yz about the centre of mass in the axes of the link."""
    body, turn = model.body(name), np.zeros(9)
    mujoco.mju_quat2Mat(turn, body.iquat)
    tensor = turn.reshape(3, 3) @ np.diag(body.inertia) @ turn.reshape(3, 3).T
    return tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


FOUND = {  # how each figure of the table of sources is read from the compiled robot
    "mass": lambda model, name: model.body(name).mass,
    "com": lambda model, name: model.body(name).ipos,
    "inertia": full_inertia,
    "offset": lambda model, name: model.body(model.joint(name).bodyid[0]).pos,
    "axis": lambda model, name: model.joint(name).axis,
    "range": lambda model, name: model.joint(name).range,
    "armature": lambda model, name: model.dof_armature[model.joint(name).dofadr],
    "effort": lambda model, name: model.actuator(name).forcerange[1:],
}


@pytest.fixture(scope="module")
def alone():
    """The robot of its own file, as anyone can open it."""
    return mujoco.MjModel.from_xml_path(str(NAO_XML))


@pytest.mark.parametrize("figure", FOUND)
def test_every_figure_of_the_robot_is_that_of_the_table_of_sources(alone, figure):
    rows = [(name, value) for (name, kind), value in FIGURES.items() if kind == figure]
    assert len(rows) in (26, 27)
    for name, value in rows:
        if figure == "effort" and name == COUPLED[1]:
            continue  # the left one's motor turns it
        np.testing.assert_allclose(FOUND[figure](alone, name), value, rtol=1e-12, atol=1e-12, err_msg=name)


def test_every_figure_has_a_unit_and_a_source():
    assert len({tuple(row[:2]) for row in TABLE}) == len(TABLE) == 3 * 27 + 6 * 26
    assert {row[4] for row in TABLE} <= LEGEND
    assert all(row[3] for row in TABLE)


@pytest.mark.parametrize("path", [NAO_XML, BAG_XML, RING_XML, SCENE_XML], ids=lambda path: path.name)
def test_each_file_opens_by_itself_and_shows_something(path):
    """As in `python -m mujoco.viewer --mjcf=nao.xml`."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    assert np.isfinite(data.qpos).all()
    assert ((model.geom_group <= 2) & (model.geom_matid >= 0)).sum() >= 10


def test_the_legs_of_the_postures_are_as_long_as_the_model_s(alone):
    assert -alone.body("LTibia").pos[2] == 0.1000
    assert -alone.body("LAnkle").pos[2] == 0.1029


def body(scene, data, name):
    return data.body(f"nao/{name}")


def test_the_robot_weighs_what_its_links_weigh(scene):
    assert scene.model.body_subtreemass[scene.index.torso] == pytest.approx(5.36, abs=1e-3)
    links = sum(value[0] for (_, figure), value in FIGURES.items() if figure == "mass")
    assert scene.model.body_subtreemass[scene.index.torso] == pytest.approx(links, abs=1e-9)


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
    for joint in scene.index.actuator:
        (effort,) = FIGURES[joint, "effort"]
        assert tuple(scene.model.actuator(f"nao/{joint}").forcerange) == (-effort, effort)
    assert scene.index.arm_effort_nm.tolist() == [FIGURES[joint, "effort"][0] for joint in JOINTS]


def test_motors_are_no_faster_than_the_joint_table_says():
    assert {joint: FIGURES[joint, "speed"][0] for joint in JOINTS} == MAX_SPEED_RAD_S


def test_one_motor_turns_both_hips(scene, data):
    assert len(scene.index.actuator) == scene.model.nu == 25
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
    links = [element for element, figure in FIGURES if figure == "mass" and element[0] == "L"]
    assert len(links) == 12
    for link in links:
        if name == "Stand" and link in ("LHand", "LFingers"):
            continue  # the published Stand turns both wrists by the same angle, which is no mirror image
        left, right = (turn.T @ (body(scene, data, part).xipos - torso.xpos) for part in (link, "R" + link[1:]))
        np.testing.assert_allclose(right, left * [1, -1, 1], atol=1e-6)


def test_inertia_of_the_left_is_reflected_to_the_right():
    for (element, figure), left in FIGURES.items():
        if figure == "inertia" and element[0] == "L":
            signs = np.array([1, 1, 1, -1, 1, -1])
            np.testing.assert_array_equal(FIGURES["R" + element[1:], figure], left * signs)


def test_the_robot_is_as_tall_as_the_data_sheet_says(scene, data):
    scene.place(data, "StandZero")
    skull = data.geom("nao/skull")
    top = skull.xpos[2] + scene.model.geom("nao/skull").size[2]
    assert top == pytest.approx(0.574, abs=0.001)


def test_shapes_add_no_mass_and_only_named_ones_touch(alone, scene):
    names = [alone.geom(number).name for number in range(alone.ngeom)]
    assert [bool(name) for name in names] == (alone.geom_contype != 0).tolist()
    assert scene.index.robot_geoms.sum() == sum(map(bool, names)) == 18
    assert scene.model.body("nao/Head").mass[0] == FIGURES["Head", "mass"][0]


def test_the_robot_brings_no_physics_options_of_its_own():
    """Options of an attached model would silently change those of the ring."""
    assert "<option" not in NAO_XML.read_text(encoding="utf-8")


def test_numbers_of_the_model_files_are_written_in_full():
    """A rounded digit would move the bits of every published result."""
    model = mujoco.MjModel.from_xml_path(str(SCENE_XML))
    assert model.body("nao/LForearm").ipos[0] == 25.56 / 1000
    assert model.jnt_axis[model.joint("nao/LHipYawPitch").id][1] == 0.5**0.5
