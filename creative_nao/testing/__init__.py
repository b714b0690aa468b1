"""Conformance checks: does a memory, robot, task or environment of yours behave as this project requires?

- `check_memory`: whatever generates trajectories from PB points.
- `check_performer`: a robot that performs trajectories.
- `check_task`: a dm_control environment to box tick by tick.
- `check_environment`: a Gymnasium environment with this project's rewards and `info`.

Each returns None when every requirement is met, and raises a `ConformanceError` that names the first that is not, what
was expected and what came. They need nothing but the object, so that they can be one line of your own tests.

Example:
    >>> from creative_nao import load_memory
    >>> check_memory(load_memory("half/0"))
"""

from __future__ import annotations

from creative_nao.testing.conformance import (
    ConformanceError,
    check_environment,
    check_memory,
    check_performer,
    check_task,
)

__all__ = ["ConformanceError", "check_environment", "check_memory", "check_performer", "check_task"]
