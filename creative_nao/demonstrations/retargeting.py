"""From a person's body to the NAO: cuts of a take become demonstrations of the eight arm joints.

In the trunk's frame (x forward, y left, z up) the directions of the right arm are, with R the rotations about the
axes: upper arm = Ry(pitch) Rz(roll) x, forearm = Ry(pitch) Rz(roll) Rx(yaw) Rz(elbow) x; the left arm mirrors it.
People bend their elbows farther than the robot can, so a whole movement is fitted at once under the joints' ranges, and
where it is too fast for the robot it is slowed down, only there.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np

from creative_nao.demonstrations.take import _LOWPASS_HZ, Facing, Hertz, Take, _unit, load_take
from creative_nao.errors import FileFormatError, SettingsError
from creative_nao.exchange.motion import monotone_cubic
from creative_nao.joints import JOINTS, MAX_SPEED_RAD_S, MIRROR_SIGN, limits
from creative_nao.robot.postures import arm_angles
from creative_nao.schema import Field, PlainName, Positive, checked, record

UPPER_M, FORE_M = 0.105, 0.1137  # the robot's upper arm, and forearm to the middle of the hand [m]
_FIST, _UPPER, _FORE = 1.0, 0.35, 0.6  # weights of the fist's place (arm lengths) and of the two directions
_SPEED_PRICE, _ACCELERATION_PRICE = 5e-5, 2e-6
_MOST_ITERATIONS = 40
_KNOWN_YAW, _KNOWN_PITCH = 0.3, 0.25  # sine of the bend, cosine of the roll below which an angle is not determined
_SHARE_OF_SPEED = 0.9  # of the motors' no-load speed
_BLENDED_RAD = 0.25  # an end nearer to the wanted posture is blended into it, one farther away is led there
_LEAD_RAD_S = 2.0
_TICK_S = 0.02  # time between postures that are looked at for touches [s]
_AT_LIMIT_RAD = 0.005
_STILL = 1 / 3  # of the other wrist's way
_CLEAR_S = 0.1  # how long before and after a touch an arm is moved clear of the body [s]
MAX_UPPER_DEG, MAX_FORE_DEG, MAX_STRETCH, MAX_TURN_DEG = 35.0, 40.0, 3.0, 90.0
"""Beyond these mean errors of direction, this slow-down, or with the chest turned away so far, an action is refused."""


@record
class Retargeting:
    """How a body's movement becomes the robot's."""

    facing: Facing = "auto"
    """Where the trunk faces, once a take: `chest`, as the shoulders on average; `auto`, where the arms thrust if
    that is one way and more than 25 degrees beside the chest, as a boxer's is; or degrees to the left of the chest."""
    posture: Literal["guard", "rest"] = "guard"
    """Where each action begins and ends."""
    arms: Literal["auto", "both", "right", "left"] = "auto"
    """Which arms move; the other is held in the posture. `auto`: both, unless one moves less than a third as far."""
    low_pass_hz: Hertz = _LOWPASS_HZ
    """Frequency above which landmarks are taken for noise; 5 for depth cameras."""
    dt_s: Positive = 0.02
    """Time between two postures of the result [s]."""


@dataclass(frozen=True, eq=False)
class RetargetedAction:
    """One action brought to the robot: angles [rad], (n_steps, 8), at `dt_s` [s], and how well it fits the body's."""

    name: str
    angles: np.ndarray
    dt_s: float
    report: dict[str, Any] = field(default_factory=dict)
    """Share of the time at joint limits, errors of directions [deg], stretch, largest speed [rad/s], cuts [s]."""
    refused: str = ""
    """Why the robot cannot make this movement; empty if it can."""


def from_motion(
    take: Take | str | os.PathLike[str],
    cuts: Mapping[str, Sequence[tuple[float, float]]],
    *,
    mirror: Mapping[str, str] | None = None,
    retargeting: Retargeting | None = None,
) -> list[RetargetedAction]:
    """Turn cuts of a take into actions of the robot's arms.

    Args:
        take: A take, or a file that `take.load_take` reads.
        cuts: For each action its name and the times from and to [s]; several follow each other in one action.
        mirror: For each further action its name and that of the cut action whose mirror image it is.
        retargeting: Frame of the trunk, posture at the ends, filter and tick.

    Returns:
        The actions in their order, each with a report, and refused where the robot's arms cannot make the movement.

    Raises:
        FileFormatError: If the take has no such times, or landmarks are missing there.
        SettingsError: If a cut is too short, or a mirrored action is not there.
    """
    take = take if isinstance(take, Take) else load_take(take)
    how = checked(Retargeting, retargeting or Retargeting(), "retargeting")
    places = take.lowpass(how.low_pass_hz)
    heading, facing = trunk_heading(take, places, how.facing)
    actions = []
    for name, spans in cuts.items():
        checked(PlainName, name, "cuts")
        spans = checked(Annotated[tuple[tuple[float, float], ...], Field(min_length=1)], spans, f"cuts of {name}")
        actions.append(_action(take, places, name, list(spans), heading, how, facing))
    known = {one.name: one for one in actions}
    for name, other in (mirror or {}).items():
        if other not in known or checked(PlainName, name, "mirror") in known:
            raise SettingsError(f"mirror: `{name}` should be new and the image of one of {', '.join(known)}.")
        image = np.concatenate([known[other].angles[:, 4:], known[other].angles[:, :4]], axis=1) * np.tile(
            MIRROR_SIGN, 2
        )
        report = known[other].report | {"mirrored_from": other}
        actions.append(RetargetedAction(name, image, known[other].dt_s, report, known[other].refused))
    return actions


def trunk_heading(take: Take, places: np.ndarray, facing: Facing) -> tuple[float, str]:
    """Return the angle about the vertical in which the trunk faces, 0 along z [rad], and how it was found."""
    left = _unit(places[:, 3] - places[:, 0])[~take.missing]
    ahead = np.cross(left, [0.0, 1.0, 0.0]).mean(axis=0)
    chest = float(np.arctan2(ahead[0], ahead[2]))
    if isinstance(facing, float | int):
        return chest + float(np.radians(facing)), f"{facing:g} degrees to the left of the chest"
    thrust = np.zeros(3)
    total = 0.0
    for shoulder, wrist in ((0, 2), (3, 5)):
        way = places[:, wrist] - places[:, shoulder]
        velocity = np.gradient(way, take.dt_s, axis=0)
        out = np.clip((velocity * _unit(way)).sum(axis=1), 0, None) ** 2 * ~take.missing  # fast stretching counts
        flat = _unit(velocity * [1.0, 0.0, 1.0])
        thrust += (out[:, None] * flat).sum(axis=0)
        total += float(out.sum())
    agreed = float(np.linalg.norm(thrust)) / max(total, 1e-12)
    target = float(np.arctan2(thrust[0], thrust[2]))
    turn = float(np.degrees((target - chest + np.pi) % (2 * np.pi) - np.pi))
    if facing == "auto" and agreed > 0.6 and 25 < abs(turn) < 80:
        return target, f"where the arms thrust, {turn:.0f} degrees to the left of the chest"
    return chest, "the chest, on average"


def _action(
    take: Take,
    places: np.ndarray,
    name: str,
    spans: list[tuple[float, float]],
    heading: float,
    how: Retargeting,
    facing: str,
) -> RetargetedAction:
    """Fit each span, lead from and to the posture, slow down where needed, and bring all to the tick."""
    posture = arm_angles("Guard" if how.posture == "guard" else "Stand")
    times, rows, errors, turned = [np.zeros(1)], [posture[None]], [], 0.0
    for begin, end in spans:
        first, last = (round(float(second) / take.dt_s) for second in (begin, end))
        if not 0 <= first < last < len(places):
            length = (len(places) - 1) * take.dt_s
            raise FileFormatError(f"{take.source}: {name}: {begin:g} to {end:g} s is not within its {length:.2f} s.")
        if last - first < 5:
            raise SettingsError(f"{name}: {begin:g} to {end:g} s has {last - first + 1} frames, expected at least 6.")
        if take.missing[first : last + 1].any():
            gone = (first + int(np.argmax(take.missing[first : last + 1]))) * take.dt_s
            raise FileFormatError(f"{take.source}: {name}: landmarks are missing at {gone:.2f} s.")
        angles, dt_s, error, turn = _fitted(places[first : last + 1], take.dt_s, heading, how, posture)
        when, angles = _led(angles, dt_s, posture, times[-1][-1] + (0.0 if len(rows) == 1 else 0.1))
        times.append(when)
        rows.append(angles)
        errors.append(error)
        turned = max(turned, turn)
    when, angles = np.concatenate(times), np.concatenate(rows)
    keep = np.concatenate([[True], np.diff(when) > 1e-9])
    when, angles = when[keep], angles[keep]
    slow, stretch, largest = _slowed(when, angles)
    grid = np.arange(int(np.ceil(slow[-1] / how.dt_s - 1e-6)) + 1) * how.dt_s
    angles = monotone_cubic(slow, angles, np.minimum(grid, slow[-1]))
    low, high = limits()
    at_limit = (angles < low + _AT_LIMIT_RAD) | (angles > high - _AT_LIMIT_RAD)
    angles, moved = _clear_of_body(angles, posture)
    upper, fore = (np.concatenate([side for error in errors for side in error[k]]) for k in (0, 1))
    report: dict[str, Any] = {
        "cuts_s": [list(map(float, span)) for span in spans],
        "facing": facing,
        "upper_arm_error_deg": [float(upper.mean()), float(upper.max())],
        "forearm_error_deg": [float(fore.mean()), float(fore.max())],
        "at_limit_share": {joint: float(at_limit[:, k].mean()) for k, joint in enumerate(JOINTS)},
        "moved_clear_of_body_rad": moved,
        "stretch": stretch,
        "fastest_before_rad_s": largest,
        "max_speed_rad_s": float(np.abs(np.diff(angles, axis=0)).max() / how.dt_s),
        "duration_s": float(grid[-1]),
    }
    return RetargetedAction(name, angles, how.dt_s, report, _refusal(report, turned))


def _refusal(report: dict[str, Any], turned_deg: float) -> str:
    """Return why the robot's arms cannot make a movement, or an empty text."""
    if turned_deg > MAX_TURN_DEG:
        return (
            f"the chest turns away from where the take faces by {turned_deg:.0f} degrees; say --facing, or cut the take"
        )
    for name, most in (("upper_arm", MAX_UPPER_DEG), ("forearm", MAX_FORE_DEG)):
        if (mean := report[f"{name}_error_deg"][0]) > most:
            return f"the robot's {name.replace('_', ' ')} would point {mean:.0f} degrees beside the person's on average"
    if report["stretch"] > MAX_STRETCH:
        return f"it would have to be {report['stretch']:.1f} times slower ({report['fastest_before_rad_s']:.1f} rad/s)"
    return ""


def _fitted(
    places: np.ndarray, dt_s: float, heading: float, how: Retargeting, posture: np.ndarray
) -> tuple[np.ndarray, float, tuple[list[np.ndarray], list[np.ndarray]], float]:
    """Return angles, their tick, the errors of the directions of each side, and how far the chest turned away."""
    n = len(places)
    if dt_s < 0.0099:  # more frames than 100 a second only cost time
        grid = np.arange(0.0, (n - 1) * dt_s + 1e-9, 0.01)
        flat = places.reshape(n, -1)
        places = np.stack([np.interp(grid, np.arange(n) * dt_s, column) for column in flat.T], axis=1).reshape(-1, 8, 3)
        dt_s = 0.01
    forward = np.array([np.sin(heading), 0.0, np.cos(heading)])
    axes = np.stack([forward, np.cross([0.0, 1.0, 0.0], forward), [0.0, 1.0, 0.0]])
    ahead = np.cross(places[:, 3] - places[:, 0], [0.0, 1.0, 0.0])
    turned = float(np.degrees(np.arccos(np.clip(_unit(ahead.mean(axis=0)) @ forward, -1, 1))))
    paths = [np.ptp(places[:, wrist] - places[:, shoulder], axis=0).max() for shoulder, wrist in ((0, 2), (3, 5))]
    still = [_STILL * max(paths) > path for path in paths] if how.arms == "auto" else [
        how.arms not in ("both", arm) for arm in ("right", "left")
    ]  # fmt: skip
    columns, upper_errors, fore_errors = [], [], []
    for side, (shoulder, elbow, wrist) in enumerate(((0, 1, 2), (3, 4, 5))):
        if still[side]:
            columns.append(np.tile(posture[4 * side : 4 * side + 4], (len(places), 1)))
            upper_errors.append(np.zeros(0))
            fore_errors.append(np.zeros(0))
            continue
        mirror = np.array([1.0, -1.0 if side else 1.0, 1.0])  # as a right arm
        upper = _unit(places[:, elbow] - places[:, shoulder]) @ axes.T * mirror
        fore = _unit(places[:, wrist] - places[:, elbow]) @ axes.T * mirror
        angles = fit(upper, fore, dt_s)
        for made, wanted, errors in zip(directions(angles), (upper, fore), (upper_errors, fore_errors), strict=True):
            errors.append(np.degrees(np.arccos(np.clip((made * wanted).sum(axis=1), -1, 1))))
        columns.append(angles * MIRROR_SIGN if side else angles)
    return np.concatenate(columns, axis=1), dt_s, (upper_errors, fore_errors), turned


def directions(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the directions of the upper arm and the forearm, each (n, 3), of right-arm angles [rad], (n, 4)."""
    pitch, roll, yaw, bend = angles.T
    upper = np.stack([np.cos(pitch) * np.cos(roll), np.sin(roll), -np.sin(pitch) * np.cos(roll)], axis=1)
    x, y, z = np.cos(bend), np.sin(bend) * np.cos(yaw), np.sin(bend) * np.sin(yaw)
    x, y = np.cos(roll) * x - np.sin(roll) * y, np.sin(roll) * x + np.cos(roll) * y
    fore = np.stack([np.cos(pitch) * x + np.sin(pitch) * z, y, -np.sin(pitch) * x + np.cos(pitch) * z], axis=1)
    return upper, fore


def closed_form(upper: np.ndarray, fore: np.ndarray) -> np.ndarray:
    """Return right-arm angles [rad], (n, 4), without limits; where one is not determined it is led across."""
    roll, pitch = np.arcsin(np.clip(upper[:, 1], -1, 1)), np.arctan2(-upper[:, 2], upper[:, 0])
    pitch = _bridged(pitch, np.cos(roll) >= _KNOWN_PITCH)
    c, s = np.cos(pitch), np.sin(pitch)
    x, y, z = c * fore[:, 0] - s * fore[:, 2], fore[:, 1], s * fore[:, 0] + c * fore[:, 2]
    c, s = np.cos(roll), np.sin(roll)
    x, y = c * x + s * y, -s * x + c * y
    bend = np.arccos(np.clip(x, -1, 1))
    return np.stack([pitch, roll, _bridged(np.arctan2(z, y), np.sin(bend) >= _KNOWN_YAW), bend], axis=1)


def _bridged(angle: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Lead an angle across where it is not known, without jumps of a whole turn."""
    if known.sum() < 2:
        return np.full_like(angle, angle[known].mean() if known.any() else 0.0)
    times = np.arange(len(angle))
    values = np.unwrap(angle[known])
    values -= 2 * np.pi * np.round(np.median(values) / (2 * np.pi))
    return np.interp(times, times[known], values)


def fit(upper: np.ndarray, fore: np.ndarray, dt_s: float) -> np.ndarray:
    """Return right-arm angles [rad], (n, 4), within the joints' ranges, all frames at once.

    Levenberg-Marquardt with an active set on the fist's place and both directions, with a price on speed and
    acceleration; its matrix is banded, so that time grows as the number of frames.

    Args:
        upper: Directions of the upper arm in the trunk's frame, mirrored for a left arm, shape (n, 3).
        fore: Those of the forearm.
        dt_s: Time between frames [s].
    """
    from scipy.linalg import solveh_banded

    low, high = (pair[:4] for pair in limits())
    angles = np.clip(closed_form(upper, fore), low, high)
    n, whole = len(angles), UPPER_M + FORE_M
    goal = (UPPER_M * upper + FORE_M * fore) / whole
    price = _prices(n, dt_s)

    def residual(angles: np.ndarray) -> np.ndarray:
        a, b = directions(angles)
        fist = (UPPER_M * a + FORE_M * b) / whole - goal
        return np.concatenate([_FIST * fist, _UPPER * (a - upper), _FORE * (b - fore)], axis=1)

    def smooth(flat: np.ndarray) -> np.ndarray:
        result = price[0] * flat
        for k in (4, 8):
            result[:-k] += price[k, :-k] * flat[k:]
            result[k:] += price[k, :-k] * flat[:-k]
        return result

    def cost(angles: np.ndarray) -> float:
        return float((residual(angles) ** 2).sum() + angles.ravel() @ smooth(angles.ravel()))

    best, damping = cost(angles), 1e-3
    bottom, top = np.tile(low, n), np.tile(high, n)
    for _ in range(_MOST_ITERATIONS):
        now = residual(angles)
        jacobian = np.empty((n, 9, 4))
        for k in range(4):
            moved = angles.copy()
            moved[:, k] += 1e-6
            jacobian[:, :, k] = (residual(moved) - now) / 1e-6
        flat = angles.ravel()
        slope = np.einsum("nri,nr->ni", jacobian, now).ravel() + smooth(flat)
        blocks = np.einsum("nri,nrj->nij", jacobian, jacobian)
        band = price.copy()
        for k in range(4):  # lower diagonals of the blocks
            for column in range(4 - k):
                band[k, column::4] += blocks[:, column + k, column]
        free = ~(((flat <= bottom + 1e-9) & (slope > 0)) | ((flat >= top - 1e-9) & (slope < 0)))
        for k in range(1, 9):
            band[k, :-k] *= free[:-k] & free[k:]
        band[0] = np.where(free, band[0], 1.0) + damping
        step = solveh_banded(band, slope * free, lower=True, check_finite=False)
        fresh = np.clip(flat - step, bottom, top).reshape(n, 4)
        new = cost(fresh)
        if new < best:
            done = best - new < 1e-7 * best + 1e-12
            angles, best, damping = fresh, new, damping * 0.3
            if done:
                break
        else:
            damping *= 10
            if damping > 1e6:
                break
    return angles


def _prices(n: int, dt_s: float) -> np.ndarray:
    """Return the price of speed and acceleration of every joint as a banded matrix, lower form, shape (9, 4 n)."""
    first, second = np.zeros((3, n)), np.zeros((3, n))
    first[0, :-1] += 1
    first[0, 1:] += 1
    first[1, :-1] -= 1
    for offset, weights in ((0, (1, 4, 1)), (1, (-2, -2)), (2, (1,))):
        for start, weight in enumerate(weights):
            second[offset, start : n - 2 + start] += weight
    whole = _SPEED_PRICE / dt_s**2 * first + _ACCELERATION_PRICE / dt_s**4 * second
    band = np.zeros((9, 4 * n))
    for offset in range(3):
        band[4 * offset] = np.repeat(whole[offset], 4)
    return band


def _led(angles: np.ndarray, dt_s: float, posture: np.ndarray, start_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times and angles from the posture into a movement and back; near ends are blended, far ones led to."""
    n = len(angles)
    share = np.arange(n) * dt_s / max(min(0.3, 0.25 * n * dt_s), 1e-9)
    before, after = np.zeros((0, len(posture))), np.zeros((0, len(posture)))
    for end, towards in ((0, share), (-1, share[::-1])):
        gap = posture - angles[end]
        if np.abs(gap).max() <= _BLENDED_RAD:
            angles = angles + (1.0 - _eased(towards))[:, None] * gap
            continue
        n_led = max(3, round(1.875 * float(np.abs(gap).max()) / _LEAD_RAD_S / dt_s))
        way = _eased(np.arange(1, n_led) / n_led)[:, None]
        if end == 0:
            before = np.concatenate([posture[None], posture - way * gap])
        else:
            after = np.concatenate([angles[-1] + way * gap, posture[None]])
    low, high = limits()
    whole = np.clip(np.concatenate([before, angles, after]), low, high)
    return start_s + np.arange(len(whole)) * dt_s, whole


def _clear_of_body(angles: np.ndarray, posture: np.ndarray) -> tuple[np.ndarray, float]:
    """Return angles moved towards the posture just where the robot would touch itself, and how far at most [rad]."""
    import mujoco

    from creative_nao.robot import Scene

    scene = Scene(with_bag=False)
    model, data = scene.model, mujoco.MjData(scene.model)  # pyright: ignore[reportAttributeAccessIssue]
    scene.place(data, "Guard")
    own = np.flatnonzero(model.body_rootid[model.geom_bodyid] == model.body_rootid[scene.index.torso])

    def touches(arms: np.ndarray) -> bool:
        data.qpos[scene.index.arm_qpos] = arms
        mujoco.mj_kinematics(model, data)  # pyright: ignore[reportAttributeAccessIssue]
        mujoco.mj_collision(model, data)  # pyright: ignore[reportAttributeAccessIssue]
        return bool(np.isin(data.contact.geom, own).all(axis=1).any())

    share = np.zeros(len(angles))
    shares = np.linspace(0.1, 1.0, 10)
    for _ in range(4):
        now = angles + share[:, None] * (posture - angles)
        touching = [k for k, arms in enumerate(now) if touches(arms)]
        if not touching:
            break
        for k in touching:
            free = (s for s in shares[shares > share[k]] if not touches(angles[k] + s * (posture - angles[k])))
            share[k] = min(1.0, next(free, 1.0) + 0.05)
        width = round(_CLEAR_S / _TICK_S)
        wide = np.lib.stride_tricks.sliding_window_view(np.pad(share, 2 * width, mode="edge"), 2 * width + 1).max(
            axis=1
        )
        window = np.hanning(2 * width + 3)[1:-1]
        share = np.convolve(wide, window / window.sum(), "valid")
    moved = angles + share[:, None] * (posture - angles)
    return moved, float(np.abs(moved - angles).max())


def _eased(share: np.ndarray) -> np.ndarray:
    s = np.clip(share, 0, 1)
    return s**3 * (10 - 15 * s + 6 * s**2)


def _slowed(times: np.ndarray, angles: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Return times at which every joint can follow, slower only around where one is too fast, and by which factor."""
    steps = np.diff(times)
    rates = np.abs(np.diff(angles, axis=0))
    allowed = _SHARE_OF_SPEED * np.array([MAX_SPEED_RAD_S[joint] for joint in JOINTS])
    needed = np.maximum(steps, (rates / allowed).max(axis=1))
    width = np.hanning(9)[1:-1]
    eased = np.convolve(np.pad(needed / steps, 3, mode="edge"), width / width.sum(), "valid")
    slower = np.maximum(needed, steps * eased)
    largest = float((rates / steps[:, None]).max())
    return times[0] + np.concatenate([[0.0], np.cumsum(slower)]), float(slower.sum() / steps.sum()), largest
