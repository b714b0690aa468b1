"""A set of basic actions: named trajectories of the same joints at one tick, checked once when the set is made."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from creative_nao.demonstrations.keyframes import DT_S
from creative_nao.errors import NotFoundError, SettingsError, ShapeError, nearest_name
from creative_nao.joints import JOINTS, LIMITS_RAD

LIMIT_TOLERANCE_RAD = 0.02
"""How far a recorded angle may lie beyond a joint's range [rad]: gears give, encoders are offset."""

DT_RANGE_S = (1e-6, 1e4)
"""Shortest and longest tick [s]."""

UNKNOWN_RANGE_RAD = (-1e4, 1e4)
"""Where an angle of a joint that the robot does not have may lie [rad]: a wheel turns, but not to the stars."""

DEGREES_FROM_RAD = 2.0 * np.pi
"""A joint angle of more than a full turn is taken for degrees."""


@dataclass(frozen=True, eq=False)
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
    """

    names: tuple[str, ...]
    trajectories: list[np.ndarray]
    dt_s: float = DT_S
    joints: tuple[str, ...] = JOINTS
    record: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check everything, and keep own copies in float64."""
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "joints", tuple(self.joints))
        object.__setattr__(self, "dt_s", float(self.dt_s))
        for what, words in {"names": self.names, "joints": self.joints}.items():
            if not words or any(not isinstance(word, str) or not word for word in words):
                raise SettingsError(f"`{what}` should hold at least one name, each a non-empty text, but is {words}.")
            if len(set(words)) < len(words):
                raise SettingsError(f"`{what}` should not repeat a name, but is {words}.")
        if not DT_RANGE_S[0] <= self.dt_s <= DT_RANGE_S[1]:
            raise SettingsError(
                f"`dt_s` should be a positive number of seconds, but is {self.dt_s}; "
                f"{DT_RANGE_S[0]:g} to {DT_RANGE_S[1]:g} s are taken."
            )
        if len(self.trajectories) != len(self.names):
            raise ShapeError(
                f"`trajectories` should hold one trajectory for each of the {len(self.names)} names, "
                f"but holds {len(self.trajectories)}."
            )
        checked = [
            _checked(trajectory, f"trajectories[{place}] ({name})", self.joints)
            for place, (name, trajectory) in enumerate(zip(self.names, self.trajectories, strict=True))
        ]
        object.__setattr__(self, "trajectories", checked)
        try:
            json.dumps(self.record, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise SettingsError(f"`record` should hold plain JSON values only: {error}.") from None

    def __len__(self) -> int:
        return len(self.names)

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
            raise NotFoundError(f"no basic action `{name}`{nearest_name(name, self.names)}; there are {self.names}.")
        return self.trajectories[self.names.index(name)]


def outside_range(angles: np.ndarray, joints: tuple[str, ...]) -> tuple[int, int, str] | None:
    """Return where an angle first leaves its joint's range by more than the tolerance, and how to say so.

    The ranges of joints that the robot does not have are unknown here; `UNKNOWN_RANGE_RAD` bounds them all.

    Args:
        angles: Joint angles [rad], shape (n_steps, n_joints).
        joints: Name of each column.

    Returns:
        Row, column and the clause "is 92.0, looks like degrees, expected radians ...", or None if all is well.
    """
    ranges = np.array([LIMITS_RAD.get(joint, UNKNOWN_RANGE_RAD) for joint in joints])
    low, high = ranges[:, 0] - LIMIT_TOLERANCE_RAD, ranges[:, 1] + LIMIT_TOLERANCE_RAD
    bad = np.argwhere((angles < low) | (angles > high))
    if not len(bad):
        return None
    known = np.array([joint in LIMITS_RAD for joint in joints])
    turned = np.argwhere((np.abs(angles) > DEGREES_FROM_RAD) & known)
    row, column = turned[0] if len(turned) else bad[0]
    value, (lowest, highest) = angles[row, column], ranges[column].tolist()
    guess = "looks like degrees, expected radians" if len(turned) else "outside the joint's range"
    return int(row), int(column), f"is {value:.6g}, {guess} between {lowest} and {highest}"


def _checked(trajectory: np.ndarray, called: str, joints: tuple[str, ...]) -> np.ndarray:
    try:
        angles = np.array(trajectory, dtype=np.float64)
    except (TypeError, ValueError):
        raise ShapeError(f"`{called}` should be an array of numbers, but is {type(trajectory).__name__}.") from None
    if angles.ndim != 2 or angles.shape[1] != len(joints) or len(angles) < 2:
        raise ShapeError(
            f"`{called}` should have shape (n_steps >= 2, {len(joints)}), one column for each of {', '.join(joints)}, "
            f"but has {angles.shape}."
        )
    broken = np.argwhere(~np.isfinite(angles))
    if len(broken):
        row, column = broken[0]
        raise ShapeError(f"`{called}` should hold finite angles, but {joints[column]} at step {row} is not a number.")
    found = outside_range(angles, joints)
    if found:
        row, column, clause = found
        raise ShapeError(f"`{called}`: {joints[column]} at step {row} {clause} [rad].")
    return angles
