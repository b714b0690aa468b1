"""The promises of a dm_control environment, in the manner of the tests of dm_control's own suite."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from creative_nao.testing.conformance import demand, same

N_STEPS = 30


def check_task(load: Callable[..., Any], *, n_steps: int = N_STEPS) -> None:
    """Check a dm_control environment.

    The promises: the action spec is bounded and finite; observations are those of the observation spec, by name, shape
    and type, and finite; a first step has neither reward nor discount; rewards are finite and discounts in [0, 1],
    whether actions are drawn or at the ends of the range; equal seeds and actions give equal bits; an episode that has
    begun goes on after `reset`.

    Args:
        load: Makes the environment from a `seed`, as `creative_nao.envs.load` does.
        n_steps: Steps tried of each kind.

    Raises:
        ConformanceError: If a promise is broken.
    """
    env = load(seed=1)
    spec = env.action_spec()
    low, high = np.asarray(spec.minimum), np.asarray(spec.maximum)
    bounded = np.isfinite(low).all() and np.isfinite(high).all() and (low < high).all()
    demand(bounded, "the action spec should have finite bounds, low below high", (low.tolist(), high.tolist()))
    rng = np.random.default_rng(0)
    drawn = [rng.uniform(low, high, spec.shape).astype(spec.dtype) for _ in range(n_steps)]
    ends = [(low if step % 2 else high).astype(spec.dtype) * np.ones(spec.shape, spec.dtype) for step in range(n_steps)]
    for actions in (drawn, ends):
        for step in _play(env, actions):
            _check_step(env, step)
    one, other = (_play(load(seed=7), drawn) for _ in range(2))
    demand(
        same([list(step) for step in one], [list(step) for step in other]),
        "equal seeds should give equal bits",
        "others",
    )


def _play(env: Any, actions: list[np.ndarray]) -> list[Any]:
    steps = [env.reset()]
    first = steps[0]
    demand(first.first(), "`reset` should return a first step", first.step_type)
    demand(first.reward is None and first.discount is None, "a first step should have no reward", first.reward)
    for action in actions:
        steps.append(env.step(action))
        if steps[-1].last():
            break
    return steps


def _check_step(env: Any, step: Any) -> None:
    expected = env.observation_spec()
    demand(
        step.observation.keys() == expected.keys(),
        f"observations should be those of the spec, {', '.join(expected)}",
        ", ".join(step.observation),
    )
    for name, spec in expected.items():
        found = np.asarray(step.observation[name])
        demand(found.shape == spec.shape, f"observation `{name}` should have shape {spec.shape}", found.shape)
        demand(found.dtype == spec.dtype, f"observation `{name}` should be {spec.dtype}", found.dtype)
        demand(np.isfinite(found).all(), f"observation `{name}` should be finite", found.tolist())
    if not step.first():
        demand(np.isfinite(step.reward), "rewards should be finite", step.reward)
        demand(0.0 <= step.discount <= 1.0, "discounts should lie in [0, 1]", step.discount)
