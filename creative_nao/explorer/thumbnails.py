"""A movement at a glance: its eight joints as tiny lines on the colour of the nearest basic action."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence

import numpy as np

from creative_nao.explorer.mind import Mind
from creative_nao.pb_space.palette import action_colour

WIDTH, HEIGHT = 96, 56


def thumbnail(mind: Mind, points: Sequence[tuple[float, float]]) -> str:
    """Return an SVG picture as a data address."""
    recall = mind.recall(np.array(points))
    angles = recall.trajectory
    low, high = angles.min(), angles.max()
    y = HEIGHT - 4 - (angles - low) / max(high - low, 1e-9) * (HEIGHT - 8)
    x = np.linspace(2, WIDTH - 2, len(angles))
    lines = "".join(
        f'<polyline points="{" ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, column, strict=True))}"/>' for column in y.T
    )
    colour = action_colour(recall.nearest)
    svg = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}">'
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/><rect width="{WIDTH}" height="3" fill="{colour}"/>'
        f'<g fill="none" stroke="#22262B" stroke-width="0.8">{lines}</g></svg>'
    )
    return f"data:image/svg+xml;base64,{b64encode(svg.encode()).decode()}"
