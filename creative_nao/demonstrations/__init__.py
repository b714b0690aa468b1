"""The basic actions a network learns from: what they are, where they come from, how to bring your own.

`teaching.py` loads MuJoCo and is imported by name only where something is taught.
"""

from creative_nao.demonstrations.dataset import Demonstrations
from creative_nao.demonstrations.files import load_demonstrations, load_trajectory, save_demonstrations, save_trajectory
from creative_nao.demonstrations.keyframes import ACTIONS, GuidanceVariation, Movement, keyframes, vary
from creative_nao.demonstrations.retargeting import RetargetedAction, Retargeting, from_motion
from creative_nao.demonstrations.take import Take, load_take, propose_cuts

__all__ = [
    "ACTIONS",
    "Demonstrations",
    "GuidanceVariation",
    "Movement",
    "RetargetedAction",
    "Retargeting",
    "Take",
    "from_motion",
    "keyframes",
    "load_demonstrations",
    "load_take",
    "load_trajectory",
    "propose_cuts",
    "save_demonstrations",
    "save_trajectory",
    "vary",
]
