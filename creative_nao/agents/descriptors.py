"""How a movement behaves, in a few numbers: what quality diversity and novelty search sort movements by.

Descriptors read `info["trajectory"]`, the movement as it was scored: imagined in `BoxingMental-v0`, as the encoders
measured it in `Boxing-v0`. An inappropriate movement counts as none at all: a search for variety would otherwise
collect the endless variety of movements that nobody can use.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from creative_nao.errors import SettingsError

N_EXCURSIONS = 2


def arm_excursions(info: Mapping[str, Any]) -> np.ndarray:
    """Return how far each arm moves: the mean over its joints of largest minus smallest angle [rad].

    The first half of the joints counts as one arm and the second as the other: of the NAO the right and the left.
    A punch of the paper reads about (0.06, 0.8) or (0.8, 0.06).

    Args:
        info: Terms of a step in which a movement was scored.

    Returns:
        Shape (2,), at least 0; zero for an inappropriate movement.

    Raises:
        SettingsError: If `info` does not hold the movement.
    """
    trajectory = scored_trajectory(info)
    if not info["appropriate"]:
        return np.zeros(N_EXCURSIONS)
    half = (trajectory.shape[1] + 1) // 2
    excursions = np.ptp(trajectory, axis=0)
    return np.array([excursions[:half].mean(), excursions[half:].mean() if trajectory.shape[1] > 1 else 0.0])


def mean_postures(info: Mapping[str, Any], n_stretches: int) -> np.ndarray:
    """Return the mean posture in each of `n_stretches` equal stretches of a movement [rad].

    Args:
        info: Terms of a step in which a movement was scored.
        n_stretches: Into how many stretches of time the movement is cut; more than it has ticks count as its ticks.

    Returns:
        Shape (n_stretches * n_joints,), stretch by stretch; for an inappropriate movement its first posture, held.

    Raises:
        SettingsError: If `info` does not hold the movement.
    """
    trajectory = scored_trajectory(info)
    n_stretches = min(n_stretches, len(trajectory))
    if not info["appropriate"]:
        return np.tile(trajectory[0], n_stretches)
    return np.concatenate([stretch.mean(axis=0) for stretch in np.array_split(trajectory, n_stretches)])


def scored_trajectory(info: Mapping[str, Any]) -> np.ndarray:
    """Return the movement in `info`, shape (n_steps, n_joints) [rad].

    Raises:
        SettingsError: If a term is missing; the message names it.
    """
    for term in ("trajectory", "appropriate"):
        if term not in info:
            raise SettingsError(
                f'a descriptor reads `info["{term}"]`, as the environments of creative_nao tell it, '
                f"but `info` holds only: {', '.join(info) or 'nothing'}"
            )
    return np.asarray(info["trajectory"], np.float64)
