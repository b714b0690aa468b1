"""A set of basic actions: named trajectories of the same joints at one tick, checked once when the set is made."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from creative_nao.demonstrations.keyframes import DT_S
from creative_nao.errors import NotFoundError, SettingsError, ShapeError, nearest_name
from creative_nao.joints import JOINTS, LIMITS_RAD, joint_angles
from creative_nao.schema import JsonObject, Names, checked, must

LIMIT_TOLERANCE_RAD = 0.02
"""How far a recorded angle may lie beyond a joint's range [rad]: gears give, encoders are offset."""

DT_RANGE_S = (1e-6, 1e4)  # shortest and longest tick [s]

UNKNOWN_RANGE_RAD = (-1e4, 1e4)  # where an angle of a joint that the robot does not have may lie [rad]
DEGREES_FROM_RAD = 2.0 * np.pi  # a joint angle of more than a full turn is taken for degrees
_MAX_PANELS = 12
_MAX_NAMES = 8


Tick = Annotated[float, must(lambda seconds: seconds > 0, "a positive number of seconds")]
"""Time from one posture to the next [s]."""


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


def outside_range(angles: np.ndarray, joints: tuple[str, ...]) -> tuple[int, int, str] | None:
    """Return where an angle first leaves its joint's range by more than the tolerance, and how to say so.

    The ranges of joints that the robot does not have are unknown here; `UNKNOWN_RANGE_RAD` bounds them all. The angles
    [rad] have the shape (n_steps, n_joints). Returned are row, column and the clause "is 92.0, looks like degrees,
    expected radians ...", or None if all is well.
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


def draw_curves(trajectories: Mapping[str, np.ndarray], dt_s: float, joints: tuple[str, ...]) -> bytes:
    """Return a PNG of joint angles by name [rad], (n_steps, n_joints), over time; a panel for each of the first."""
    from matplotlib.figure import Figure

    chosen = dict(list(trajectories.items())[:_MAX_PANELS])
    n_columns = min(3, len(chosen))
    n_rows = math.ceil(len(chosen) / n_columns)
    figure = Figure(figsize=(3.4 * n_columns + 1.6, 1.9 * n_rows + 0.4), layout="constrained")
    panels = figure.subplots(n_rows, n_columns, squeeze=False, sharex=True, sharey=True).ravel()
    lines = []
    for panel, (name, angles) in zip(panels, chosen.items(), strict=False):
        lines = panel.plot(np.arange(len(angles)) * dt_s, angles, linewidth=1.0)
        panel.set_title(name, fontsize=9)
    for panel in panels[len(chosen) :]:
        panel.set_visible(False)
    figure.supxlabel("time [s]", fontsize=9)
    figure.supylabel("angle [rad]", fontsize=9)
    figure.legend(lines, joints, loc="outside right upper", fontsize=7)
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=90)
    return content.getvalue()
