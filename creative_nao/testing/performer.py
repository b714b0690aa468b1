"""The promises of a robot that performs trajectories, as `robot.Performer` does."""

from __future__ import annotations

from typing import Any

import numpy as np

from creative_nao.demonstrations import Demonstrations, load_demonstrations
from creative_nao.robot import PhysicalLimits, failures
from creative_nao.testing.conformance import demand, same

_MEASURED = ("measured", "commanded")
_PER_JOINT = ("mean_error_rad", "max_error_rad", "saturated_share")


def check_performer(
    performer: Any, demonstrations: Demonstrations | None = None, limits: PhysicalLimits | None = None
) -> None:
    """Check a robot that performs trajectories.

    The promises: `perform(trajectory, dt_s)` returns a `robot.Performance` whose `measured` is finite and of the shape
    of the trajectory, whose shares lie in [0, 1] and whose errors are not negative. It leaves the trajectory alone and
    gives the same bits again, also after another movement: every performance starts from the same state. Standing
    still in the first posture trips nothing, and the robot can do what it was taught: every basic action passes.

    Args:
        performer: The robot.
        demonstrations: What it was taught; default: the six shipped basic actions.
        limits: From where on a performance counts as failed; default: the project's.

    Raises:
        ConformanceError: If a promise is broken.
    """
    taught = demonstrations or load_demonstrations()
    first, *_, last = taught.trajectories
    still = np.repeat(first[:1], len(first), axis=0)
    _check_form(performer, still, taught.dt_s)
    _check_passes("standing still in the first posture", performer.perform(still, taught.dt_s), limits)
    kept = performer.perform(first, taught.dt_s)
    performer.perform(last, taught.dt_s)
    again = performer.perform(first, taught.dt_s)
    for name in (*_MEASURED, *_PER_JOINT):
        demand(
            same(getattr(kept, name), getattr(again, name)),
            f"the same movement should give the same bits of `{name}` again, also after another movement",
            "others",
        )
    for name, trajectory in zip(taught.names, taught.trajectories, strict=True):
        _check_passes(f"basic action {name}", performer.perform(trajectory, taught.dt_s), limits)


def _check_form(performer: Any, trajectory: np.ndarray, dt_s: float) -> None:
    given = trajectory.copy()
    done = performer.perform(given, dt_s)
    demand(same(given, trajectory), "`perform` should leave the trajectory alone", "it changed")
    for name in _MEASURED:
        found = np.asarray(getattr(done, name, None))
        demand(found.shape == trajectory.shape, f"`{name}` should have shape {trajectory.shape}", found.shape)
        demand(np.isfinite(found).all(), f"`{name}` should be finite", "angles that are not")
    for name in _PER_JOINT:
        found = np.asarray(getattr(done, name, None))
        demand(found.shape == trajectory.shape[1:], f"`{name}` should have shape {trajectory.shape[1:]}", found.shape)
        demand((found >= 0).all(), f"`{name}` should not be negative", found.tolist())
    shares = [*np.asarray(done.saturated_share).tolist(), done.self_collision_share]
    demand(all(0 <= share <= 1 for share in shares), "shares of the time should lie in [0, 1]", shares)


def _check_passes(what: str, done: Any, limits: PhysicalLimits | None) -> None:
    tripped = failures(done, limits)
    demand(not tripped, f"{what} should be performable", ", ".join(tripped))
