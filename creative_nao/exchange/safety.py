"""May the robot be asked to do this? Angles and speeds are compared with what its joints can do before any export.

Between two postures the joints are taken to move in a straight line. Joints whose ranges are not known here count as
unsafe: nobody checked them.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from creative_nao.errors import CreativeNaoError, SettingsError
from creative_nao.exchange.motion import CYCLE_S, Motion
from creative_nao.joints import ENCODER_STEP_RAD, LIMITS_RAD, MAX_SPEED_RAD_S
from creative_nao.schema import checked

Unsafe = Literal["refuse", "clip", "keep"]
UNSAFE: tuple[Unsafe, ...] = ("refuse", "clip", "keep")
"""What may be done with an unsafe movement."""

_ROUNDING = 1e-9


class UnsafeMotionError(CreativeNaoError, ValueError):
    """A movement leaves the range of a joint or is faster than its motor; the message says where and by how much."""


@dataclass(frozen=True)
class Finding:
    """One stretch of one movement in which one joint is asked for too much."""

    kind: Literal["angle", "speed", "unknown"]
    joint: str
    start_s: float
    end_s: float
    """First and last moment of the stretch [s], counted from the first posture."""
    worst_s: float
    worst: float
    """The worst angle [rad] or speed [rad/s]."""
    excess: float
    """How far that is beyond what is allowed, in the same unit."""

    def __str__(self) -> str:
        if self.kind == "unknown":
            return f"{self.joint} is not one of the arm joints whose ranges are known"
        when = f"{self.start_s:.2f} s" if self.start_s == self.end_s else f"{self.start_s:.2f} to {self.end_s:.2f} s"
        if self.kind == "speed":
            fastest = MAX_SPEED_RAD_S[self.joint]
            return (
                f"{self.joint} at {when} moves at up to {self.worst:.2f} rad/s (at {self.worst_s:.2f} s), "
                f"its motor at {fastest:.2f} rad/s at most"
            )
        low, high = LIMITS_RAD[self.joint]
        return (
            f"{self.joint} at {when} is up to {self.excess:.4f} rad beyond its range of {low:.4f} to {high:.4f} rad "
            f"({self.worst:.4f} rad at {self.worst_s:.2f} s)"
        )


def inspect(motion: Motion) -> list[Finding]:
    """Return everything that makes a movement unsafe, joint by joint in the order of time; an empty list if nothing.

    An angle may lie one count of the encoder (0.0015 rad) beyond its range, since no recording is finer than that.
    """
    found: list[Finding] = []
    dt_s = checked(Motion, motion, "motion").dt_s

    def add(kind: Literal["angle", "speed"], joint: str, values: np.ndarray, beyond: np.ndarray, most: float) -> None:
        """Add a finding for each run of steps that are beyond by more than `most`; a step of speed is a tick long."""
        over, width = np.flatnonzero(beyond > most), int(kind == "speed")
        for run in np.split(over, np.flatnonzero(np.diff(over) > 1) + 1) if len(over) else ():
            worst = int(run[beyond[run].argmax()])
            start, end = float(run[0] * dt_s), float((run[-1] + width) * dt_s)
            found.append(Finding(kind, joint, start, end, worst * dt_s, float(values[worst]), float(beyond[worst])))

    for column, joint in enumerate(motion.joints):
        if joint not in LIMITS_RAD:
            found.append(Finding("unknown", joint, 0.0, motion.duration_s, 0.0, 0.0, 0.0))
            continue
        angles = motion.angles[:, column]
        low, high = LIMITS_RAD[joint]
        beyond = np.maximum(low - angles, angles - high)
        add("angle", joint, angles, beyond, ENCODER_STEP_RAD)
        speeds = np.abs(np.diff(angles)) / dt_s
        add("speed", joint, speeds, speeds - MAX_SPEED_RAD_S[joint], _ROUNDING)
    return found


def made_safe(motion: Motion, unsafe: Unsafe = "refuse") -> tuple[Motion, list[str]]:
    """Return a movement that may be exported, and one sentence for each thing that was changed or left unsafe.

    `clip` sets angles beyond a joint's range to its end. Too high a speed is not cut, which would bend the movement,
    but cured by time: the whole movement becomes slower by one factor, its tick rounded up to the controller's 10 ms.
    `keep` changes nothing and says what is unsafe.

    Raises:
        UnsafeMotionError: If the movement is unsafe and `unsafe` is `refuse`, or `clip` cannot help.
        SettingsError: If `unsafe` is none of the three.
    """
    if unsafe not in UNSAFE:
        raise SettingsError(f"`unsafe` should be one of {', '.join(UNSAFE)}, but is {unsafe!r}.")
    findings = inspect(motion)
    if unsafe == "keep":
        return motion, [f"unsafe, kept: {finding}" for finding in findings]
    unknown = [finding for finding in findings if finding.kind == "unknown"]
    if findings and (unsafe == "refuse" or unknown):
        first = (unknown or findings)[0]
        more = f", and {len(findings) - 1} more" if len(findings) > 1 else ""
        slower = "--unsafe clip keeps angles within the ranges and slows the whole movement down"
        advice = "leave such joints out" if unknown else slower
        raise UnsafeMotionError(f"unsafe movement: {first}{more}; {advice}.")
    sentences = [f"clipped: {finding}" for finding in findings if finding.kind == "angle"]
    pairs = np.array([LIMITS_RAD[joint] for joint in motion.joints])
    clipped = np.clip(motion.angles, pairs[:, 0], pairs[:, 1])
    slight = float(np.abs(clipped - motion.angles).max(initial=0.0))
    if slight > 0 and not sentences:
        sentences.append(f"set to the end of the range where at most one encoder count beyond it ({slight:.5f} rad)")
    motion = dataclasses.replace(motion, angles=clipped)
    fastest = np.array([MAX_SPEED_RAD_S[joint] for joint in motion.joints])
    ratio = np.abs(np.diff(motion.angles, axis=0)) / (motion.dt_s * fastest)
    factor = float(ratio.max(initial=0.0))
    if factor <= 1.0 + _ROUNDING:
        return motion, sentences
    dt_s = round(math.ceil(motion.dt_s * factor / CYCLE_S - _ROUNDING) * CYCLE_S, 9)
    step, column = np.unravel_index(int(ratio.argmax()), ratio.shape)
    joint = motion.joints[column]
    sentences.append(
        f"slowed: {joint} would move at {factor * MAX_SPEED_RAD_S[joint]:.2f} rad/s at {step * motion.dt_s:.2f} s, "
        f"its motor at {MAX_SPEED_RAD_S[joint]:.2f} rad/s at most; every tick lasts {dt_s:g} s instead of "
        f"{motion.dt_s:g} s ({dt_s / motion.dt_s:.3f} times)"
    )
    return dataclasses.replace(motion, dt_s=dt_s), sentences
