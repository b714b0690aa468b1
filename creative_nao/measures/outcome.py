"""The outcome of each generated action: learned, unlearned, fluctuating, non-moving or refused by the body.

`outcome_codes` holds the one order in which these are decided, for measures, maps and environments alike. What it asks
for is measured here with NumPy; `_dtw_kernels.measure_rows` is the compiled twin, for the environments, with the same
bits.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import DTypeLike

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures.dtw import Trajectories, as_numbers, count_trajectories, dtw_matrix
from creative_nao.schema import NonNegative, Positive, checked, record

OUTCOMES = ("learned", "unlearned", "fluctuating", "non_moving")
"""Outcomes of a trajectory by itself; each has exactly one."""
PHYSICAL_FAULTS = ("joint_limit", "torque_saturated", "tracking_error", "self_collision", "fell")
"""Outcomes that only a robot's body adds."""
ALL_OUTCOMES = (*OUTCOMES, *PHYSICAL_FAULTS)
"""Every outcome; its place here is its code."""
APPROPRIATE = ("learned", "unlearned")
"""Outcomes of what a robot can use: the first codes."""
OUTCOME_CODE = {name: code for code, name in enumerate(ALL_OUTCOMES)}
NO_FAULT = -1
"""Code where the body refused nothing."""

BLOCK = 4096  # trajectories looked at together, so that a map of 40,000 needs little memory beside its own


class BasicActions(Protocol):
    """What the measures need of a set of basic actions: `demonstrations.Demonstrations` has it, and more."""

    @property
    def trajectories(self) -> Sequence[np.ndarray]:
        """Joint angles of each action [rad], each of shape (n_steps, n_joints)."""
        ...

    @property
    def dt_s(self) -> float:
        """Time from one posture to the next [s], of the basic actions and of everything compared with them."""
        ...


@record
class Criteria:
    """Where the paper draws the lines between outcomes; its values are the defaults.

    Attributes:
        speed_factor: An action is `fluctuating` above this multiple of the basic actions' largest joint speed.
        excursion_share: It is `non_moving` when no joint travels this share of what the least moving basic action
            travels. The paper gives no figure; a share has no unit and fits any robot.
        learned_threshold: An appropriate action is `learned` up to this distance from a basic action [rad], else
            `unlearned`.
        per_joint: Whether each joint has its own speed limit. By default the fastest joint sets it for all: joints
            that hardly move in the basic actions would otherwise forbid almost everything.
    """

    speed_factor: NonNegative = 1.5
    excursion_share: NonNegative = 0.1
    learned_threshold: NonNegative = 10.0
    per_joint: bool = False


PAPER_CRITERIA = Criteria()
"""The default everywhere."""

SPEED_TOLERANCE = 1.0 + 1e-12  # factor on a limit: the fastest basic action at factor 1 passes, whatever the last bit


def outcome_codes(
    distance: np.ndarray,
    *,
    too_fast: np.ndarray,
    non_moving: np.ndarray,
    fault: np.ndarray | None = None,
    learned_threshold: float = PAPER_CRITERIA.learned_threshold,
) -> np.ndarray:
    """Return the outcome of each of n actions as a code, its place in `ALL_OUTCOMES`, shape (n,) of int.

    The first of these that holds decides: the command is too fast (`fluctuating`), the body refused it (the fault),
    it stands still (`non_moving`), it is close to a basic action (`learned`), else it is `unlearned`.

    Args:
        distance: To the nearest basic action [rad], shape (n,).
        too_fast: Whether a joint of the command exceeds its speed limit, shape (n,) of bool.
        non_moving: Whether no joint travels enough, shape (n,) of bool.
        fault: Code of what the body refused, `NO_FAULT` where nothing, shape (n,) of int; None without a body.
        learned_threshold: Largest distance of what counts as learned [rad].
    """
    codes = np.where(distance <= learned_threshold, OUTCOME_CODE["learned"], OUTCOME_CODE["unlearned"])
    codes[non_moving] = OUTCOME_CODE["non_moving"]
    if fault is not None:
        codes = np.where(fault == NO_FAULT, codes, fault)
    codes[too_fast] = OUTCOME_CODE["fluctuating"]
    return codes


def largest_speeds(trajectories: Trajectories, dt_s: float) -> np.ndarray:
    """Return the largest speed of each joint in each trajectory [rad/s], shape (n, n_joints).

    Speed is the change between two postures divided by the time between them, `dt_s` [s]; a single posture has none.
    """
    dt_s = checked(Positive, dt_s, "dt_s")
    changes = [np.abs(np.diff(block, axis=1)).max(axis=1, initial=0.0) for _, block in _blocks(trajectories)]
    return np.concatenate(changes) / dt_s if changes else np.zeros((0, 0))


def excursions(trajectories: Trajectories) -> np.ndarray:
    """Return how far the most moving joint of each trajectory travels, from end to end [rad], shape (n,)."""
    ranges = [np.ptp(block, axis=1).max(axis=1) for _, block in _blocks(trajectories)]
    return np.concatenate(ranges) if ranges else np.zeros(0)


def speed_limits(demos: BasicActions, criteria: Criteria = PAPER_CRITERIA) -> np.ndarray:
    """Return the speed above which each joint fluctuates [rad/s], shape (n_joints,)."""
    check_basic_actions(demos, criteria)
    fastest = largest_speeds(demos.trajectories, demos.dt_s).max(axis=0)
    if not criteria.per_joint:
        fastest = np.full_like(fastest, fastest.max())
    return criteria.speed_factor * fastest


def excursion_limit(demos: BasicActions, criteria: Criteria = PAPER_CRITERIA) -> float:
    """Return the excursion below which an action counts as standing still [rad]."""
    check_basic_actions(demos, criteria)
    return criteria.excursion_share * float(excursions(demos.trajectories).min())


def is_fluctuating(trajectories: Trajectories, demos: BasicActions, criteria: Criteria = PAPER_CRITERIA) -> np.ndarray:
    """Return for each trajectory whether a joint is faster than its limit, shape (n,) of bool."""
    speeds = largest_speeds(trajectories, demos.dt_s)
    if not len(speeds):
        return np.zeros(0, dtype=bool)
    return np.any(speeds > speed_limits(demos, criteria) * SPEED_TOLERANCE, axis=1)


def is_non_moving(trajectories: Trajectories, demos: BasicActions, criteria: Criteria = PAPER_CRITERIA) -> np.ndarray:
    """Return for each trajectory whether no joint moves enough, shape (n,) of bool."""
    return excursions(trajectories) < excursion_limit(demos, criteria)


def is_appropriate(trajectories: Trajectories, demos: BasicActions, criteria: Criteria = PAPER_CRITERIA) -> np.ndarray:
    """Return for each trajectory whether it neither fluctuates nor stands still, shape (n,) of bool."""
    check_same_joints(trajectories, demos)
    return ~(is_fluctuating(trajectories, demos, criteria) | is_non_moving(trajectories, demos, criteria))


def check_basic_actions(demos: BasicActions, criteria: Criteria = PAPER_CRITERIA) -> None:
    """Refuse what is no set of basic actions, or no criteria, with a SettingsError."""
    if not isinstance(criteria, Criteria):
        raise SettingsError(f"`criteria` should be `Criteria(...)`, but is a {type(criteria).__name__}.")
    if not (hasattr(demos, "trajectories") and hasattr(demos, "dt_s")):
        raise SettingsError(
            "`demos` should be basic actions, with `trajectories` and `dt_s` as `load_demonstrations()` has them, but "
            f"is a {type(demos).__name__}."
        )


def check_same_joints(trajectories: Trajectories, demos: BasicActions) -> None:
    """Refuse trajectories that are not finite arrays of the basic actions' joints: the ShapeError tells where."""
    check_basic_actions(demos)
    n_joints = demos.trajectories[0].shape[1]
    for start, block in _blocks(trajectories):
        if block.ndim != 3 or block.shape[2] != n_joints or block.shape[1] < 1:
            raise ShapeError(
                f"`trajectories[{start}]` should have shape (n_steps, {n_joints}), the joints of the basic actions, "
                f"but has {block.shape[1:]}."
            )
        if not np.isfinite(block).all():
            place, step, joint = np.argwhere(~np.isfinite(block))[0]
            raise ShapeError(f"`trajectories[{start + place}]` is not finite at step {step}, joint {joint}.")


def _blocks(trajectories: Trajectories) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the trajectories as (start, (n, n_steps, n_joints) float64) in order, as many together as is handy."""
    n = count_trajectories(trajectories)
    if isinstance(trajectories, np.ndarray):
        for start in range(0, n, BLOCK):
            yield start, as_numbers(trajectories[start : start + BLOCK], "trajectories")
    else:
        for start, trajectory in enumerate(trajectories):
            yield start, as_numbers(trajectory, f"trajectories[{start}]")[None]


@dataclass(frozen=True, eq=False, repr=False)
class Scores:
    """The measures of n trajectories."""

    outcome: np.ndarray
    """One of `OUTCOMES` each, shape (n,) of str."""
    novelty: np.ndarray
    """Distance to the nearest basic action [rad], shape (n,)."""
    nearest: np.ndarray
    """Which basic action that is, shape (n,) of int."""
    distances: np.ndarray
    """Distance to every basic action [rad], shape (n, n_actions)."""
    appropriate: np.ndarray
    """Whether the outcome is learned or unlearned, shape (n,) of bool."""

    def __len__(self) -> int:
        return len(self.outcome)

    def __repr__(self) -> str:
        counted = ", ".join(f"{np.sum(self.outcome == name)} {name}" for name in OUTCOMES)
        novelty = f"; novelty {self.novelty.min():.2f} to {self.novelty.max():.2f} rad" if len(self) else ""
        return f"Scores of {len(self)} trajectories: {counted}{novelty}"

    def share_pct(self, outcome: str) -> float:
        """Return how many of the trajectories have this outcome [%]; NaN when there are none."""
        return 100.0 * float(np.mean(self.outcome == outcome)) if len(self) else float("nan")


def score(
    trajectories: Trajectories,
    demos: BasicActions,
    criteria: Criteria = PAPER_CRITERIA,
    dtype: DTypeLike = np.float64,
) -> Scores:
    """Score trajectories against the basic actions.

    A trajectory gets the same scores alone, in a map of 40,000 and in any piece of that map. Memory beside the input is
    bounded by the block size and the result. With `dtype` float32 the distances of large maps take two thirds of the
    time; one that equals the threshold to seven digits may then fall on its other side.

    Raises:
        ShapeError: If a trajectory does not have the joints of the basic actions or is not finite.

    Example:
        >>> from creative_nao.demonstrations import load_demonstrations
        >>> demos = load_demonstrations()
        >>> scores = score(demos.trajectories, demos)
        >>> scores.outcome[0], float(scores.novelty[0]), int(scores.nearest[2])
        (np.str_('learned'), 0.0, 2)
    """
    check_same_joints(trajectories, demos)
    basic = list(demos.trajectories)
    distances = np.zeros((len(trajectories), len(basic)))
    for start in range(0, len(trajectories), 2 * BLOCK):
        distances[start : start + 2 * BLOCK] = dtw_matrix(trajectories[start : start + 2 * BLOCK], basic, dtype)
    nearest = distances.argmin(axis=1)
    novelty = distances.min(axis=1)
    codes = outcome_codes(
        novelty,
        too_fast=is_fluctuating(trajectories, demos, criteria),
        non_moving=is_non_moving(trajectories, demos, criteria),
        learned_threshold=criteria.learned_threshold,
    )
    return Scores(np.array(OUTCOMES)[codes], novelty, nearest, distances, codes < len(APPROPRIATE))
