"""A robot invents movements of its own, and its creativity is measured.

A NAO humanoid is taught six boxing actions; a recurrent network with parametric biases learns them, and its PB space
becomes the robot's memory: every point is a movement, the taught ones and, between them, new ones.

Data: `load_demonstrations`, `Demonstrations`.
Memory: `train`, `load_memory`, `Memory`, `pb_map`, `PBMap`.
Scores: `measures`.
Environments: `gymnasium.make("CreativeNao/Boxing-v0")`, registered by this import.
Agents: `load_agent`.
Errors: `CreativeNaoError` and its children.

Names are loaded when first used; importing the package loads neither torch nor mujoco.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from creative_nao.envs import register_environments
from creative_nao.errors import (
    CreativeNaoError,
    FileFormatError,
    MissingDependencyError,
    NotFoundError,
    SettingsError,
    ShapeError,
    TrainingError,
)

if TYPE_CHECKING:
    from creative_nao import measures
    from creative_nao.agents import load_agent
    from creative_nao.demonstrations import Demonstrations, load_demonstrations
    from creative_nao.maps import PBMap, pb_map
    from creative_nao.model import Memory, load_memory, train

__version__ = "0.1.0"

__all__ = [  # noqa: RUF022 - in reading order
    "load_demonstrations",
    "Demonstrations",
    "train",
    "load_memory",
    "Memory",
    "pb_map",
    "PBMap",
    "measures",
    "load_agent",
    "CreativeNaoError",
    "FileFormatError",
    "MissingDependencyError",
    "NotFoundError",
    "SettingsError",
    "ShapeError",
    "TrainingError",
]

_FILES = {
    "demonstrations": ("load_demonstrations", "Demonstrations"),
    "model": ("train", "load_memory", "Memory"),
    "maps": ("pb_map", "PBMap"),
    "agents": ("load_agent",),
}
_HOMES = {name: part for part, names in _FILES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Load a public name when it is first asked for."""
    if name in _HOMES:
        return getattr(importlib.import_module(f"creative_nao.{_HOMES[name]}"), name)
    if name == "measures":
        return importlib.import_module("creative_nao.measures")
    raise AttributeError(f"module 'creative_nao' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])


register_environments()
