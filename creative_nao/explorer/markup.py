"""The figures that the HTML and SVG templates of the page show; the markup itself is in `templates`."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao.demonstrations.keyframes import DT_S
from creative_nao.evaluation.pages import render
from creative_nao.explorer import colours
from creative_nao.explorer.keyframe_editor import Draft
from creative_nao.explorer.memory_service import ALL_WORDS, MemoryService, Recall, attribute, sentence, spoken
from creative_nao.explorer.view import View
from creative_nao.joints import JOINTS, LIMITS_RAD
from creative_nao.maps import PBMap
from creative_nao.maps.figure_style import PAPER_WHITE, UNUSABLE, action_colour, action_letter, rgb
from creative_nao.maps.picture import MEASURE_COLOURS, NEAREST, map_image

TEMPLATES = Path(__file__).with_name("templates")
PANEL_W, PANEL_H = 150, 78
LEFT, TOP = 20, 16
ORDER = (4, 5, 6, 7, 0, 1, 2, 3)  # left arm above the right, as columns of a trajectory
LOW_RAD, HIGH_RAD = -2.2, 2.2


def _height(angle_rad: float) -> float:
    return PANEL_H * (HIGH_RAD - angle_rad) / (HIGH_RAD - LOW_RAD)


TICKS = [(angle, f"{_height(angle) + 3:.1f}") for angle in (-2, 0, 2)]
LIMITS = [[f"{_height(angle):.1f}" for angle in LIMITS_RAD[joint]] for joint in JOINTS]


def curves_svg(recall: Recall, service: MemoryService) -> str:
    """Return a movement beside its nearest basic action, one SVG a joint; what is too fast is marked."""
    basic = service.memory.demonstrations.trajectories[recall.nearest]
    n_ticks = max(len(recall.trajectory), len(basic), 2)
    too_fast = recall.speeds > service.limit_rad_s * (1 + 1e-12)
    panels = []
    for joint in ORDER:
        angles, fast = recall.trajectory[:, joint], np.flatnonzero(too_fast[:, joint])
        lines = [("cn-basic", _curve(basic[:, joint], n_ticks)), ("cn-made", _curve(angles, n_ticks))]
        lines += [("cn-overspeed", _curve(angles[tick : tick + 2], n_ticks, int(tick))) for tick in fast]
        panels.append({"joint": JOINTS[joint], "limits": LIMITS[joint], "lines": lines, "fast": len(fast)})
    way, seconds = (len(recall.trajectory) - 1) / (n_ticks - 1), (n_ticks - 1) * service.memory.dt_s
    return _curves(panels, way, seconds, float(service.limit_rad_s.max()))


def draft_svg(draft: Draft, place: int) -> str:
    """Return a demonstration in the making, one SVG a joint; the keys are dots, the one at `place` is large."""
    angles = draft.trajectory()
    seconds = (len(angles) - 1) * DT_S
    panels = []
    for joint in ORDER:
        dots = [
            (f"{PANEL_W * key.time_s / seconds:.1f}", f"{_height(key.posture[joint]):.1f}", k == place)
            for k, key in enumerate(draft.keys)
        ]
        lines = [("cn-made", _curve(angles[:, joint], len(angles)))]
        panels.append({"joint": JOINTS[joint], "limits": LIMITS[joint], "lines": lines, "dots": dots})
    return _curves(panels, 1.0, seconds)


def _curves(panels: list[dict[str, Any]], way: float, seconds: float, limit_rad_s: float | None = None) -> str:
    return render(
        "curves.html.jinja", TEMPLATES, panels=[{"fast": 0, "dots": (), **panel} for panel in panels],
        way=way * PANEL_W, seconds=seconds, limit_rad_s=limit_rad_s,
        ticks=TICKS, width=PANEL_W, height=PANEL_H, left=LEFT, top=TOP,
    )  # fmt: skip


def _curve(angles: np.ndarray, n_ticks: int, first: int = 0) -> str:
    x = PANEL_W * (first + np.arange(len(angles))) / (n_ticks - 1)
    return _points(zip(x.tolist(), _height(angles).tolist(), strict=True))  # type: ignore[arg-type,attr-defined]


def _points(pairs: Iterable[Sequence[float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in pairs)


HALF_RAD = 0.2  # distance per posture at which half of the colour is left [rad]
MAX_STOPS = 60  # colours along one stretch, so that a long recording does not become a long page
LETTER_PCT = 4.0  # narrowest stretch that has room for its letter, in percent of the strip


def strip_html(recall: Recall, service: MemoryService) -> str:
    """Return which basic action a movement resembles when, as a strip of colours and a sentence."""
    resemblance = attribute(recall, service)
    last = max(len(resemblance) - 1, 1)
    parts = []
    for stretch in resemblance.stretches():
        begin, end = (100 * min(max(tick - 0.5, 0), last) / last for tick in (stretch.first, stretch.end))
        if stretch.end == len(resemblance):
            end = 100.0
        ticks = np.unique(np.linspace(stretch.first, stretch.end - 1, MAX_STOPS).round().astype(int))
        strength = 0.15 + 0.85 * 2.0 ** (-resemblance.distances[ticks, stretch.action] / HALF_RAD)
        colour = ",".join(str(round(255 * channel)) for channel in rgb(action_colour(stretch.action)))
        stops = [f"rgba({colour},{value:.2f})" for value in strength]
        parts.append(
            {
                "begin": begin, "end": end, "name": spoken(service.names[stretch.action]),
                "distance": stretch.distance, "shades": ",".join(stops if len(stops) > 1 else stops * 2),
                "letter": action_letter(stretch.action) if end - begin >= LETTER_PCT else "",
            }
        )  # fmt: skip
    return render("strip.html.jinja", TEMPLATES, parts=parts, sentence=sentence(resemblance, service.names))


def legend_html(pb_map: PBMap, colour: str, span: tuple[float, float] | None = None, lacking: bool = False) -> str:
    """Return the legend of a colouring; `lacking` tells that a physical one was asked for without such a map."""
    actions = [f"{action_letter(place)} {spoken(name)}" for place, name in enumerate(pb_map.names)]
    shares = {name: pb_map.share_pct(name) for name in ALL_WORDS}
    texts = {name: f"{words} {shares[name]:.1f} %" for name, words in ALL_WORDS.items()}
    entries = []
    if colour == NEAREST:
        fades = (f"linear-gradient(to right, {action_colour(k)}, {PAPER_WHITE})" for k in range(len(actions)))
        entries = list(zip(fades, actions, strict=True))
    elif not colours.is_number(colour):
        entries = [(plain, texts[name]) for name, plain in colours.USABLE.items()]
    entries += [(_swatch(name), texts[name]) for name in UNUSABLE if shares[name] > 0]
    scale = None
    if colours.is_number(colour) and span is not None:
        low, high = (f"{value:.3g}" for value in span)
        scale = {"low": low, "high": high, "label": colours.scale_label(colour), "colours": _ramp()}
    return render(
        "legend.html.jinja", TEMPLATES, entries=entries, scale=scale, lacking=lacking,
        actions="" if colour == NEAREST else ", ".join(actions),
    )  # fmt: skip


@functools.cache
def _swatch(outcome: str) -> str:
    return f"url({colours.png_address(colours.as_picture(colours.sample(outcome, 22, 14)))})"


@functools.cache
def _ramp() -> str:
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return ", ".join(map(to_hex, colormaps[MEASURE_COLOURS](np.linspace(0, 1, 9))))


def marks_svg(
    view: View,
    learned_pb: np.ndarray,
    points: np.ndarray,
    marks: Mapping[str, Sequence[float]] | None = None,
    agent_points: np.ndarray | None = None,
) -> str:
    """Return the marks over a map as the inside of an SVG; those outside the view are left out.

    All points have the shape (n, 2), more than one of a movement are a path; `marks` are more letters and their points.
    """
    letters = [(action_letter(place), pb) for place, pb in enumerate(learned_pb)] + list((marks or {}).items())

    def pixel(pb: Sequence[float]) -> list[str]:
        return [f"{value:.1f}" for value in view.to_pixel(pb)]

    return render(
        "marks.html.jinja", TEMPLATES,
        choices=[pixel(pb) for pb in (() if agent_points is None else agent_points) if view.shows(pb)],
        letters=[(letter, pixel(pb)) for letter, pb in letters if view.shows(pb)],
        path=_points(map(view.to_pixel, points)) if len(points) > 1 else "",
        here=pixel(points[-1]) if len(points) and view.shows(points[-1]) else None,
    )  # fmt: skip


THUMBNAIL_W, THUMBNAIL_H = 96, 56


def thumbnail(recall: Recall) -> str:
    """Return a small picture of a movement's curves as a data address."""
    low, high = recall.trajectory.min(), recall.trajectory.max()
    y = THUMBNAIL_H - 4 - (recall.trajectory - low) / max(high - low, 1e-9) * (THUMBNAIL_H - 8)
    x = np.linspace(2, THUMBNAIL_W - 2, len(y))
    lines = [_points(zip(x, column, strict=True)) for column in y.T]
    svg = render(
        "thumbnail.html.jinja", TEMPLATES, width=THUMBNAIL_W, height=THUMBNAIL_H, lines=lines,
        colour=action_colour(recall.nearest),
    )  # fmt: skip
    return colours.data_address("image/svg+xml", svg.encode())


LOSS_W, LOSS_H = 300, 150


def loss_svg(curve: np.ndarray, n_epochs: int) -> str:
    """Return the loss over the epochs, shape (n, 2), on a scale of powers of ten."""
    usable = curve[np.isfinite(curve[:, 1]) & (curve[:, 1] > 0)]
    powers = np.log10(usable[:, 1]) if len(usable) else np.array([0.0, 3.0])
    low = np.floor(powers.min())
    high = max(np.ceil(powers.max()), low + 1)
    y = LOSS_H * (high - powers) / (high - low)
    ticks = [(LOSS_H * (high - k) / (high - low), f"{10.0**k:g}") for k in np.arange(low, high + 1)]
    return render(
        "loss.html.jinja", TEMPLATES, width=LOSS_W, height=LOSS_H, n_epochs=n_epochs, ticks=ticks,
        points=_points(zip(LOSS_W * usable[:, 0] / max(n_epochs, 1), y, strict=False)),
        last=float(usable[-1, 1]) if len(usable) else None,
    )  # fmt: skip


def grown_map(pb_map: PBMap | None) -> str:
    """Return the map of what is learned so far, with the letters of the demonstrations, or an empty place for it."""
    if pb_map is None:
        return render("grown_map.html.jinja", TEMPLATES, picture="")
    letters = [(action_letter(k), 100 * (1 + x), 100 * (1 - y)) for k, (x, y) in enumerate(pb_map.learned_pb)]
    picture = colours.png_address(colours.as_picture(map_image(pb_map)[::-1]))
    return render(
        "grown_map.html.jinja", TEMPLATES, picture=picture, letters=letters,
        resolution=pb_map.resolution, usable_pct=100 * float(pb_map.appropriate.mean()),
    )  # fmt: skip
