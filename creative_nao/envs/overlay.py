"""Captions on frames, for those who want them: by default a frame is clean."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

_SHADE = (16, 18, 24)
_INK = (240, 240, 240)


@functools.cache
def _font(size: int) -> Any:
    from PIL import ImageFont

    return ImageFont.load_default(size)


def caption(frame: np.ndarray, text: str) -> np.ndarray:
    """Return a copy of a frame with a line of text on a dark bar at its lower edge.

    Args:
        frame: uint8 of shape (height, width, 3).
        text: The line.
    """
    from PIL import Image, ImageDraw

    if not text:
        return frame.copy()
    height, width = frame.shape[:2]
    bar = max(14, height // 16)
    picture = Image.fromarray(frame)
    drawing = ImageDraw.Draw(picture)
    drawing.rectangle((0, height - bar, width, height), fill=_SHADE)
    drawing.text((bar // 2, height - bar // 2), text, fill=_INK, font=_font(bar * 5 // 8), anchor="lm")
    return np.asarray(picture).copy()
