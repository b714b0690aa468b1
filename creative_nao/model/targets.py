"""The codes that a network is taught to predict."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

TARGET_FLOOR = 1e-12
"""Smallest target probability, so that its logarithm is finite."""


def target_codes(
    trajectories: list[np.ndarray], encode: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Encode actions of any lengths into one array.

    Args:
        trajectories: Joint angles [rad], each (n_steps, n_joints).
        encode: `SoftmaxEncoding.encode`.

    Returns:
        Codes, shape (n_actions, longest, n_codes) float32, the rows past an action's end filled with its last posture;
        and the lengths, shape (n_actions,).
    """
    lengths = np.array([len(t) for t in trajectories])
    codes = []
    for trajectory in trajectories:
        padding = [(0, int(lengths.max()) - len(trajectory)), (0, 0)]
        codes.append(encode(np.pad(trajectory, padding, mode="edge")))
    return np.maximum(np.array(codes), TARGET_FLOOR).astype(np.float32), lengths
