"""The basic actions a network learns from: what they are, where they come from, how to bring your own.

- `load_demonstrations`, `save_demonstrations`: a folder of CSV files; the six ship with the package (`files.py`).
- `load_trajectory`, `save_trajectory`: one CSV file, at any rate (`files.py`).
- `Demonstrations`: names, trajectories, tick, joints and record, checked (`dataset.py`).
- `ACTIONS`, `keyframes`, `Movement`: the six boxing actions as key postures (`keyframes.py`).
- `GuidanceVariation`, `vary`: how a person's guidance differs from them (`keyframes.py`).

`teaching.py` leads the simulated robot's limp arms through them and says what is wrong with the result. It loads MuJoCo
and is imported by name only where something is taught.
"""

from creative_nao.demonstrations.dataset import Demonstrations
from creative_nao.demonstrations.files import load_demonstrations, load_trajectory, save_demonstrations, save_trajectory
from creative_nao.demonstrations.keyframes import ACTIONS, GuidanceVariation, Movement, keyframes, vary

__all__ = [
    "ACTIONS",
    "Demonstrations",
    "GuidanceVariation",
    "Movement",
    "keyframes",
    "load_demonstrations",
    "load_trajectory",
    "save_demonstrations",
    "save_trajectory",
    "vary",
]
