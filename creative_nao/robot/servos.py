"""The servos: gains chosen by measurement, and stiffness as NAO has it, a limit of the motor torque between 0 and 1."""

from __future__ import annotations

from typing import Any

import numpy as np

from creative_nao.errors import SettingsError
from creative_nao.schema import NonNegative, UnitInterval, checked, record

_LEG_PARTS = ("Hip", "Knee", "Ankle")


@record
class ServoSettings:
    """Gains of the position servos; none are published, these track brisk punches within the torque limits.

    The defaults are the gains of `nao.xml`.
    """

    arm_kp: NonNegative = 20.0
    """Proportional gain of arms and head [N m/rad]."""
    arm_kd: NonNegative = 0.4
    """Derivative gain of arms and head [N m s/rad]."""
    leg_kp: NonNegative = 120.0
    """Proportional gain of the legs [N m/rad]; at half of it the trunk sways twice as far under a punch."""
    leg_kd: NonNegative = 2.0
    """Derivative gain of the legs [N m s/rad]."""
    hand_kp: NonNegative = 1.0
    """Proportional gain of the fingers [N m per unit of opening]."""
    hand_kd: NonNegative = 0.02
    """Derivative gain of the fingers."""
    damping: NonNegative = 0.05
    """Viscous friction of every joint [N m s/rad]; at twice as much a quick uppercut spends 3 % of its time at the
    torque limit of the shoulder."""
    friction_loss: NonNegative = 0.03
    """Dry friction of every joint [N m]."""

    def gains(self, joint: str) -> tuple[float, float]:
        """Return the proportional and the derivative gain of the servo that turns a joint."""
        if any(part in joint for part in _LEG_PARTS):
            return self.leg_kp, self.leg_kd
        if joint.endswith("Hand"):
            return self.hand_kp, self.hand_kd
        return self.arm_kp, self.arm_kd

    def apply(self, model: Any, actuators: dict[str, int], dofs: dict[str, int]) -> None:
        """Give these gains and this friction to a compiled model.

        Args:
            model: The compiled `mujoco.MjModel`.
            actuators: Row of each motor in the model.
            dofs: Row of each hinge in the model.
        """
        for joint, row in actuators.items():
            kp, kd = self.gains(joint)
            model.actuator_gainprm[row, 0] = kp
            model.actuator_biasprm[row, 1:3] = -kp, -kd
        rows = list(dofs.values())
        model.dof_damping[rows] = self.damping
        model.dof_frictionloss[rows] = self.friction_loss


class Stiffness:
    """Sets the stiffness of single joints at run time, by scaling the torque limits of the compiled model.

    0 makes the joint limp, 1 allows the full torque. The model is shared by everyone who simulates with it: set it back
    to 1.

    Args:
        model: The compiled `mujoco.MjModel`.
        actuator_ids: Where each joint's actuator stands in the model.
    """

    def __init__(self, model: Any, actuator_ids: dict[str, int]) -> None:
        self._model = model
        self._ids = dict(actuator_ids)
        self._full_range = model.actuator_forcerange.copy()

    def set(self, joints: tuple[str, ...], stiffness: float) -> None:
        """Limit the torque of `joints` to `stiffness` (0 to 1) times their full torque.

        Raises:
            SettingsError: If `stiffness` lies outside 0 to 1 or a joint has no motor of its own.
        """
        stiffness = checked(UnitInterval, stiffness, "stiffness")
        unknown = [joint for joint in joints if joint not in self._ids]
        if unknown:
            raise SettingsError(
                f"`joints` should name motorised joints, but {unknown[0]!r} is none of {list(self._ids)}."
            )
        rows = np.array([self._ids[joint] for joint in joints], dtype=int)
        self._model.actuator_forcerange[rows] = stiffness * self._full_range[rows]

    def reset(self) -> None:
        """Give every joint its full torque again."""
        self._model.actuator_forcerange[:] = self._full_range
