"""The environments: a robot's memory as a task.

- `BoxingMentalEnv` (`CreativeNao/BoxingMental-v0`): actions are generated and scored in the mind.
- `BoxingEnv` (`CreativeNao/Boxing-v0`): the NAO performs them in physics, what it measured is scored.
- `boxing_task`: the scene and the robot as a dm_control `composer.Environment`.
- `ENVIRONMENTS`, `register_environments`: the names for `gymnasium.make`.

Classes are loaded when first used, so that registering costs nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from creative_nao.envs.registration import ENVIRONMENTS, register_environments

if TYPE_CHECKING:
    from creative_nao.envs.boxing_env import BoxingEnv
    from creative_nao.envs.mental_env import BoxingMentalEnv

__all__ = ["ENVIRONMENTS", "BoxingEnv", "BoxingMentalEnv", "register_environments"]


def __getattr__(name: str) -> Any:
    """Load an environment class when it is first asked for."""
    if name == "BoxingEnv":
        from creative_nao.envs.boxing_env import BoxingEnv

        return BoxingEnv
    if name == "BoxingMentalEnv":
        from creative_nao.envs.mental_env import BoxingMentalEnv

        return BoxingMentalEnv
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
