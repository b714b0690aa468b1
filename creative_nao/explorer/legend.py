"""The legend below the map as HTML: swatches with their patterns, or the scale of a measure with its unit."""

from __future__ import annotations

import html
import io
from base64 import b64encode
from functools import cache

import numpy as np
from PIL import Image

from creative_nao.explorer.colours import NEAREST, Chart, Scale, Swatch, is_number, swatches
from creative_nao.explorer.hatching import sample
from creative_nao.explorer.words import BODY_WORDS, OUTCOME_WORDS, spoken
from creative_nao.pb_space.palette import PAPER_WHITE, action_letter
from creative_nao.pb_space.picture import MEASURE_COLOURS

SWATCH_W, SWATCH_H = 22, 14
_STOPS = 9


def legend_html(chart: Chart, colour: str, scale: Scale | None = None) -> str:
    """Return the legend of a colouring; names that come from a memory's file are escaped.

    Args:
        chart: The map of the whole PB space, mental or physical.
        colour: A name of `colours.NAMES`.
        scale: The scale of a colouring that is a number.
    """
    letters = [f"{action_letter(place)} {spoken(name)}" for place, name in enumerate(chart.names)]
    parts = []
    if is_number(colour) and scale is not None:
        parts.append(
            f'<div class="cn-scale"><span>{scale.low:.3g}</span>'
            f'<span class="cn-ramp" style="background:linear-gradient(to right, {", ".join(_ramp())})"></span>'
            f"<span>{scale.high:.3g}</span><span>{html.escape(scale.label)}</span></div>"
        )
    faded = colour == NEAREST
    parts += [_entry(one, faded) for one in swatches(chart, colour, letters, {**OUTCOME_WORDS, **BODY_WORDS})]
    told = "strong: like the basic action, faint: new" if faded else ", ".join(letters)
    parts.append(f"<span>{html.escape(told)}</span><span>lines: where a basic action comes back</span>")
    return f'<div class="cn-swatches">{"".join(parts)}</div>'


def _entry(swatch: Swatch, faded: bool) -> str:
    look = swatch.colour or f"url({_sample_address(swatch.outcome)})"
    if faded and swatch.colour:
        look = f"linear-gradient(to right, {look}, {PAPER_WHITE})"
    return f'<span><i style="background:{look}"></i>{html.escape(swatch.text)}</span>'


@cache
def _sample_address(outcome: str) -> str:
    stream = io.BytesIO()
    pixels = np.round(255 * sample(outcome, SWATCH_W, SWATCH_H)).astype(np.uint8)
    Image.fromarray(pixels).save(stream, format="PNG")
    return f"data:image/png;base64,{b64encode(stream.getvalue()).decode()}"


@cache
def _ramp() -> tuple[str, ...]:
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return tuple(to_hex(one) for one in colormaps[MEASURE_COLOURS](np.linspace(0, 1, _STOPS)))
