"""Domain randomisation: a robot that differs a little from the published one in mass, friction, gains, latency, noise.

No two robots are alike, and several figures of this one are estimates. What is learned on many variations can be
trusted more than what holds on one.
"""

# The bindings of MuJoCo have no static types.
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from creative_nao.robot.scene import Index
from creative_nao.schema import NonNegative, Positive, record


@record
class RobotVariation:
    """How one robot differs from the published one; the defaults are the published robot itself."""

    mass: Positive = 1.0
    """Factor of the mass and inertia of every link."""
    friction: Positive = 1.0
    """Factor of the friction of soles, gloves, floor and bag."""
    kp: Positive = 1.0
    """Factor of the proportional gains of all servos."""
    kd: Positive = 1.0
    """Factor of their derivative gains."""
    latency_s: NonNegative = 0.0
    """Time from a command to its arrival at the servos of the arms [s]; rounded to whole cycles of 10 ms."""
    encoder_noise_rad: NonNegative = 0.0
    """Standard deviation of what is added to an angle before the encoder counts it [rad]."""


class Varied:
    """Applies variations to one compiled model, and restores it; everyone who simulates with the model is affected.

    Args:
        model: The compiled `mujoco.MjModel`.
        index: Rows of the robot in its arrays.
    """

    def __init__(self, model: Any, index: Index) -> None:
        self._model = model
        torso = index.torso
        self._links = np.flatnonzero(model.body_rootid == model.body_rootid[torso])
        self._mass, self._inertia = model.body_mass.copy(), model.body_inertia.copy()
        self._friction = model.geom_friction.copy()
        self._gain, self._bias = model.actuator_gainprm.copy(), model.actuator_biasprm.copy()

    def apply(self, variation: RobotVariation) -> None:
        """Give the model this variation, whatever it had before; the default one restores every bit."""
        model, links = self._model, self._links
        model.body_mass[links] = variation.mass * self._mass[links]
        model.body_inertia[links] = variation.mass * self._inertia[links]
        model.geom_friction[:] = variation.friction * self._friction
        model.actuator_gainprm[:] = variation.kp * self._gain
        # A position servo is gain kp and bias (0, -kp, -kd).
        model.actuator_biasprm[:] = self._bias
        model.actuator_biasprm[:, 1] *= variation.kp
        model.actuator_biasprm[:, 2] *= variation.kd
        mujoco.mj_setConst(model, mujoco.MjData(model))
