"""Do a memory, a robot, a task or an environment of yours keep the promises that this project builds on?

- `check_memory`: whatever generates trajectories from PB points.
- `check_performer`: a robot that performs trajectories.
- `check_task`: a dm_control environment to box tick by tick.
- `check_environment`: a Gymnasium environment with this project's rewards and `info`.

Each returns None when every promise is kept, and raises a `ConformanceError` that names the first broken one, what was
expected and what came. They need nothing but the object, so that they can be one line of your own tests.

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
