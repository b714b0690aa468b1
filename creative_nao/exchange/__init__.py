"""Movements out of the project and into it: tables, programs for the robot, ROS, Webots. No network, no simulator.

`read` and `write` do all `FORMATS`; `inspect` and `made_safe` say whether a robot may be asked to do it.
"""

from creative_nao.exchange.formats import FORMATS, Exported, format_for, read, recognise, write
from creative_nao.exchange.keys import Motion, Recording
from creative_nao.exchange.safety import UNSAFE, Finding, Unsafe, UnsafeMotionError, inspect, made_safe

__all__ = [
    "FORMATS",
    "UNSAFE",
    "Exported",
    "Finding",
    "Motion",
    "Recording",
    "Unsafe",
    "UnsafeMotionError",
    "format_for",
    "inspect",
    "made_safe",
    "read",
    "recognise",
    "write",
]
