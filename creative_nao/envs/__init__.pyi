# dm_control may be missing: pip cannot install it on Python 3.13.
# pyright: reportMissingImports=false
import collections.abc
import typing

import dm_control.composer

from .boxing_envs import (
    BoxingEnv,
    BoxingMentalEnv,
    BoxingMentalVectorEnv,
    BoxingModulationEnv,
    BoxingModulationVectorEnv,
    BoxingVectorEnv,
)
from .observation import (
    Track,
)
from .observation_wrappers import (
    GridObservation,
    GridVectorObservation,
    SetObservation,
    SetVectorObservation,
)
from .rehearsal_env import (
    BoxingRehearsalEnv,
    BoxingRehearsalVectorEnv,
)
from .sb3 import (
    SB3VecEnv,
)
from .state import (
    EnvState,
)

ENVIRONMENTS: dict[str, str]
VECTOR_ENVIRONMENTS: dict[str, str]
TASKS: dict[str, collections.abc.Callable[..., typing.Any]]

def register_environments() -> None: ...
def load(task: str = "boxing", **arguments: typing.Any) -> dm_control.composer.Environment: ...

__all__ = [
    "ENVIRONMENTS",
    "TASKS",
    "VECTOR_ENVIRONMENTS",
    "BoxingEnv",
    "BoxingMentalEnv",
    "BoxingMentalVectorEnv",
    "BoxingModulationEnv",
    "BoxingModulationVectorEnv",
    "BoxingRehearsalEnv",
    "BoxingRehearsalVectorEnv",
    "BoxingVectorEnv",
    "EnvState",
    "GridObservation",
    "GridVectorObservation",
    "SB3VecEnv",
    "SetObservation",
    "SetVectorObservation",
    "Track",
    "load",
    "register_environments",
]
