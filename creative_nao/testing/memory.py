"""The promises of a memory: `envs.GeneratingMemory`, and what an environment relies on beyond types."""

from __future__ import annotations

from typing import Any

import numpy as np

from creative_nao.demonstrations import Demonstrations
from creative_nao.testing.conformance import demand, same

N_POINTS = 7
"""Points at which a memory is tried: enough for a batch that no block size divides."""


def check_memory(memory: Any, *, seed: int = 0) -> None:
    """Check whatever generates trajectories from PB points.

    The promises: `demonstrations` are the basic actions, `pb` (n_actions, n_pb) in [-1, 1] where they lie, `joints`
    and `dt_s` those of the demonstrations. `generate(pb, n_steps=None)` takes (n, n_pb) and returns finite float64
    angles [rad], (n, n_steps, n_joints), as long as the longest basic action unless told; it leaves its argument
    alone, gives the same bits again, for a point alone and in any order, and begins everywhere with the same posture.

    Args:
        memory: The memory.
        seed: Seed of the points tried.

    Raises:
        ConformanceError: If a promise is broken.
    """
    taught = getattr(memory, "demonstrations", None)
    demand(isinstance(taught, Demonstrations), "`demonstrations` should be a Demonstrations", type(taught).__name__)
    assert isinstance(taught, Demonstrations)
    known = _check_learned_pb(memory, taught.n_actions)
    for name in ("joints", "dt_s"):
        expected, found = getattr(taught, name), getattr(memory, name, None)
        demand(found == expected, f"`{name}` should be that of the demonstrations, {expected}", found)
    pb = np.random.default_rng(seed).uniform(-1, 1, (N_POINTS, known.shape[1]))
    n_steps = max(len(trajectory) for trajectory in taught.trajectories)
    generated = _check_form(memory, pb, n_steps, len(taught.joints))
    _check_repeatable(memory, pb, generated)
    shorter = memory.generate(pb, n_steps=n_steps - 1)
    demand(np.shape(shorter)[1:2] == (n_steps - 1,), f"n_steps={n_steps - 1} should be obeyed", np.shape(shorter))
    start = generated[:, 0]
    demand((start == start[0]).all(), "row 0 should be one initial posture, whatever the PB", "several")


def _check_learned_pb(memory: Any, n_actions: int) -> np.ndarray:
    pb = np.asarray(getattr(memory, "pb", None))
    demand(
        pb.ndim == 2 and len(pb) == n_actions and pb.shape[1] > 0,
        f"`pb` should have shape ({n_actions}, n_pb), a row for each basic action",
        pb.shape,
    )
    demand(np.isfinite(pb).all() and (np.abs(pb) <= 1).all(), "`pb` should lie in [-1, 1]", pb.tolist())
    return pb


def _check_form(memory: Any, pb: np.ndarray, n_steps: int, n_joints: int) -> np.ndarray:
    given = pb.copy()
    generated = memory.generate(given)
    expected = (len(pb), n_steps, n_joints)
    demand(isinstance(generated, np.ndarray), "`generate` should return an array", type(generated).__name__)
    demand(generated.shape == expected, f"`generate` should return shape {expected}", generated.shape)
    demand(generated.dtype == np.float64, "`generate` should return float64", generated.dtype)
    demand(np.isfinite(generated).all(), "`generate` should return finite angles", "angles that are not")
    demand(same(given, pb), "`generate` should leave its argument alone", "it changed")
    return generated


def _check_repeatable(memory: Any, pb: np.ndarray, generated: np.ndarray) -> None:
    demand(same(memory.generate(pb), generated), "the same points should give the same bits again", "others")
    for place in (0, len(pb) - 1):
        alone = memory.generate(pb[place : place + 1])[0]
        demand(same(alone, generated[place]), "a point alone should give the bits it has in a batch", "others")
    backwards = memory.generate(pb[::-1].copy())[::-1]
    demand(same(backwards.copy(), generated), "the order of the points should change no bit", "it does")
