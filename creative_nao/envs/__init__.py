"""The environments: a robot's memory as a task.

- `BoxingMentalEnv` (`CreativeNao/BoxingMental-v0`): actions are generated and scored without physics.
- `BoxingEnv` (`CreativeNao/Boxing-v0`): the NAO performs them in physics, what it measured is scored.
- `BoxingModulationEnv` (`CreativeNao/BoxingModulation-v0`): the PB may change during an action.
- `BoxingMentalVectorEnv`, `BoxingVectorEnv`, `BoxingModulationVectorEnv`: vector environments, for
  `gymnasium.make_vec`.
- `SB3VecEnv`: one of those for Stable-Baselines3.
- `EnvState`: what `get_state` returns and `set_state` takes.
- `load`: the ring as a dm_control `composer.Environment`, boxing tick by tick.
- `ENVIRONMENTS`, `register_environments`: the names for `gymnasium.make`.

Names are loaded when first used, so that registering costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from creative_nao.envs.registration import ENVIRONMENTS, VECTOR_ENVIRONMENTS, register_environments

if TYPE_CHECKING:
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
    from creative_nao.envs.tasks import TASKS, load

__all__ = [
    "ENVIRONMENTS",
    "TASKS",
    "VECTOR_ENVIRONMENTS",
    "BoxingEnv",
    "BoxingMentalEnv",
    "BoxingMentalVectorEnv",
    "BoxingModulationEnv",
    "BoxingModulationVectorEnv",
    "BoxingVectorEnv",
    "EnvState",
    "SB3VecEnv",
    "load",
    "register_environments",
]

_HOMES = {"EnvState": "state", "SB3VecEnv": "sb3", "TASKS": "tasks", "load": "tasks"}


def __getattr__(name: str) -> Any:
    """Load a public name when it is first asked for."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES.get(name, 'boxing_envs')}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
