from .film import (
    film_strip,
    imagined_frames,
    moments,
    pictures,
    write_gif,
    write_mp4,
)
from .performance import (
    PHYSICAL_FAILURES,
    Hits,
    Performance,
    PhysicalLimits,
    failures,
    first_failure,
)
from .playback import (
    Performer,
    PlaybackSettings,
    RobotVariation,
    Varied,
)
from .postures import (
    POSTURES,
    arm_angles,
    posture,
)
from .rendering import (
    Renderer,
    can_draw,
)
from .scene import (
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
    "write_mp4",
]
