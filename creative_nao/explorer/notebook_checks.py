"""Is what was made in the page fit to be taught? What is wrong is said in one line, nothing is mended."""

from __future__ import annotations

import numpy as np

from creative_nao.explorer.notebook import Draft, Notebook
from creative_nao.explorer.words import spoken
from creative_nao.joints import JOINTS, MAX_SPEED_RAD_S
from creative_nao.measures import Criteria, dtw_matrix

MIN_DURATION_S = 0.6
MIN_EXCURSION_RAD = 0.1
"""What the widest joint should travel at least [rad]."""
START_TOLERANCE_RAD = 0.3
"""How far a demonstration may start from the mean start of all [rad]: a memory starts all its movements there."""
PEAK_OF_MEAN = 1.875
"""Largest speed of a minimum-jerk segment, as a multiple of its mean speed."""


def peak_speeds(draft: Draft) -> np.ndarray:
    """Return the largest speed of each joint between two keys [rad/s], shape (n_keys - 1, 8)."""
    movement = draft.movement()
    return PEAK_OF_MEAN * np.abs(np.diff(movement.postures, axis=0)) / np.diff(movement.times_s)[:, None]


def fault(draft: Draft) -> str | None:
    """Return what is wrong with a draft, one line, or None if it can be taught."""
    speeds, limit = peak_speeds(draft), np.array([MAX_SPEED_RAD_S[joint] for joint in JOINTS])
    excess = speeds / limit
    if excess.max() > 1:
        segment, joint = np.unravel_index(int(excess.argmax()), excess.shape)
        begin, end = draft.keys[segment].time_s, draft.keys[segment + 1].time_s
        needed = (end - begin) * excess[segment, joint]
        return (
            f"{spoken(draft.name)}: {JOINTS[joint]} reaches {speeds[segment, joint]:.1f} rad/s between {begin:.2f} and "
            f"{end:.2f} s, its motor {limit[joint]:.1f}; give it {np.ceil(100 * needed) / 100:.2f} s"
        )
    if draft.duration_s < MIN_DURATION_S:
        return f"{spoken(draft.name)}: lasts {draft.duration_s:.2f} s, expected {MIN_DURATION_S} s or more"
    travelled = float(np.ptp(draft.trajectory(), axis=0).max())
    if travelled < MIN_EXCURSION_RAD:
        return (
            f"{spoken(draft.name)}: hardly moves, its widest joint travels {travelled:.2f} rad, expected "
            f"{MIN_EXCURSION_RAD} or more; add a key and drag the sliders"
        )
    return None


def shortcomings(notebook: Notebook) -> list[str]:
    """Return what keeps the set from being taught, one line each; empty when all is well."""
    found = [one for one in map(fault, notebook.drafts) if one]
    if len(notebook.drafts) < 2:
        return [*found, "a memory needs two demonstrations or more; add one, or the mirror image of the first"]
    every = np.concatenate([draft.trajectory() for draft in notebook.drafts])
    still = [joint for joint, span in zip(JOINTS, np.ptp(every, axis=0), strict=True) if not span > 0]
    if still:
        found.append(f"{', '.join(still)} never moves in any demonstration; add a mirror image, or move it somewhere")
    return found


def advice(notebook: Notebook) -> list[str]:
    """Return what will make a memory worse, though it can be taught, one line each."""
    if len(notebook.drafts) < 2:
        return []
    found = []
    starts = np.array([draft.keys[0].posture for draft in notebook.drafts])
    away = np.abs(starts - starts.mean(axis=0))
    for draft, one in zip(notebook.drafts, away, strict=True):
        if one.max() > START_TOLERANCE_RAD:
            found.append(
                f"{spoken(draft.name)} starts {one.max():.2f} rad from the mean start at {JOINTS[int(one.argmax())]}; "
                "a memory starts all its movements in one posture"
            )
    distances = dtw_matrix([draft.trajectory() for draft in notebook.drafts])
    threshold = Criteria().learned_threshold
    for i, j in zip(*np.triu_indices(len(distances), 1), strict=True):
        if distances[i, j] < threshold:
            names = f"{spoken(notebook.drafts[i].name)} and {spoken(notebook.drafts[j].name)}"
            found.append(f"{names} are {distances[i, j]:.1f} apart: within {threshold:g} they count as one movement")
    return found
