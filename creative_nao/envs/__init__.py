"""The environments: a robot's memory as a task.

- `BoxingMentalEnv` (`CreativeNao/BoxingMental-v0`, -v1): actions are generated and scored without physics.
- `BoxingEnv` (`CreativeNao/Boxing-v0`): the NAO performs them in physics, what it measured is scored.
- `BoxingModulationEnv` (`CreativeNao/BoxingModulation-v0`): the PB may change during an action.
- `BoxingRehearsalEnv` (`CreativeNao/BoxingRehearsal-v0`): a step imagines an action, the best is performed on demand.
- `BoxingMentalVectorEnv`, `BoxingVectorEnv`, `BoxingModulationVectorEnv`, `BoxingRehearsalVectorEnv`: vector
  environments, for `gymnasium.make_vec`.
- `Track`: what an agent is told.
- `GridObservation`, `SetObservation` and `GridVectorObservation`, `SetVectorObservation`: the tries of an episode as an
  image, or as rows with a mask.
- `SB3VecEnv`: one of those for Stable-Baselines3.
- `EnvState`: what `get_state` returns and `set_state` takes.
- `load`, `TASKS`: the ring as a dm_control `composer.Environment`, boxing tick by tick.
- `ENVIRONMENTS`, `register_environments`: the names for `gymnasium.make`.

Names are loaded when first used, so that registering costs nothing.
"""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable
from typing import Any

import lazy_loader

from creative_nao.errors import NotFoundError, nearest_name

__getattr__, _, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ += ["ENVIRONMENTS", "TASKS", "VECTOR_ENVIRONMENTS", "load", "register_environments"]

_LENGTHS = {
    "Boxing-v0": 30,
    "BoxingMental-v0": 30,
    "BoxingModulation-v0": 300,
    "Boxing-v1": 30,
    "BoxingMental-v1": 30,
    "BoxingModulation-v1": 300,
    "BoxingRehearsal-v0": 240,
}
"""Most steps of an episode of each, unless `n_actions` or `n_imagined` changes it."""
_NAMES = {
    f"CreativeNao/{name}": f"{__name__}.{'rehearsal_env' if 'Rehearsal' in name else 'boxing_envs'}:{name[:-3]}"
    for name in _LENGTHS
}
ENVIRONMENTS = {name: f"{path}Env" for name, path in _NAMES.items()}
"""Every environment of the project and the class behind it."""
VECTOR_ENVIRONMENTS = {name: f"{path}VectorEnv" for name, path in _NAMES.items()}
"""The vector environment of each."""


def register_environments() -> None:
    """Register all environments; a second call changes nothing.

    -v1 differs from -v0 in the setting `observation`, which rehearsal has too. Gymnasium calls -v0 out of date when it
    is made; here that warning is left away, since trained agents and published figures are bound to it.
    """
    from gymnasium.envs.registration import register, registry

    from creative_nao.envs.spec import EpisodeLength

    out_of_date = r".*CreativeNao/\w+-v0 is out of date"
    warnings.filterwarnings("ignore", message=out_of_date, category=DeprecationWarning)
    for (name, entry_point), n_steps in zip(ENVIRONMENTS.items(), _LENGTHS.values(), strict=True):
        if name not in registry:
            register(
                name, entry_point, max_episode_steps=EpisodeLength(n_steps),
                vector_entry_point=VECTOR_ENVIRONMENTS[name],
                kwargs={"observation": "trajectories"} if name.endswith("-v1") or "Rehearsal" in name else {},
            )  # fmt: skip


TASKS: dict[str, Callable[..., Any]] = {
    "boxing": lambda **arguments: importlib.import_module(f"{__name__}.boxing_task").load(**arguments)
}
"""Each task's name and what makes its environment."""


def load(task: str = "boxing", **arguments: Any) -> Any:
    """Return a task as a dm_control environment.

    Args:
        task: A name of `TASKS`.
        arguments: Those of the task, for boxing those of `boxing_task.load`: `seed`, `control_step_s`, `time_limit_s`,
            `start_noise_rad`, `environment_kwargs`.

    Raises:
        NotFoundError: If there is no such task.

    Example:
        >>> load("boxing", seed=0).action_spec().shape
        (8,)
    """
    if not isinstance(task, str) or task not in TASKS:
        raise NotFoundError(f"no task `{task}`{nearest_name(task, TASKS)}; there are {', '.join(TASKS)}")
    return TASKS[task](**arguments)


def __dir__() -> list[str]:
    return sorted(__all__)
