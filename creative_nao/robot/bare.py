"""A scene for computing only: nothing that is drawn, no sensor that no performance reads.

The states are bit for bit those of the full scene, since what is left away has no mass, touches nothing and pushes
nothing; a performance takes about a sixth less time (`benchmarks/physics.py crowd`).
"""

# MuJoCo and PyMJCF tell type checkers nothing about their members.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false, reportMissingImports=false
from __future__ import annotations

from creative_nao.robot.playback import SENSORS_READ
from creative_nao.robot.scene import Scene
from creative_nao.robot.servos import ServoSettings


def bare_scene(*, with_bag: bool = True, servos: ServoSettings | None = None) -> Scene:
    """Return a scene in which the same performances happen, but which cannot be shown.

    Args:
        with_bag: Whether the bag hangs there.
        servos: Gains of the servos.
    """
    scene = Scene(with_bag=with_bag, servos=servos)
    root = scene.arena.mjcf_model
    read = {name for names in SENSORS_READ.values() for name in names}
    for sensor in root.find_all("sensor"):
        if sensor.full_identifier not in read:
            sensor.remove()
    for geom in root.find_all("geom"):
        if geom.contype == 0 and geom.conaffinity == 0:
            geom.remove()
    for seen in (*root.find_all("camera"), *root.find_all("light")):
        seen.remove()
    return scene
