"""The standing robot performs a trajectory, and the same one always in the same way."""

from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.joints import ENCODER_STEP_RAD, JOINTS
from creative_nao.robot import Performer, Scene

ACTIONS = ("left_jab", "right_straight", "left_hook", "right_hook", "left_uppercut", "right_uppercut")


@pytest.mark.parametrize("name", ACTIONS)
def test_a_basic_action_is_performed_without_fall_or_exhaustion(performances, name):
    performance = performances[name]
    assert not performance.fell
    assert performance.mean_error_rad.max() < 0.06
    assert performance.saturated_share.max() < 0.02
    assert performance.self_collision_share < 0.02
    assert performance.largest_tilt_rad < 0.05


@pytest.mark.parametrize("name", ["left_jab", "right_straight", "left_hook", "right_hook"])
def test_punches_hit_the_bag_and_move_it(scene, performances, name):
    performance = performances[name]
    assert performance.hits.count >= 3
    assert performance.hits.peak_force_n > 5
    swing = [scene.model.joint(f"bag/swing_{axis}").qposadr[0] for axis in "xy"]
    assert np.abs(performance.frames[:, swing]).max() > 0.05


def test_standing_in_the_guard_touches_nothing(scene, performer, still):
    performance = performer.perform(still, 0.15, keep_frames=True)
    assert performance.hits.count == 0
    assert performance.hits.impulse_ns == 0.0
    assert performance.self_collision_share == 0.0
    assert performance.mean_error_rad.max() < 0.02
    assert performance.fist_peak_speed_m_s.max() < 0.01


def test_measured_angles_are_encoder_counts_close_to_the_commanded(performances, demos):
    performance = performances["right_straight"]
    assert performance.measured.shape == (50, 8)
    counts = performance.measured / ENCODER_STEP_RAD
    np.testing.assert_allclose(counts, counts.round(), atol=1e-6)
    assert np.abs(performance.measured - performance.commanded).mean() < 0.02
    np.testing.assert_array_equal(performance.commanded, demos.trajectories[1])


def test_equal_trajectories_give_equal_bits_in_any_order(scene, demos):
    first, other = demos.trajectories[:2]
    one, two = Performer(scene), Performer(Scene())
    expected = one.perform(first, demos.dt_s, keep_frames=True)
    one.perform(other, demos.dt_s)
    two.perform(other, demos.dt_s)
    for performer in (one, two):
        again = performer.perform(first, demos.dt_s, keep_frames=True)
        assert np.array_equal(again.frames, expected.frames)
        assert np.array_equal(again.mean_error_rad, expected.mean_error_rad)
        assert again.hits == expected.hits
    assert not np.array_equal(one.perform(other, demos.dt_s, keep_frames=True).frames, expected.frames)


def test_performers_of_one_scene_work_side_by_side(scene, demos, performances):
    def perform(name):
        trajectory = demos.trajectories[demos.names.index(name)]
        return Performer(scene).perform(trajectory, demos.dt_s).measured

    with ThreadPoolExecutor(2) as pool:
        for name, measured in zip(ACTIONS[:2], pool.map(perform, ACTIONS[:2]), strict=True):
            assert np.array_equal(measured, performances[name].measured)


def test_it_steps_bit_for_bit_like_a_loop_over_mj_step(scene, performer, still):
    moving = still.copy()
    moving[5:10, 0] -= 0.5
    targets, approach = performer._targets(moving, 0.15, 15)
    assert approach == 0
    states, _ = performer._run(targets)
    data = mujoco.MjData(scene.model)
    mujoco.mj_setState(scene.model, data, performer._start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    data.qacc_warmstart[:] = performer._warmstart
    data.ctrl[:] = performer._control
    before = performer.guard
    for target in targets:
        for part in (0.5, 1.0):
            data.ctrl[scene.index.arm_actuator] = before + (target - before) * part
            mujoco.mj_step(scene.model, data)
        before = target
    assert np.array_equal(states[-1, 1 : 1 + scene.model.nq], data.qpos)


def test_the_way_to_another_first_posture_is_not_part_of_the_performance(performer, still):
    elsewhere = still.copy()
    elsewhere[:, [0, 4]] += 0.5
    performance = performer.perform(elsewhere, 0.15, keep_frames=True)
    assert np.abs(performance.measured[0] - elsewhere[0]).max() < 0.02
    assert performance.mean_error_rad.max() < 0.02
    assert len(performance.measured) == len(elsewhere)
    assert len(performance.frames) == 61
    assert performance.duration_s == pytest.approx(3.0)


def test_a_single_posture_can_be_performed(performer):
    performance = performer.perform(performer.guard[None], 0.15)
    assert performance.measured.shape == (1, 8)
    assert not performance.fell


def test_targets_beyond_the_ranges_are_clipped_and_reported(performer, still):
    beyond = still.copy()
    beyond[:, 3] = 1.5446 + 0.2
    performance = performer.perform(beyond, 0.15)
    assert performance.limit_excess_rad == pytest.approx(0.2)
    assert performance.measured[:, 3].max() < 1.56


def test_a_jump_is_followed_no_faster_than_the_motor_turns(performer, still):
    jump = still[:3].copy()
    jump[1:, 0] -= 1.5
    targets, _ = performer._targets(jump, 0.01, 1)
    assert np.abs(np.diff(targets[:, 0])).max() <= 0.0794 + 1e-12


def test_limp_arms_hang_down(demos):
    scene = Scene(with_bag=False)
    scene.stiffness.set(JOINTS, 0.0)
    limp = Performer(scene).perform(demos.trajectories[1], demos.dt_s)
    assert limp.mean_error_rad.max() > 0.4
    assert limp.measured[-1, [0, 4]].min() > 1.2, "upper arms point down"
    assert np.abs(limp.measured[-1, [3, 7]]).max() < 0.9, "elbows open"
    scene.stiffness.reset()
    assert Performer(scene).perform(demos.trajectories[1], demos.dt_s).mean_error_rad.max() < 0.06


@pytest.mark.parametrize("shape", [(50,), (50, 7), (0, 8), (2, 50, 8)])
def test_a_wrong_shape_is_named(performer, shape):
    with pytest.raises(ShapeError, match=r"`trajectory` should have shape \(n_steps >= 1, 8\)"):
        performer.perform(np.zeros(shape), 0.15)


def test_angles_that_are_no_numbers_are_refused(performer, still):
    broken = still.copy()
    broken[3, 2] = np.nan
    with pytest.raises(ShapeError, match="RElbowYaw at step 3 is not a number"):
        performer.perform(broken, 0.15)


@pytest.mark.parametrize("dt_s", [0.0, -0.15, 0.155, 0.004])
def test_a_tick_is_a_whole_number_of_cycles(performer, still, dt_s):
    with pytest.raises(SettingsError, match="whole number of the robot's 10 ms cycles"):
        performer.perform(still, dt_s)


def test_data_is_the_state_at_the_end_and_can_be_put_back(scene, demos):
    performer = Performer(scene)
    start = performer.data.qpos.copy()
    performance = performer.perform(demos.trajectories[1], demos.dt_s, keep_frames=True)

    assert performance.frames is not None
    assert np.array_equal(performer.data.qpos, performance.frames[-1])
    performer.reset()
    assert np.array_equal(performer.data.qpos, start)
