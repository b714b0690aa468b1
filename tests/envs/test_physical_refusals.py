"""Each way in which an action can be inappropriate, shown by a movement built to trip exactly that one."""

import dataclasses

import numpy as np
import pytest

from creative_nao.envs import BoxingEnv
from creative_nao.measures.outcome import is_fluctuating, is_non_moving
from creative_nao.model import Memory, load_memory
from creative_nao.robot import PHYSICAL_FAILURES, Performer, arm_angles, bare_scene, failures

DT_S = 0.15
N_STEPS = 50
GUARD = arm_angles("Guard")
SIGN = np.array([1.0, -1.0, -1.0, -1.0])


def between(n_way, first=GUARD, n_steps=N_STEPS):
    """From the guard to a posture in `n_way` ticks, and back at the end."""
    share = np.minimum(np.arange(n_steps), np.arange(n_steps)[::-1]) / n_way
    return GUARD + np.clip(share, 0, 1)[:, None] * (first - GUARD)


def right_arm(pitch, roll, yaw, elbow):
    posture = GUARD.copy()
    posture[:4] = pitch, roll, yaw, elbow
    return posture


def elbow_bent_beyond_its_range():
    movement = between(1)
    movement[5:-5, 3] = 1.5446 + 0.05
    return movement


def gloves_pressed_together():
    inward = np.array([0, 0.3, 0, 0])
    return between(8, GUARD + np.concatenate([inward, inward * SIGN]))


def straight_arm_shaken():
    """The long lever asks for more torque than the shoulder has, but it is back in place before the error adds up."""
    movement = between(7, right_arm(1.2, -0.3, 0.0, 0.06))
    ticks = np.arange(8, N_STEPS - 8)
    movement[ticks, 0] += 0.4 * (-1.0) ** (ticks // 2)
    return movement


def forearm_twisted_to_and_fro():
    """Light to turn, so the motor never works at its limit, but the servo lags behind at this speed."""
    movement = between(7, right_arm(0.9, -1.2, 0.0, 0.1))
    ticks = np.arange(8, N_STEPS - 8)
    movement[ticks, 2] += 0.52 * (-1.0) ** ticks
    return movement


def arms_swung_overhead():
    """Both arms swing behind the head at the pace at which the robot rocks on its feet: it tips over."""
    time = DT_S * np.arange(N_STEPS)
    swing = np.array([-1.97, -0.27, -1.12, 0.89]) + np.outer(np.sin(2 * np.pi * 0.92 * time), [1.19, 0.2, 0.11, 0.33])
    swing = np.clip(swing, [-2.08, -1.3, -2.0, 0.05], [2.0, 0.25, 2.0, 1.5])
    begin = np.minimum(1, np.arange(N_STEPS) / 8)[:, None]
    return GUARD + begin * (np.concatenate([swing, swing * SIGN], axis=1) - GUARD)


def one_jump():
    """One tick faster than any motor; the robot, held back by the speed limit of its joints, follows a little late."""
    movement = between(7, right_arm(0.9, -1.2, 0.9, 0.1))
    movement[20:30, 2] -= 1.4
    return movement


TRIPS = {
    "joint_limit": elbow_bent_beyond_its_range,
    "fell": arms_swung_overhead,
    "self_collision": gloves_pressed_together,
    "torque_saturated": straight_arm_shaken,
    "tracking_error": forearm_twisted_to_and_fro,
}
MENTAL = {"fluctuating": one_jump, "non_moving": lambda: between(1)}


class Scripted(Memory):
    """A memory that always has the same movement in mind."""

    movement: np.ndarray

    def generate(self, pb, n_steps=None):
        return np.repeat(self.movement[None], len(pb), axis=0)


def scripted(movement):
    shipped = load_memory("half/0")
    memory = Scripted(**{field.name: getattr(shipped, field.name) for field in dataclasses.fields(shipped)})
    object.__setattr__(memory, "movement", movement)
    return memory


@pytest.fixture(scope="module")
def performer():
    return Performer(bare_scene())


@pytest.fixture(scope="module")
def demos():
    return load_memory("half/0").demonstrations


def test_every_failure_of_the_body_is_shown():
    assert set(TRIPS) == set(PHYSICAL_FAILURES)


@pytest.mark.parametrize("name", TRIPS)
def test_the_body_refuses_for_this_reason_and_no_other(name, performer, demos):
    movement = TRIPS[name]()
    performance = performer.perform(movement, DT_S)

    assert failures(performance) == (name,)
    assert not is_fluctuating([movement], demos)[0]
    assert not is_non_moving([performance.measured], demos)[0]


@pytest.mark.parametrize("name", MENTAL)
def test_the_body_has_nothing_against_what_only_the_measures_refuse(name, performer, demos):
    movement = MENTAL[name]()

    assert failures(performer.perform(movement, DT_S)) == ()
    assert bool(is_fluctuating([movement], demos)[0]) == (name == "fluctuating")
    assert bool(is_non_moving([movement], demos)[0]) == (name == "non_moving")


@pytest.mark.parametrize("name", [*TRIPS, *MENTAL])
def test_the_environment_names_it_and_pays_nothing(name):
    env = BoxingEnv(scripted({**TRIPS, **MENTAL}[name]()))
    env.reset()
    _, reward, _, _, info = env.step(np.zeros(2))

    assert (info["outcome"], info["appropriate"], reward) == (name, False, 0.0)
    assert info["repertoire_size"] == 0
