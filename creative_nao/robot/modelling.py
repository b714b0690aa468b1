"""What the robot is modelled with: the one place that imports dm_control, and says how to get it where it is missing.

On Python 3.13 pip cannot install dm-control by itself: it asks for labmaze, which has no wheel there and serves only
mazes, of which there are none here. Everything but the robot's body works without it.
"""

from __future__ import annotations

from creative_nao.errors import MissingDependencyError

try:
    from dm_control import composer, mjcf
    from dm_control.composer import define
    from dm_control.composer.observation import observable
except ModuleNotFoundError as error:
    if error.name != "dm_control":
        raise
    raise MissingDependencyError(
        "dm-control is missing: pip leaves it out on Python 3.13 (labmaze, which dm-control asks for "
        "and nothing here uses, has no wheel there); the robot's body needs it: pip install --no-deps dm-control"
    ) from None

__all__ = ["composer", "define", "mjcf", "observable"]
