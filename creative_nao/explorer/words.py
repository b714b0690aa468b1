"""What a movement is worth, in words."""

from __future__ import annotations

import numpy as np

from creative_nao.explorer.mind import Mind, Recall
from creative_nao.measures import excursion_limit, excursions
from creative_nao.pb_space.palette import action_letter

OUTCOME_WORDS = {
    "learned": "like a basic action",
    "unlearned": "new: nobody taught it",
    "fluctuating": "too fast for the motors",
    "non_moving": "hardly moves",
}
BODY_WORDS = {
    "joint_limit": "beyond a joint's range",
    "torque_saturated": "motors at their limit",
    "tracking_error": "the arms cannot follow",
    "self_collision": "touches itself",
    "fell": "falls",
}
"""What only a body adds."""


def spoken(name: str) -> str:
    """Return the name of a basic action as it is read aloud: `left_jab` is left jab."""
    return name.replace("_", " ")


def describe(recall: Recall, mind: Mind, digits: int = 3) -> str:
    """Return one sentence for the eye and for a screen reader; the PB has so many decimals."""
    where = f"PB {recall.pb[0]:.{digits}f}, {recall.pb[1]:.{digits}f}"
    if len(recall.points) > 1:
        where = f"path of {len(recall.points)} points to {where}"
    letter, name = action_letter(recall.nearest), spoken(mind.names[recall.nearest])
    verdict = "appropriate" if recall.appropriate else "inappropriate"
    text = f"{where}; {verdict}, {OUTCOME_WORDS[recall.outcome]}; nearest {letter} {name}; novelty {recall.novelty:.1f}"
    why = reason(recall, mind)
    return f"{text}; {why}" if why else text


def reason(recall: Recall, mind: Mind) -> str:
    """Return why a movement is inappropriate, with the figures, or an empty string."""
    if recall.outcome == "fluctuating":
        excess = recall.speeds / mind.limit_rad_s
        tick, joint = np.unravel_index(int(excess.argmax()), excess.shape)
        speed, seconds = recall.speeds[tick, joint], tick * mind.memory.dt_s
        limit = mind.limit_rad_s[joint]
        return f"{mind.memory.joints[joint]} reaches {speed:.1f} rad/s at {seconds:.2f} s, the limit is {limit:.1f}"
    if recall.outcome == "non_moving":
        limit = excursion_limit(mind.memory.demonstrations)
        travelled = float(excursions(recall.trajectory[None])[0])
        return f"the widest joint travels {travelled:.3f} rad, {limit:.3f} are needed"
    return ""
