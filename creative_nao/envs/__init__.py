"""The environments: a robot's memory as a task.

- `BoxingMentalEnv` (`CreativeNao/BoxingMental-v0`): actions are generated and scored without physics.
- `BoxingEnv` (`CreativeNao/Boxing-v0`): the NAO performs them in physics, what it measured is scored.
- `BoxingModulationEnv` (`CreativeNao/BoxingModulation-v0`): the PB may change during an action.
- `BoxingMentalVectorEnv`, `BoxingVectorEnv`, `BoxingModulationVectorEnv`: vector environments, for
  `gymnasium.make_vec`.
- `SB3VecEnv`: one of those for Stable-Baselines3.
- `EnvState`: what `get_state` returns and `set_state` takes.
- `load`, `TASKS`: the ring as a dm_control `composer.Environment`, boxing tick by tick.
- `ENVIRONMENTS`, `register_environments`: the names for `gymnasium.make`.

Names are loaded when first used, so that registering costs nothing.
"""

# dm_control may be missing: pip cannot install it on Python 3.13.
# pyright: reportMissingImports=false
from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from creative_nao.errors import NotFoundError, nearest_name

if TYPE_CHECKING:
    from dm_control import composer

    from creative_nao.envs.boxing_envs import (
        BoxingEnv,
        BoxingMentalEnv,
        BoxingMentalVectorEnv,
        BoxingModulationEnv,
        BoxingModulationVectorEnv,
        BoxingVectorEnv,
    )
    from creative_nao.envs.sb3 import SB3VecEnv
    from creative_nao.envs.state import EnvState

__all__ = [
    "ENVIRONMENTS", "TASKS", "VECTOR_ENVIRONMENTS", "BoxingEnv", "BoxingMentalEnv", "BoxingMentalVectorEnv",
    "BoxingModulationEnv", "BoxingModulationVectorEnv", "BoxingVectorEnv", "EnvState", "SB3VecEnv", "load",
    "register_environments",
]  # fmt: skip

_LENGTHS = {"Boxing": 30, "BoxingMental": 30, "BoxingModulation": 300}
"""Steps of an episode of each, unless `n_actions` changes it."""
_NAMES = {f"CreativeNao/{name}-v0": f"{__name__}.boxing_envs:{name}" for name in _LENGTHS}
ENVIRONMENTS = {name: f"{path}Env" for name, path in _NAMES.items()}
"""Every environment of the project and the class behind it."""
VECTOR_ENVIRONMENTS = {name: f"{path}VectorEnv" for name, path in _NAMES.items()}
"""The vector environment of each."""


def register_environments() -> None:
    """Register all environments; a second call changes nothing."""
    from gymnasium.envs.registration import register, registry

    from creative_nao.envs.spec import EpisodeLength

    for (name, entry_point), n_steps in zip(ENVIRONMENTS.items(), _LENGTHS.values(), strict=True):
        if name not in registry:
            register(
                name, entry_point, max_episode_steps=EpisodeLength(n_steps),
                vector_entry_point=VECTOR_ENVIRONMENTS[name],
            )  # fmt: skip


TASKS: dict[str, Callable[..., Any]] = {
    "boxing": lambda **arguments: importlib.import_module(f"{__name__}.boxing_task").load(**arguments)
}
"""Each task's name and what makes its environment."""


def load(task: str = "boxing", **arguments: Any) -> composer.Environment:
    """Return a task as a dm_control environment.

    Args:
        task: A name of `TASKS`.
        arguments: Those of the task, for boxing those of `boxing_task.load`: `seed`, `control_step_s`, `time_limit_s`,
            `start_noise_rad`.

    Raises:
        NotFoundError: If there is no such task.

    Example:
        >>> load("boxing", seed=0).action_spec().shape
        (8,)
    """
    if task not in TASKS:
        raise NotFoundError(f"no task `{task}`{nearest_name(task, TASKS)}; there are {', '.join(TASKS)}")
    return TASKS[task](**arguments)


def __getattr__(name: str) -> Any:
    """Load a public name when it is first asked for."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = {"EnvState": "state", "SB3VecEnv": "sb3"}.get(name, "boxing_envs")
    return getattr(importlib.import_module(f"{__name__}.{home}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
