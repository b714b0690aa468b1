"""The NAO in MuJoCo, its ring and its bag, how it performs a trajectory and how it is filmed; no network is needed.

- Model files (MJCF): `NAO_XML`, `BAG_XML`, `RING_XML`, `SCENE_XML`
- Robot: `Scene`, `bare_scene`, `Index`, `place`, `ServoSettings`, `Stiffness`, `POSTURES`, `posture`, `arm_angles`
- Performing: `Performer`, `PlaybackSettings`, `Performance`, `Hits`
- Domain randomisation: `RobotVariation`, `Varied`
- Physical failures: `PhysicalLimits`, `failures`, `first_failure`, `PHYSICAL_FAILURES`
- Drawing: `Renderer`, `can_draw`, `pictures`, `moments`, `film_strip`, `write_gif`, `imagined_frames`

Names load at first use: importing this package alone loads neither MuJoCo nor GL.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from creative_nao.robot import rendering

if TYPE_CHECKING:
    from creative_nao.robot.film import film_strip, imagined_frames, moments, pictures, write_gif
    from creative_nao.robot.performance import (
        PHYSICAL_FAILURES,
        Hits,
        Performance,
        PhysicalLimits,
        failures,
        first_failure,
    )
    from creative_nao.robot.playback import Performer, PlaybackSettings, RobotVariation, Varied
    from creative_nao.robot.postures import POSTURES, arm_angles, posture
    from creative_nao.robot.rendering import Renderer, can_draw
    from creative_nao.robot.scene import (
        BAG_XML,
        NAO_XML,
        RING_XML,
        SCENE_XML,
        Index,
        Scene,
        ServoSettings,
        Stiffness,
        bare_scene,
        place,
    )

__all__ = [
    "BAG_XML",
    "NAO_XML",
    "PHYSICAL_FAILURES",
    "POSTURES",
    "RING_XML",
    "SCENE_XML",
    "Hits",
    "Index",
    "Performance",
    "Performer",
    "PhysicalLimits",
    "PlaybackSettings",
    "Renderer",
    "RobotVariation",
    "Scene",
    "ServoSettings",
    "Stiffness",
    "Varied",
    "arm_angles",
    "bare_scene",
    "can_draw",
    "failures",
    "film_strip",
    "first_failure",
    "imagined_frames",
    "moments",
    "pictures",
    "place",
    "posture",
    "write_gif",
]

_FILES = {
    "film": ("film_strip", "imagined_frames", "moments", "pictures", "write_gif"),
    "performance": ("PHYSICAL_FAILURES", "Hits", "Performance", "PhysicalLimits", "failures", "first_failure"),
    "playback": ("Performer", "PlaybackSettings", "RobotVariation", "Varied"),
    "postures": ("POSTURES", "arm_angles", "posture"),
    "rendering": ("Renderer", "can_draw"),
}
_HOMES = {name: file for file, names in _FILES.items() for name in names}

rendering.choose_backend()  # before anything below imports MuJoCo


def __getattr__(name: str) -> Any:
    """Load a public name from the file that holds it."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES.get(name, 'scene')}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
