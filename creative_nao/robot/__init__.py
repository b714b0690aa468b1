"""The NAO in MuJoCo, its ring and its bag, how it performs a trajectory and how it is filmed; ignorant of any network.

- Robot: `Nao`, `ServoSettings`, `Stiffness`, `POSTURES`, `posture`, `arm_angles`
- Surroundings: `Ring`, `Bag`, `Scene`, `bare_scene`, `Index`, `place`
- Performing: `Performer`, `PlaybackSettings`, `Performance`, `Hits`
- Differing: `Variation`, `Varied`
- Judging: `PhysicalLimits`, `failures`, `first_failure`, `PHYSICAL_FAILURES`
- Drawing: `Renderer`, `can_draw`, `pictures`, `moments`, `film_strip`, `write_gif`, `imagined_frames`

Names load at first use: importing this package alone loads neither MuJoCo nor GL.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from creative_nao.robot import headless

if TYPE_CHECKING:
    from creative_nao.robot.arena import Ring
    from creative_nao.robot.bag import Bag
    from creative_nao.robot.bare import bare_scene
    from creative_nao.robot.feasibility import PHYSICAL_FAILURES, PhysicalLimits, failures, first_failure
    from creative_nao.robot.film import film_strip, imagined_frames, moments, pictures, write_gif
    from creative_nao.robot.nao import Nao
    from creative_nao.robot.performance import Hits, Performance
    from creative_nao.robot.playback import Performer, PlaybackSettings
    from creative_nao.robot.postures import POSTURES, arm_angles, posture
    from creative_nao.robot.rendering import Renderer, can_draw
    from creative_nao.robot.scene import Index, Scene, place
    from creative_nao.robot.servos import ServoSettings, Stiffness
    from creative_nao.robot.variation import Variation, Varied

__all__ = [
    "PHYSICAL_FAILURES",
    "POSTURES",
    "Bag",
    "Hits",
    "Index",
    "Nao",
    "Performance",
    "Performer",
    "PhysicalLimits",
    "PlaybackSettings",
    "Renderer",
    "Ring",
    "Scene",
    "ServoSettings",
    "Stiffness",
    "Variation",
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

_HOMES = {
    "Bag": "bag",
    "Hits": "performance",
    "Index": "scene",
    "Nao": "nao",
    "PHYSICAL_FAILURES": "feasibility",
    "POSTURES": "postures",
    "Performance": "performance",
    "Performer": "playback",
    "PhysicalLimits": "feasibility",
    "PlaybackSettings": "playback",
    "Renderer": "rendering",
    "Ring": "arena",
    "Scene": "scene",
    "ServoSettings": "servos",
    "Stiffness": "servos",
    "Variation": "variation",
    "Varied": "variation",
    "arm_angles": "postures",
    "bare_scene": "bare",
    "can_draw": "rendering",
    "failures": "feasibility",
    "film_strip": "film",
    "first_failure": "feasibility",
    "imagined_frames": "film",
    "moments": "film",
    "pictures": "film",
    "place": "scene",
    "posture": "postures",
    "write_gif": "film",
}

headless.prepare()  # before anything below imports MuJoCo


def __getattr__(name: str) -> Any:
    """Load a public name from the file that holds it."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
