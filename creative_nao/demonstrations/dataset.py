"""A set of basic actions: named trajectories of the same joints at one tick, checked once when the set is made."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from creative_nao.errors import NotFoundError, SettingsError, ShapeError, nearest_name
from creative_nao.exchange.motion import DT_S, Tick, draw_curves, outside_range
from creative_nao.joints import JOINTS, joint_angles
from creative_nao.schema import JsonObject, Names, checked

DT_RANGE_S = (1e-6, 1e4)  # shortest and longest tick [s]

_MAX_NAMES = 8


@dataclass(frozen=True, eq=False, repr=False)
class Demonstrations:
    """The basic actions a network is trained on and every generated action is compared with.

    Attributes:
        names: Name of each action, without repetition.
        trajectories: Joint angles of each action [rad], each of shape (n_steps, n_joints), float64; lengths may differ.
        dt_s: Time from one posture to the next [s].
        joints: Name of each column.
        record: Where the set comes from (command, seed, versions, ...); plain JSON values.

    Raises:
        ShapeError: If names and trajectories do not match, a trajectory is not (n_steps >= 2, n_joints), or an angle is
            not finite or lies outside the joint's range.
        SettingsError: If `dt_s` is not positive, a name repeats, or `record` is not made of JSON values.

    Example:
        >>> wave = np.linspace(0.2, 1.2, 5)[:, None]
        >>> demos = Demonstrations(("wave",), [wave], dt_s=0.5, joints=("RElbowRoll",))
        >>> demos.n_actions, round(demos.max_speed, 3)
        (1, 0.5)
        >>> demos
        Demonstrations of 1 joint at 0.5 s: wave (5 postures)
    """

    names: tuple[str, ...]
    trajectories: list[np.ndarray]
    dt_s: float = DT_S
    joints: tuple[str, ...] = JOINTS
    record: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check everything, and keep own copies in float64."""
        for name, kind in {"names": Names, "joints": Names, "dt_s": Tick, "record": JsonObject}.items():
            object.__setattr__(self, name, checked(kind, getattr(self, name), name))
        if not DT_RANGE_S[0] <= self.dt_s <= DT_RANGE_S[1]:
            raise SettingsError(
                f"`dt_s` should be a number of seconds from {DT_RANGE_S[0]:g} to {DT_RANGE_S[1]:g}, but is {self.dt_s}"
            )
        trajectories = self.trajectories if isinstance(self.trajectories, list | tuple | np.ndarray) else ()
        if len(trajectories) != len(self.names):
            raise ShapeError(
                f"`trajectories` should hold one trajectory for each of the {len(self.names)} names, "
                f"but holds {len(trajectories)}."
            )
        angles = []
        for place, (name, trajectory) in enumerate(zip(self.names, trajectories, strict=True)):
            called = f"trajectories[{place}] ({name})"
            angles.append(joint_angles(trajectory, called, self.joints, least=2))
            if found := outside_range(angles[-1], self.joints):
                row, column, clause = found
                raise ShapeError(f"`{called}`: {self.joints[column]} at step {row} {clause} [rad].")
        object.__setattr__(self, "trajectories", angles)

    def __len__(self) -> int:
        return len(self.names)

    def __repr__(self) -> str:
        told = [f"{name} ({len(one)} postures)" for name, one in zip(self.names, self.trajectories, strict=True)]
        more = f", and {len(told) - _MAX_NAMES} more" if len(told) > _MAX_NAMES else ""
        joints = f"{self.n_joints} joint{'s' if self.n_joints > 1 else ''}"
        return f"Demonstrations of {joints} at {self.dt_s:g} s: {', '.join(told[:_MAX_NAMES])}{more}"

    def _repr_png_(self) -> bytes:
        """Return the curves of the first actions, for Jupyter."""
        return draw_curves(dict(zip(self.names, self.trajectories, strict=True)), self.dt_s, self.joints)

    @property
    def n_actions(self) -> int:
        """Number of basic actions."""
        return len(self.names)

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def initial_posture(self) -> np.ndarray:
        """Mean first posture of the actions [rad], shape (n_joints,): where every generated action starts."""
        return np.mean([trajectory[0] for trajectory in self.trajectories], axis=0)

    @property
    def max_speed(self) -> float:
        """Largest change of any joint between two postures, over all actions, as a speed [rad/s]."""
        return float(max(np.abs(np.diff(trajectory, axis=0)).max() for trajectory in self.trajectories) / self.dt_s)

    def trajectory(self, name: str) -> np.ndarray:
        """Return the trajectory of the action called `name`."""
        if name not in self.names:
            raise NotFoundError(
                f"no basic action `{name}`{nearest_name(str(name), self.names)}; there are {self.names}."
            )
        return self.trajectories[self.names.index(name)]
