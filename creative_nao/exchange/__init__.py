"""Movements out of the project and into it: tables, programs for the robot, ROS, Webots. No network, no simulator.

- `Motion`: angles, tick, joints, metadata (`motion.py`); `read` and `write` do all formats (`formats.py`).
- `inspect`, `made_safe`, `UnsafeMotionError`: may a robot be asked to do it (`safety.py`)?
- `FORMATS`: csv and npz (`tables.py`), naoqi (`naoqi_script.py`, read by `python_keys.py`), json (`key_lists.py`),
  ros (`ros_trajectory.py`, `yaml_subset.py`), webots (`webots_motion.py`).
- `keys.py` turns what an importer found into a movement; `reading.py` bounds what is read.
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
