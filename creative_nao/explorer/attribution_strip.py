"""Which basic action a movement resembles when: a strip in the colours and letters of the map, and a sentence.

`measures.attribution` says what resembles means. Strong colour follows the action closely, faint from afar, on the
scale of the map: a movement of 50 postures that follows at `HALF_RAD` is 10 away, where half of the colour is left.
"""

from __future__ import annotations

import html

import numpy as np

from creative_nao.explorer.mind import Mind, Recall
from creative_nao.explorer.words import spoken
from creative_nao.measures import Attribution, Stretch, attribution
from creative_nao.measures.attribution import WINDOW_S
from creative_nao.pb_space.palette import action_colour, action_letter, rgb

HALF_RAD = 0.2
"""Distance per posture at which half of the colour is left [rad]."""
MAX_STOPS = 60
"""Colours along one stretch, so that a long recording does not become a long page."""
LETTER_PCT = 4.0
"""Narrowest stretch that has room for its letter, in percent of the strip."""


def attribute(recall: Recall, mind: Mind) -> Attribution:
    """Compare a movement with the basic actions; at a coarse tick the window is two ticks long."""
    memory = mind.memory
    return attribution(recall.trajectory, memory.demonstrations, max(WINDOW_S, 2 * memory.dt_s))


def sentence(found: Attribution, names: tuple[str, ...]) -> str:
    """Return what the strip shows in words, for instance ``Resembles A left jab to 2.2 s, then C left hook.``."""
    stretches = found.stretches()
    parts = [f"{action_letter(one.action)} {spoken(names[one.action])}" for one in stretches]
    ends = [f" to {(one.end - 0.5) * found.dt_s:.1f} s" for one in stretches[:-1]]
    return "Resembles " + ", then ".join(a + b for a, b in zip(parts, [*ends, ""], strict=True)) + "."


def strip_html(recall: Recall, mind: Mind) -> str:
    """Return the strip and its sentence as HTML; a cursor follows the CSS variable ``--robot-t``."""
    found = attribute(recall, mind)
    parts = "".join(_stretch(one, found, mind.names) for one in found.stretches())
    text = html.escape(sentence(found, mind.names))
    return (
        f'<div class="cn-strip" aria-hidden="true">{parts}<i class="cn-strip-cursor"></i></div>'
        f'<div class="cn-legend cn-resembles">{text}</div>'
    )


def _stretch(one: Stretch, found: Attribution, names: tuple[str, ...]) -> str:
    last = max(len(found) - 1, 1)
    begin, end = (100 * min(max(tick - 0.5, 0), last) / last for tick in (one.first, one.end))
    if one.end == len(found):
        end = 100.0
    letter = action_letter(one.action) if end - begin >= LETTER_PCT else ""
    red, green, blue = (round(255 * channel) for channel in rgb(action_colour(one.action)))
    ticks = np.unique(np.linspace(one.first, one.end - 1, MAX_STOPS).round().astype(int))
    strength = 0.15 + 0.85 * 2.0 ** (-found.distances[ticks, one.action] / HALF_RAD)
    stops = [f"rgba({red},{green},{blue},{value:.2f})" for value in strength]
    shades = ",".join(stops if len(stops) > 1 else stops * 2)
    title = html.escape(f"{spoken(names[one.action])}, {one.distance:.2f} rad away", quote=True)
    return (
        f'<b title="{title}" style="left:{begin:.2f}%;width:{end - begin:.2f}%;'
        f'background:linear-gradient(90deg,{shades})">{letter}</b>'
    )
