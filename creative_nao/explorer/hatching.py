"""Patterns of what cannot be used, so that no outcome is told by colour alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from creative_nao.pb_space.palette import UNUSABLE, rgb

PERIOD_PX = 8
STRENGTH = 0.35
"""How far the lines of a pattern are drawn towards white."""
_MIDDLE = PERIOD_PX // 2


def _dots(up: np.ndarray, across: np.ndarray, radius_squared: float) -> np.ndarray:
    return (up % PERIOD_PX - _MIDDLE) ** 2 + (across % PERIOD_PX - _MIDDLE) ** 2 <= radius_squared


PATTERNS: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "fluctuating": lambda up, across: (up + across) % PERIOD_PX == 0,
    "non_moving": lambda up, across: (up - across) % PERIOD_PX == 0,
    "joint_limit": lambda up, across: across % PERIOD_PX == 0,
    "tracking_error": lambda up, across: up % PERIOD_PX == 0,
    "fell": lambda up, across: ((up + across) % PERIOD_PX == 0) | ((up - across) % PERIOD_PX == 0),
    "self_collision": lambda up, across: _dots(up, across, 5.0),
    "torque_saturated": lambda up, across: _dots(up, across, 1.0),
}
"""By outcome: whether a pixel belongs to the pattern, from its row and its column."""


def hatch(pixels: np.ndarray, where: np.ndarray, outcome: str) -> None:
    """Draw the pattern of an outcome into a picture, (height, width, 3) in [0, 1], where `where` is true."""
    rows, columns = np.mgrid[: pixels.shape[0], : pixels.shape[1]]
    lines = where & PATTERNS[outcome](rows, columns)
    pixels[lines] = (1 - STRENGTH) * pixels[lines] + STRENGTH


def sample(outcome: str, width: int, height: int) -> np.ndarray:
    """Return a small picture of an outcome's colour and pattern, (height, width, 3) in [0, 1]."""
    pixels = np.tile(np.array(rgb(UNUSABLE[outcome][0])), (height, width, 1))
    hatch(pixels, np.ones((height, width), bool), outcome)
    return pixels
