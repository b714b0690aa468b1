"""The eight joints over time as small multiples in one SVG: generated, nearest basic action, limits, overspeed."""

from __future__ import annotations

import numpy as np

from creative_nao.explorer.mind import Mind, Recall
from creative_nao.joints import JOINTS, LIMITS_RAD

PANEL_W, PANEL_H = 150, 78
LEFT, TOP = 20, 16
WIDTH, HEIGHT = LEFT + PANEL_W + 4, TOP + PANEL_H + 4
ORDER = (4, 5, 6, 7, 0, 1, 2, 3)
"""Left arm above the right, as columns of a trajectory."""
LOW_RAD, HIGH_RAD = -2.2, 2.2


def curves_svg(recall: Recall, mind: Mind) -> str:
    """Return the curves as one SVG a joint; colours follow the page, and a cursor the CSS variable ``--robot-t``."""
    basic = mind.memory.demonstrations.trajectories[recall.nearest]
    n_ticks = max(len(recall.trajectory), len(basic), 2)
    share = (len(recall.trajectory) - 1) / (n_ticks - 1)
    panels = []
    for joint in ORDER:
        parts = [frame(joint), polyline(basic[:, joint], n_ticks, "cn-basic")]
        parts.append(polyline(recall.trajectory[:, joint], n_ticks, "cn-made"))
        fast = recall.speeds[:, joint] > mind.limit_rad_s[joint] * (1 + 1e-12)
        parts += [_overspeed(recall.trajectory[t : t + 2, joint], int(t), n_ticks) for t in np.flatnonzero(fast)]
        shift = f"translateX(calc(var(--robot-t, 0) * {PANEL_W * share:.1f}px))"
        parts.append(f'<line class="cn-cursor" y2="{PANEL_H}" style="transform:{shift}"/>')
        too_fast = ", too fast" if fast.any() else ""
        panels.append(
            f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" xmlns="http://www.w3.org/2000/svg" role="img" '
            f'aria-label="{JOINTS[joint]} over time{too_fast}"><g transform="translate({LEFT} {TOP})">'
            f"{''.join(parts)}</g></svg>"
        )
    seconds = (n_ticks - 1) * mind.memory.dt_s
    legend = (
        f"Angles in rad over {seconds:.2f} s. Solid: this movement; dashed: nearest basic action; dotted: limits; "
        f"red: faster than {mind.limit_rad_s.max():.1f} rad/s."
    )
    return f'<div class="cn-curves">{"".join(panels)}</div><div class="cn-legend">{legend}</div>'


def frame(joint: int) -> str:
    """Return name, box, limits and ticks of a joint's panel."""
    name = JOINTS[joint]
    lines = [
        f'<text class="cn-name" x="0" y="-4">{name}</text>',
        f'<rect class="cn-panel" width="{PANEL_W}" height="{PANEL_H}"/>',
        *(
            f'<line class="cn-limit" x2="{PANEL_W}" y1="{height_of(v):.1f}" y2="{height_of(v):.1f}"/>'
            for v in LIMITS_RAD[name]
        ),
        *(f'<text class="cn-tick" x="-4" y="{height_of(v) + 3:.1f}" text-anchor="end">{v}</text>' for v in (-2, 0, 2)),
    ]
    return "".join(lines)


def height_of(angle: float) -> float:
    """Return where an angle [rad] lies in a panel, from its top."""
    return PANEL_H * (HIGH_RAD - angle) / (HIGH_RAD - LOW_RAD)


def _points(angles: np.ndarray, first: int, n_ticks: int) -> str:
    return " ".join(f"{PANEL_W * (first + k) / (n_ticks - 1):.1f},{height_of(a):.1f}" for k, a in enumerate(angles))


def polyline(angles: np.ndarray, n_ticks: int, kind: str) -> str:
    """Return the angles of one joint [rad], shape (n,), as a line of a class."""
    return f'<polyline class="{kind}" points="{_points(angles, 0, n_ticks)}"/>'


def _overspeed(angles: np.ndarray, tick: int, n_ticks: int) -> str:
    return f'<polyline class="cn-overspeed" points="{_points(angles, tick, n_ticks)}"/>'
