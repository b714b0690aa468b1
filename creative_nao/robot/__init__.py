"""The NAO in MuJoCo, its ring and its bag, how it performs a trajectory and how it is filmed; ignorant of any network.

- Robot: `Nao`, `ServoSettings`, `Stiffness`, `POSTURES`, `posture`, `arm_angles`
- Surroundings: `Ring`, `Bag`, `Scene`, `Index`, `place`

Names load at first use: importing this package alone loads neither MuJoCo nor GL.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from creative_nao.robot import headless

if TYPE_CHECKING:
    from creative_nao.robot.arena import Ring
    from creative_nao.robot.bag import Bag
    from creative_nao.robot.nao import Nao
    from creative_nao.robot.postures import POSTURES, arm_angles, posture
    from creative_nao.robot.scene import Index, Scene, place
    from creative_nao.robot.servos import ServoSettings, Stiffness

__all__ = [
    "POSTURES",
    "Bag",
    "Index",
    "Nao",
    "Ring",
    "Scene",
    "ServoSettings",
    "Stiffness",
    "arm_angles",
    "place",
    "posture",
]

_HOMES = {
    "POSTURES": "postures",
    "Bag": "bag",
    "Index": "scene",
    "Nao": "nao",
    "Ring": "arena",
    "Scene": "scene",
    "ServoSettings": "servos",
    "Stiffness": "servos",
    "arm_angles": "postures",
    "place": "scene",
    "posture": "postures",
}

headless.prepare()  # before anything below imports MuJoCo


def __getattr__(name: str) -> Any:
    """Load a public name from the file that holds it."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
