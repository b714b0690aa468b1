"""What the teaching page draws: a demonstration's curves with its keys, the loss, and the map that grows."""

from __future__ import annotations

import io
from base64 import b64encode

import numpy as np
from PIL import Image

from creative_nao.demonstrations.keyframes import DT_S
from creative_nao.explorer.curves import HEIGHT, LEFT, ORDER, PANEL_H, PANEL_W, TOP, WIDTH, frame, height_of, polyline
from creative_nao.explorer.notebook import Draft
from creative_nao.joints import JOINTS
from creative_nao.pb_space import PBMap
from creative_nao.pb_space.palette import action_letter
from creative_nao.pb_space.picture import map_image

LOSS_W, LOSS_H = 300, 150


def draft_svg(draft: Draft, place: int) -> str:
    """Return the eight joints of a demonstration as small multiples; the keys are dots, the one at `place` is large."""
    angles = draft.trajectory()
    seconds = (len(angles) - 1) * DT_S
    panels = []
    for joint in ORDER:
        dots = "".join(
            f'<circle class="{"cn-key-now" if k == place else "cn-key-dot"}" cx="{PANEL_W * key.time_s / seconds:.1f}" '
            f'cy="{height_of(key.posture[joint]):.1f}" r="{4 if k == place else 2}"/>'
            for k, key in enumerate(draft.keys)
        )
        shift = f"translateX(calc(var(--robot-t, 0) * {PANEL_W}px))"
        panels.append(
            f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" xmlns="http://www.w3.org/2000/svg" role="img" '
            f'aria-label="{JOINTS[joint]} over time"><g transform="translate({LEFT} {TOP})">{frame(joint)}'
            f"{polyline(angles[:, joint], len(angles), 'cn-made')}{dots}"
            f'<line class="cn-cursor" y2="{PANEL_H}" style="transform:{shift}"/></g></svg>'
        )
    legend = f"Angles in rad over {seconds:.2f} s. Dots: keys, the large one is shown; dotted: limits."
    return f'<div class="cn-curves">{"".join(panels)}</div><div class="cn-legend">{legend}</div>'


def loss_svg(curve: np.ndarray, n_epochs: int) -> str:
    """Return the loss over the epochs, shape (n, 2), on a scale of powers of ten."""
    usable = curve[np.isfinite(curve[:, 1]) & (curve[:, 1] > 0)] if len(curve) else curve
    losses = np.log10(usable[:, 1]) if len(usable) else np.zeros(0)
    low, high = (np.floor(losses.min()), np.ceil(losses.max())) if len(losses) else (0.0, 3.0)
    high = max(high, low + 1)

    def y(value: float) -> float:
        return LOSS_H * (high - value) / (high - low)

    marks = "".join(
        f'<line class="cn-limit" x2="{LOSS_W}" y1="{y(k):.1f}" y2="{y(k):.1f}"/>'
        f'<text class="cn-tick" x="-5" y="{y(k) + 4:.1f}" text-anchor="end">{10.0**k:g}</text>'
        for k in np.arange(low, high + 1)
    )
    points = " ".join(
        f"{LOSS_W * epoch / max(n_epochs, 1):.1f},{y(loss):.1f}"
        for epoch, loss in zip(usable[:, 0], losses, strict=True)
    )
    last = f", now {usable[-1, 1]:.3g}" if len(usable) else ""
    return (
        f'<svg class="cn-loss" viewBox="-42 -8 {LOSS_W + 50} {LOSS_H + 34}" xmlns="http://www.w3.org/2000/svg" '
        f'role="img" aria-label="Loss over {n_epochs} epochs{last}">'
        f'<rect class="cn-panel" width="{LOSS_W}" height="{LOSS_H}"/>{marks}'
        f'<polyline class="cn-made" points="{points}"/>'
        f'<text class="cn-tick" x="0" y="{LOSS_H + 16}">0</text>'
        f'<text class="cn-tick" x="{LOSS_W}" y="{LOSS_H + 16}" text-anchor="end">{n_epochs:,} epochs</text>'
        f'<text class="cn-name" x="6" y="14">Loss</text></svg>'
    )


def grown_map(chart: PBMap | None) -> str:
    """Return the map of what is learned so far, with the letters of the demonstrations, or an empty place for it."""
    if chart is None:
        return '<div class="cn-grown" role="img" aria-label="No map yet"></div>'
    stream = io.BytesIO()
    Image.fromarray(np.round(255 * map_image(chart)[::-1]).astype(np.uint8)).save(stream, format="PNG")
    letters = "".join(
        f'<text x="{100 * (1 + x):.1f}" y="{100 * (1 - y):.1f}" dy="0.35em">{action_letter(place)}</text>'
        for place, (x, y) in enumerate(chart.learned_pb)
    )
    usable = 100 * float(chart.appropriate.mean())
    picture = b64encode(stream.getvalue()).decode()
    return (
        f'<div class="cn-grown" role="img" aria-label="Map of {chart.resolution} by {chart.resolution} points, '
        f'{usable:.0f} % of it appropriate"><img alt="" src="data:image/png;base64,{picture}">'
        f'<svg viewBox="0 0 200 200">{letters}</svg></div>'
    )
