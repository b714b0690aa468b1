"""A movement on its way to a file: angles, tick, joints, and what is known about where it comes from."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.joints import JOINTS, LIMITS_RAD

CYCLE_S = 0.010
"""Cycle of the robot's device controller [s]; ticks made here are whole numbers of it."""

APPROACH_SPEED_RAD_S = 1.5
"""Largest speed on the way to the first posture: less than a quarter of what the slowest joint can do."""

MIN_LEAD_S = 1.0
"""Shortest time for that way [s]."""

_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Motion:
    """A trajectory with its tick, checked once when it is made.

    Attributes:
        angles: Joint angles [rad], shape (n_steps, n_joints), float64, finite; at least one row.
        dt_s: Time from one posture to the next [s].
        joints: Name of each column.
        metadata: Source, memory, PB value, command, versions, ...; plain JSON values.

    Raises:
        ShapeError: If `angles` is not such an array.
        SettingsError: If `dt_s` is not positive, a name is not plain ASCII or repeats, or `metadata` is not JSON.

    Example:
        >>> Motion(np.zeros((3, 1)), 0.1, ("RElbowYaw",)).duration_s
        0.2
    """

    angles: np.ndarray
    dt_s: float
    joints: tuple[str, ...] = JOINTS
    metadata: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check everything, and keep an own copy in float64."""
        object.__setattr__(self, "joints", tuple(self.joints))
        object.__setattr__(self, "dt_s", float(self.dt_s))
        angles = np.array(self.angles, dtype=np.float64)
        if angles.ndim != 2 or angles.shape[1] != len(self.joints) or len(angles) < 1:
            raise ShapeError(
                f"`angles` should have shape (n_steps, {len(self.joints)}), one column for each of "
                f"{', '.join(self.joints)}, but has {angles.shape}."
            )
        broken = np.argwhere(~np.isfinite(angles))
        if len(broken):
            row, column = broken[0]
            raise ShapeError(f"`angles` should be finite, but {self.joints[column]} at step {row} is not a number.")
        if not (math.isfinite(self.dt_s) and self.dt_s > 0):
            raise SettingsError(f"`dt_s` should be a positive number of seconds, but is {self.dt_s}.")
        for name in self.joints:
            if not (name.isascii() and name.replace("_", "a").replace("/", "a").isalnum()):
                raise SettingsError(f"`joints`: a name should be ASCII letters, digits, _ and /, but one is {name!r}.")
        if len(set(self.joints)) < len(self.joints):
            raise SettingsError(f"`joints` should not repeat a name, but is {self.joints}.")
        try:
            json.dumps(self.metadata, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise SettingsError(f"`metadata` should hold plain JSON values only: {error}.") from None
        object.__setattr__(self, "angles", angles)

    @property
    def duration_s(self) -> float:
        """From the first posture to the last [s]."""
        return (len(self.angles) - 1) * self.dt_s

    def times_s(self, start_s: float = 0.0) -> list[float]:
        """Return when each posture is reached if the first one is at `start_s` [s], to the nanosecond."""
        return [round(start_s + step * self.dt_s, 9) for step in range(len(self.angles))]

    def lead_s(self) -> float:
        """Return how long the way to the first posture takes at a safe speed, wherever in its range each joint stands.

        A robot that gets this movement must not jump to its first posture, and a file cannot know where the robot is.

        Returns:
            Seconds, a whole number of cycles, at least `MIN_LEAD_S`.
        """
        farthest = 0.0
        for joint, angle in zip(self.joints, self.angles[0], strict=True):
            low, high = LIMITS_RAD.get(joint, (angle, angle))
            farthest = max(farthest, angle - low, high - angle)
        seconds = max(MIN_LEAD_S, farthest / APPROACH_SPEED_RAD_S)
        return round(math.ceil(seconds / CYCLE_S - _ROUNDING) * CYCLE_S, 9)
