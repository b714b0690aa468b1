"""The physics behaves: energy is kept, weight is carried, nothing sinks in, the bag swings as its shape says."""

import math

import mujoco
import numpy as np
import pytest

from creative_nao.robot import BAG_XML, NAO_XML, Scene, bare_scene

GRAVITY = 9.81
WITHOUT = mujoco.mjtDisableBit


def passive(path):
    """Hang the model of a file from the world; nothing damps it, drives it, limits it or touches it."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.dof_damping[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    off = WITHOUT.mjDSBL_ACTUATION | WITHOUT.mjDSBL_CONTACT | WITHOUT.mjDSBL_LIMIT | WITHOUT.mjDSBL_EQUALITY
    model.opt.disableflags |= off
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    return model


def energies(model, qpos, step_s, duration_s):
    """Potential, kinetic and total energy at each step [J] of a release from rest."""
    model.opt.timestep = step_s
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    found = []
    for _ in range(round(duration_s / step_s)):
        mujoco.mj_step(model, data)
        found.append(data.energy.copy())
    found = np.array(found)
    return found[:, 0], found[:, 1], found.sum(axis=1)


@pytest.fixture(scope="module")
def hanging_robot():
    return passive(NAO_XML)


@pytest.fixture(scope="module")
def arms_forward(hanging_robot):
    qpos = np.zeros(hanging_robot.nq)
    for side, sign in (("L", 1), ("R", -1)):
        qpos[hanging_robot.joint(f"{side}ElbowRoll").qposadr[0]] = -sign * 0.8
        qpos[hanging_robot.joint(f"{side}ShoulderRoll").qposadr[0]] = sign * 0.4
    return qpos


def test_arms_that_swing_freely_keep_their_energy_within_six_thousandths(hanging_robot, arms_forward):
    """Released from the horizontal, for two seconds, at a tenth of the step of the ring."""
    _, kinetic, total = energies(hanging_robot, arms_forward, 0.0005, 2.0)

    assert kinetic.max() > 1.2  # both arms and the legs really swing
    assert np.ptp(total) < 0.006 * kinetic.max()


def test_what_the_ring_loses_of_it_shrinks_in_proportion_to_the_step(hanging_robot, arms_forward):
    """The integrator is of first order: a tenth of the step, about a tenth of the error."""
    errors = [np.ptp(energies(hanging_robot, arms_forward, step, 1.0)[2]) for step in (0.005, 0.0005)]
    assert 7 < errors[0] / errors[1] < 13


def bag_period(mass=1.5, radius=0.12, length=0.40, chain=0.26):
    """Period of small swings of a capsule about the hook [s], T = 2 pi sqrt(I / (m g l)), from its closed form."""
    straight = length - 2 * radius
    cylinder, sphere = math.pi * radius**2 * straight, 4 / 3 * math.pi * radius**3
    density = mass / (cylinder + sphere)
    inertia = density * cylinder * (straight**2 / 12 + radius**2 / 4)
    inertia += density * sphere * (2 * radius**2 / 5 + straight**2 / 4 + 3 * straight * radius / 8)
    lever = chain + length / 2
    return 2 * math.pi * math.sqrt((inertia + mass * lever**2) / (mass * GRAVITY * lever))


@pytest.mark.parametrize("axis", ["x", "y"])
def test_the_bag_swings_with_the_period_of_the_formula(axis):
    model = passive(BAG_XML)
    model.opt.timestep = 0.001
    data = mujoco.MjData(model)
    row = model.joint(f"swing_{axis}").qposadr[0]
    data.qpos[row] = 0.02
    angles = []
    for _ in range(6000):
        mujoco.mj_step(model, data)
        angles.append(data.qpos[row])
    angles = np.array(angles)
    crossings = np.flatnonzero((angles[:-1] > 0) & (angles[1:] <= 0))
    exact = crossings + angles[crossings] / (angles[crossings] - angles[crossings + 1])
    period = np.diff(exact).mean() * 0.001

    assert len(crossings) >= 3
    assert period == pytest.approx(bag_period(), rel=0.001)


def test_a_swing_of_the_bag_dies_as_its_damping_says(scene, data):
    """Amplitude falls as exp(-t c / 2 I); within two and a half seconds less than a tenth is left."""
    scene.place(data, "Guard")
    row = scene.model.joint("bag/swing_x").qposadr[0]
    data.qpos[row] = 0.1
    mujoco.mj_step(scene.model, data, nstep=500)
    tail = []
    for _ in range(300):
        mujoco.mj_step(scene.model, data)
        tail.append(abs(data.qpos[row]))
    assert 0.0001 < max(tail) < 0.02


def test_the_floor_carries_the_robot_and_nothing_more(scene, data):
    scene.place(data, "Guard")
    mujoco.mj_step(scene.model, data, nstep=400)
    force, pressed = np.zeros(6), 0.0
    for number in range(data.ncon):
        contact = data.contact[number]
        assert scene.index.floor_geom in contact.geom
        mujoco.mj_contactForce(scene.model, data, number, force)
        pressed += force[0]
    weight = scene.model.body_subtreemass[scene.index.torso] * GRAVITY

    assert pressed == pytest.approx(weight, rel=1e-4)
    felt = sum(data.sensor(f"nao/{side}Foot_touch").data[0] for side in "LR")
    assert felt == pytest.approx(weight, rel=1e-4)


def test_both_feet_share_the_weight_as_the_stance_leans(scene, data):
    scene.place(data, "StandInit")
    mujoco.mj_step(scene.model, data, nstep=400)
    left, right = (data.sensor(f"nao/{side}Foot_touch").data[0] for side in "LR")
    assert left == pytest.approx(right, rel=0.02)


@pytest.mark.parametrize("name", ["left_jab", "right_straight", "left_hook", "right_hook", "left_uppercut"])
def test_nothing_sinks_into_anything_while_it_boxes(scene, data, performances, name):
    """Soles stay within 1 mm of the floor's surface; a fist presses at most 6 mm into the leather."""
    floor, leather = 0.0, 0.0
    for snapshot in performances[name].frames:
        data.qpos[:] = snapshot
        mujoco.mj_kinematics(scene.model, data)
        mujoco.mj_collision(scene.model, data)
        for number in range(data.ncon):
            contact = data.contact[number]
            depth = -contact.dist
            if scene.index.floor_geom in contact.geom:
                floor = max(floor, depth)
            elif scene.index.bag_geom in contact.geom:
                leather = max(leather, depth)
    assert 0 < floor < 0.001
    assert leather < 0.006


def test_a_robot_at_rest_keeps_still(scene, data):
    scene.place(data, "Guard")
    mujoco.mj_step(scene.model, data, nstep=400)
    before = data.qpos.copy()
    mujoco.mj_step(scene.model, data, nstep=400)
    np.testing.assert_allclose(data.qpos, before, atol=2e-4)


def test_what_is_left_away_for_computing_changes_no_bit():
    """`bare_scene` has the same states after a second of a punch-like push."""
    found = []
    for scene in (Scene(), bare_scene()):
        data = mujoco.MjData(scene.model)
        scene.place(data, "Guard")
        data.ctrl[scene.index.actuator["RShoulderPitch"]] = 0.1
        data.ctrl[scene.index.actuator["RElbowRoll"]] = 0.05
        mujoco.mj_step(scene.model, data, nstep=200)
        found.append(data.qpos.copy())
    assert np.array_equal(*found)
    assert scene.model.ngeom < 30
