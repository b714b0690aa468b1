"""The tasks for dm_control by name, as `dm_control.suite.load` has them."""

# dm_control may be missing: pip cannot install it on Python 3.13.
# pyright: reportMissingImports=false
from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from creative_nao.errors import NotFoundError, nearest_name

if TYPE_CHECKING:
    from dm_control import composer


def _boxing(**arguments: Any) -> composer.Environment:
    from creative_nao.envs import boxing_task

    return boxing_task.load(**arguments)


TASKS: dict[str, Callable[..., Any]] = {"boxing": _boxing}
"""Each task's name and what makes its environment."""


def load(task: str = "boxing", **arguments: Any) -> composer.Environment:
    """Return a task as a dm_control environment.

    Args:
        task: A name of `TASKS`.
        arguments: Those of the task; `boxing_task.load` tells them: `seed`, `control_step_s`, `time_limit_s`,
            `start_noise_rad`.

    Raises:
        NotFoundError: If there is no such task.
    """
    if task not in TASKS:
        raise NotFoundError(f"no task `{task}`{nearest_name(task, TASKS)}; there are {', '.join(TASKS)}")
    return TASKS[task](**arguments)
