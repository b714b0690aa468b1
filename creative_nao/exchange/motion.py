"""A movement, `Motion`, and time: what a tick is, and how postures recorded at any times are brought to it."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from creative_nao.errors import FileFormatError, SettingsError
from creative_nao.joints import JOINTS, LIMITS_RAD, joint_angles
from creative_nao.schema import JsonObject, Names, checked, must

DT_S = 0.15  # time between two postures of a basic action, the network's tick [s]
CYCLE_S = 0.010  # cycle of the robot's device controller [s]; ticks made here are whole numbers of it
APPROACH_SPEED_RAD_S = 1.5
"""Largest speed on the way to the first posture: less than a quarter of what the slowest joint can do."""

MIN_LEAD_S = 1.0  # shortest time for that way [s]
MAX_STEPS = 10_000  # longest movement that is read, in ticks or postures; more is a mistake in the unit of time
GRID_TOLERANCE_S = 1e-6  # times this close to the tick's grid are on it [s]

LIMIT_TOLERANCE_RAD = 0.02
"""How far a recorded angle may lie beyond a joint's range [rad]: gears give, encoders are offset."""

UNKNOWN_RANGE_RAD = (-1e4, 1e4)  # where an angle of a joint that the robot does not have may lie [rad]
DEGREES_FROM_RAD = 2.0 * np.pi  # a joint angle of more than a full turn is taken for degrees

_ROUNDING = 1e-9
_WINDOW_POINTS = 33
_MAX_PANELS = 12

Tick = Annotated[float, must(lambda seconds: seconds > 0, "a positive number of seconds")]
"""Time from one posture to the next [s]."""


@dataclass(frozen=True, eq=False, repr=False)
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
        >>> Motion(np.zeros((3, 1)), 0.1, ("RElbowYaw",))
        Motion of 1 joint: 3 postures at 0.1 s, 0.2 s long
    """

    angles: np.ndarray
    dt_s: float
    joints: tuple[str, ...] = JOINTS
    metadata: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check everything, and keep an own copy in float64."""
        for name, kind in {"joints": Names, "dt_s": Tick, "metadata": JsonObject}.items():
            object.__setattr__(self, name, checked(kind, getattr(self, name), name))
        for name in self.joints:
            if not (name.isascii() and name.replace("_", "a").replace("/", "a").isalnum()):
                raise SettingsError(f"`joints`: a name should be ASCII letters, digits, _ and /, but one is {name!r}.")
        object.__setattr__(self, "angles", joint_angles(self.angles, "angles", self.joints))

    def __repr__(self) -> str:
        joints = f"{len(self.joints)} joint{'s' if len(self.joints) > 1 else ''}"
        return f"Motion of {joints}: {len(self.angles)} postures at {self.dt_s:g} s, {self.duration_s:g} s long"

    def _repr_png_(self) -> bytes:
        """Return the curves of the joints, for Jupyter."""
        return draw_curves({str(self.metadata.get("source", ""))[:60]: self.angles}, self.dt_s, self.joints)

    @property
    def duration_s(self) -> float:
        """From the first posture to the last [s]."""
        return (len(self.angles) - 1) * self.dt_s

    def times_s(self, start_s: float = 0.0) -> list[float]:
        """Return when each posture is reached if the first one is at `start_s` [s], to the nanosecond."""
        return [round(start_s + step * self.dt_s, 9) for step in range(len(self.angles))]

    def lead_s(self) -> float:
        """Return how long the way to the first posture takes at a safe speed [s]: whole cycles, at least `MIN_LEAD_S`.

        The robot must not jump there, and a file cannot know where the robot is: the farthest end of each range counts.
        """
        farthest = 0.0
        for joint, angle in zip(self.joints, self.angles[0], strict=True):
            low, high = LIMITS_RAD.get(joint, (angle, angle))
            farthest = max(farthest, angle - low, high - angle)
        seconds = max(MIN_LEAD_S, farthest / APPROACH_SPEED_RAD_S)
        return round(math.ceil(seconds / CYCLE_S - _ROUNDING) * CYCLE_S, 9)


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
        panel.set_title(name, fontsize=9, parse_math=False)
    for panel in panels[len(chosen) :]:
        panel.set_visible(False)
    figure.supxlabel("time [s]", fontsize=9)
    figure.supylabel("angle [rad]", fontsize=9)
    for label in figure.legend(lines, joints, loc="outside right upper", fontsize=7).get_texts():
        label.set_parse_math(False)  # names out of files are text
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=90)
    return content.getvalue()


def n_ticks(duration_s: float, dt_s: float) -> int:
    """Return how many postures at `dt_s` fit a recording of `duration_s` seconds, the first one at its start."""
    return int(np.floor(duration_s / dt_s + GRID_TOLERANCE_S)) + 1


def check_duration(duration_s: float, dt_s: float, most: int, where: str) -> None:
    """Raise FileFormatError for a recording shorter than a tick or longer than `most` ticks; `where` names it."""
    if duration_s < dt_s * (1.0 - 1e-6):
        raise FileFormatError(f"{where}: lasts {duration_s:g} s, shorter than one tick of {dt_s:g} s.")
    if duration_s / dt_s > most:
        raise FileFormatError(
            f"{where}: lasts {duration_s:g} s, {n_ticks(duration_s, dt_s)} ticks of {dt_s:g} s, "
            f"expected at most {most}; are the times in seconds, not milliseconds?"
        )


def resample(times_s: np.ndarray, angles: np.ndarray, dt_s: float) -> np.ndarray:
    """Return the recorded postures at every `dt_s` seconds, from the first sample on.

    Between the samples a monotone cubic (Fritsch and Butland 1984) never overshoots a posture that was recorded. A
    recording finer than the tick holds movement that the tick cannot (tremor at 10 Hz against 3.3 Hz), which plain
    picking would turn into a slow wobble that nobody made. So each posture is a mean over a Hann window, as wide as the
    tick less the spacing of the recording: of a 50 Hz recording read at 0.15 s, a 1.5 Hz swing keeps 98 % of its size
    and a 10 Hz tremor less than 30 %. A recording at the tick itself is taken as it is.

    Args:
        times_s: When each posture was recorded [s], strictly rising, shape (n,), at least two; spacing may vary.
        angles: Recorded postures [rad], shape (n, n_joints).
        dt_s: The tick [s].

    Returns:
        Postures [rad], shape (n_steps, n_joints).
    """
    times = np.asarray(times_s, dtype=np.float64) - times_s[0]
    ticks = np.arange(n_ticks(times[-1], dt_s)) * dt_s
    if len(ticks) == len(times) and np.abs(ticks - times).max() <= GRID_TOLERANCE_S:
        return np.array(angles, dtype=np.float64)
    width = dt_s - float(np.median(np.diff(times)))
    if width <= 0:
        return monotone_cubic(times, angles, ticks)
    share = (np.arange(_WINDOW_POINTS) + 0.5) / _WINDOW_POINTS
    weights = np.sin(np.pi * share) ** 2
    weights /= weights.sum()
    around = ticks[:, None] + width * (share - 0.5)
    fine = monotone_cubic(times, angles, around.ravel())
    return np.einsum("w,nwj->nj", weights, fine.reshape(len(ticks), _WINDOW_POINTS, -1))


def monotone_cubic(times_s: np.ndarray, angles: np.ndarray, wanted_s: np.ndarray) -> np.ndarray:
    """Return the monotone cubic through `(times_s, angles)` at `wanted_s`, the end postures held outside."""
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(times_s, angles, axis=0)(np.clip(wanted_s, times_s[0], times_s[-1]))
