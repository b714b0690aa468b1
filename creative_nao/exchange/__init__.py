"""Movements out of the project and into it: tables, programs for the robot, ROS, Webots. No network, no simulator.

- `Motion`: angles, tick, joints, metadata (`keys.py`); `read` and `write` do all formats (`formats.py`).
- `inspect`, `made_safe`, `UnsafeMotionError`: may a robot be asked to do it (`safety.py`)?
- `FORMATS`: csv and npz (`formats.py`), naoqi and json (`choregraphe.py`), ros and webots (`simulators.py`). What an
  importer found becomes a movement in `keys.py`.
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
