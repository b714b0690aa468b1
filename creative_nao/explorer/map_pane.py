"""The map of one memory in a tab: its picture, legend and marks, and what all maps of a tab share."""

from __future__ import annotations

import asyncio
import io
from base64 import b64encode
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from nicegui import events, run, ui
from PIL import Image

from creative_nao.explorer.colours import (
    LEVELS,
    NEAREST,
    PATTERNS,
    Chart,
    Computation,
    FinerMap,
    Scale,
    cell_colours,
    figure_of_body,
    finer_map,
    hatch,
    is_number,
    is_of_body,
    legend_html,
    measured,
    scale_label,
    spans,
)
from creative_nao.explorer.memory_service import BODY_WORDS, OUTCOME_WORDS, spoken
from creative_nao.explorer.registry import LoadedMemory
from creative_nao.explorer.view import SIZE, View, cell_of
from creative_nao.maps.figure_style import INK, action_letter, rgb


class Mark(NamedTuple):
    """A letter on the map: where in the PB space, and what it says."""

    pb: tuple[float, float]
    letter: str


def map_picture(
    chart: Chart,
    colour: str = NEAREST,
    view: View | None = None,
    values: np.ndarray | None = None,
    span: tuple[float, float] | None = None,
) -> Image.Image:
    """Draw what a view shows of a map, `SIZE` pixels along each side, PB 2 upwards.

    Regions of learned movements have dark borders and what cannot be used is hatched, so that nothing is told by
    colour alone.

    Args:
        chart: The map; cells beyond its edge repeat the last.
        colour: What its colours tell, a name of `colours.NAMES`.
        view: Which square of the PB space; default: all that the map covers.
        values: The number of each cell, where the colouring is one.
        span: Values at the ends of its scale.

    Raises:
        NotFoundError: If there is no such colouring.
    """
    n = chart.resolution
    rows, columns = (View.of(chart) if view is None else view).cells(chart)
    seen = np.ix_(rows, columns)
    pixels = cell_colours(chart, colour, values, span)[seen]
    outcome = chart.outcome.reshape(n, n)[seen]
    for name in PATTERNS:
        where = outcome == name
        if where.any():
            hatch(pixels, where, name)
    pixels[borders(chart, rows, columns)] = rgb(INK)
    return Image.fromarray(np.round(255 * pixels).astype(np.uint8))


def borders(chart: Chart, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Tell which pixels border a region of learned movements, by the rows and the columns of cells under them."""
    n = chart.resolution
    region = np.where(chart.outcome == "learned", chart.nearest, -1).reshape(n, n)[np.ix_(rows, columns)]
    found = np.zeros(region.shape, bool)
    found[1:] |= region[1:] != region[:-1]
    found[:, 1:] |= region[:, 1:] != region[:, :-1]
    return found


def map_address(
    chart: Chart,
    colour: str = NEAREST,
    view: View | None = None,
    values: np.ndarray | None = None,
    span: tuple[float, float] | None = None,
) -> str:
    """Return the picture of `map_picture` as a data address, so that showing it needs no room on a disk."""
    stream = io.BytesIO()
    map_picture(chart, colour, view, values, span).quantize(256).save(stream, format="PNG")
    return f"data:image/png;base64,{b64encode(stream.getvalue()).decode()}"


def overlay(
    view: View,
    learned_pb: np.ndarray,
    points: np.ndarray,
    marks: Sequence[Mark] = (),
    agent_points: np.ndarray | None = None,
) -> str:
    """Return the marks as SVG: letters of the basic actions, others' points, and where we are.

    Args:
        view: What the map below shows; marks outside are left out.
        learned_pb: Where the basic actions lie, shape (n_actions, 2).
        points: Where the movement shown comes from, shape (n, 2); more than one are a path.
        marks: More letters, for instance of favourites.
        agent_points: Points of others, such as an agent's choices, shape (n, 2).
    """
    parts = []
    for pb in () if agent_points is None else agent_points:
        if view.shows(pb):
            x, y = view.to_pixel(pb)
            parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="white" stroke="black" stroke-width="1.5"/>')
    letters = [Mark((float(p[0]), float(p[1])), action_letter(place)) for place, p in enumerate(learned_pb)]
    for mark in (*letters, *marks):
        if view.shows(mark.pb):
            x, y = view.to_pixel(mark.pb)
            parts.append(
                f'<text x="{x:.1f}" y="{y:.1f}" dy="0.35em" text-anchor="middle" font-size="26" font-weight="bold" '
                f'fill="white" stroke="black" stroke-width="5" paint-order="stroke">{mark.letter}</text>'
            )
    places = [view.to_pixel(pb) for pb in points]
    if len(places) > 1:
        line = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
        for colour, width in (("white", 6), ("black", 2.5)):
            parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="{width}"/>')
    if len(points) and view.shows(points[-1]):
        x, y = places[-1]
        for colour, width in (("white", 6), ("black", 2.5)):
            parts.append(
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="11" fill="none" stroke="{colour}" stroke-width="{width}"/>'
            )
    return "".join(parts)


KEYS_HELP = "arrow keys move by one cell, with Shift by ten; 1 to 6 go to a basic action; plus and minus zoom, 0 shows "
KEYS_HELP += "the whole map; Space pauses; R surprises; S keeps; U goes back"
_KEYS = "['ArrowLeft','ArrowRight','ArrowUp','ArrowDown','0','1','2','3','4','5','6','r','s','u','+','=','-']"
_TOUCHED = "(e) => { if (!window.mapPinch && ((e.buttons & 1) || e.mouse_event_type === 'pointerup')) emit(e) }"
_HOVERED = "(e) => { if (!e.buttons) emit(e) }"
_PRESSED = f"(e) => {{ if ({_KEYS}.includes(e.key) && !e.ctrlKey && !e.metaKey) {{ e.preventDefault(); emit(e) }} }}"
LACKING = "No physical map of this memory was given (--physical): nearest actions instead."


class MapLayer(NamedTuple):
    """What a map is painted from."""

    chart: Chart
    colour: str
    values: np.ndarray | None


class MapEvents(Protocol):
    """What a tab does when a person touches one of its maps."""

    async def touched(self, pane: MapPane, event: events.GenericEventArguments) -> None:
        """Handle the pointer pressed, dragged or lifted."""

    def hovered(self, pane: MapPane, event: events.GenericEventArguments) -> None:
        """Handle the pointer moved without a button."""

    async def zoomed(self, pane: MapPane, event: events.GenericEventArguments) -> None:
        """Handle wheel or fingers."""

    async def pressed(self, event: events.GenericEventArguments) -> None:
        """Handle a key."""


class MapPane:
    """One map in a tab.

    Args:
        loaded: The memory.

    Attributes:
        view: What of the PB space is shown; None is the whole map.
        sheet: Finer cells, of this view or an earlier one.
    """

    def __init__(self, loaded: LoadedMemory) -> None:
        self.loaded = loaded
        self.view: View | None = None
        self.sheet: FinerMap | None = None

    def build(self, tab: MapEvents) -> None:
        """Lay it out; what is done to it goes to the tab."""
        chart = self.loaded.progressive_map.chart
        picture = map_address(chart, view=self.frame())
        self._painted: tuple[Chart, str, View, tuple[float, float] | None] = (chart, NEAREST, self.frame(), None)
        self.image = ui.interactive_image(picture, events=["pointerdown", "pointermove", "pointerup"])
        label = f"Map of the PB space of memory {self.loaded.name}: {KEYS_HELP}".replace('"', "'")
        self.image.classes("cn-map").mark("map").props(f'tabindex=0 role=application aria-label="{label}"')
        self.image.on("mouse", lambda e: tab.touched(self, e), throttle=0.06, js_handler=_TOUCHED)
        self.image.on("mouse", lambda e: tab.hovered(self, e), throttle=0.15, js_handler=_HOVERED)
        self.image.on("keydown", tab.pressed, args=["key", "shiftKey"], throttle=0.03, js_handler=_PRESSED)
        self.image.on("mapzoom", lambda e: tab.zoomed(self, e), js_handler="(e) => emit(e.detail)")
        self.hover = ui.label("").classes("cn-hover text-sm")
        legend = legend_html(chart, NEAREST)  # escapes the names
        self.legend = ui.html(legend, sanitize=False).classes("cn-legend")

    def frame(self) -> View:
        """Return the square of the PB space that is shown."""
        return View.whole(self.loaded.progressive_map.chart.resolution) if self.view is None else self.view

    def pb_of(self, event: events.GenericEventArguments) -> tuple[float, float]:
        """Return the PB point under the pointer."""
        return self.frame().to_pb(*(as_pixel(event.args.get(key)) for key in ("image_x", "image_y")))

    def cell(self) -> float:
        """Return the width of a cell that is shown, in PB units."""
        sheet = self.fine_sheet()
        chart = self.loaded.progressive_map.chart if sheet is None else sheet.chart
        return float(chart.pb[1, 0] - chart.pb[0, 0])

    def fine_sheet(self) -> FinerMap | None:
        """Return the finer cells if they cover all that is shown."""
        fits = self.view is not None and self.sheet is not None and self.view.within(self.sheet.view)
        return self.sheet if fits else None

    def material(self, colour: str) -> MapLayer | None:
        """Return the finest that the map can be painted from now; None if its numbers are not known yet."""
        loaded = self.loaded
        if is_of_body(colour):
            if loaded.physical is None:
                return MapLayer(loaded.progressive_map.chart, NEAREST, None)
            number = figure_of_body(loaded.physical, colour) if is_number(colour) else None
            return MapLayer(loaded.physical, colour, number)
        sheet = self.fine_sheet()
        if sheet is not None and (not is_number(colour) or colour in sheet.values):
            return MapLayer(sheet.chart, colour, sheet.values.get(colour))
        chart = loaded.progressive_map.chart
        if not is_number(colour):
            return MapLayer(chart, colour, None)
        known = loaded.measurements.known(chart, colour)
        return None if known is None else MapLayer(chart, colour, known)

    async def paint(self, material: MapLayer, span: tuple[float, float] | None, asked: str) -> None:
        """Draw the map and its legend, unless they are drawn; `asked` is the colouring that was asked for."""
        frame = self.frame()
        painted = (material.chart, asked, frame, span)
        if painted[0] is self._painted[0] and painted[1:] == self._painted[1:]:
            return
        picture = await run.io_bound(map_address, material.chart, material.colour, frame, material.values, span)
        if picture is None or self.image.is_deleted or frame != self.frame():
            return
        self._painted = painted
        self.image.set_source(picture)
        whole: Chart = material.chart if is_of_body(material.colour) else self.loaded.progressive_map.chart
        scale = None if span is None or material.values is None else Scale(scale_label(material.colour), *span)
        lacking = "" if material.colour == asked else f"<div>{LACKING}</div>"
        self.legend.content = lacking + legend_html(whole, material.colour, scale)

    def redraw(self, points: np.ndarray, marks: Sequence[Mark], agent_points: np.ndarray | None) -> None:
        """Draw the marks anew; `agent_points` are drawn on the map of the first memory only."""
        self.image.content = overlay(self.frame(), self.loaded.service.memory.pb, points, marks, agent_points)

    def tell(self, pb: tuple[float, float], colour: str) -> None:
        """Say what lies at a PB point."""
        sheet = self.fine_sheet()
        chart = self.loaded.progressive_map.chart if sheet is None else sheet.chart
        cell = cell_of(chart, pb)
        digits = self.frame().digits
        text = (
            f"{pb[0]:.{digits}f}, {pb[1]:.{digits}f}: {OUTCOME_WORDS[str(chart.outcome[cell])]}, "
            f"nearest {spoken(chart.names[chart.nearest[cell]])}, novelty {chart.distance[cell]:.1f}"
        )
        material = self.material(colour)
        if material is not None and is_of_body(material.colour):
            outcome = str(material.chart.outcome[cell_of(material.chart, pb)])
            text += f"; on the robot: {({**OUTCOME_WORDS, **BODY_WORDS})[outcome]}"
        if material is not None and material.values is not None and colour != "novelty":
            text += f"; {scale_label(material.colour)}: {material.values[cell_of(material.chart, pb)]:.3g}"
        self.hover.text = text


def as_pixel(value: object) -> float:
    """Return a pixel from anything a browser sends; what is no number counts as the middle of the map."""
    fits = isinstance(value, int | float) and value == value
    return float(min(max(value, 0), SIZE)) if fits else SIZE / 2  # type: ignore[type-var]


class MapState:
    """What all maps of a tab have in common.

    Args:
        panes: The maps.
        told: Called whenever something that the page says about the maps has changed.

    Attributes:
        view: Window of the PB space; None is the whole map.
        colour: What the colours tell.
    """

    def __init__(self, panes: list[MapPane], told: Callable[[], None]) -> None:
        self._panes, self._told = panes, told
        self.view: View | None = None
        self.colour = NEAREST
        self._works: list[Computation] = []
        self._wanted = 0
        self._painted = 0
        self._brush = asyncio.Lock()

    @property
    def share(self) -> float | None:
        """How much of the work is done, or None if there is none."""
        return min(work.share for work in self._works) if self._works else None

    @property
    def fineness(self) -> int | None:
        """Finer cells along each side of the window, or None while there are none."""
        sheets = [pane.fine_sheet() for pane in self._panes]
        return None if None in sheets else min(sheet.chart.resolution for sheet in sheets if sheet)

    def cancel(self) -> None:
        """End all work, for instance since the tab has gone."""
        for work in self._works:
            work.cancel()
        self._works = []

    def set(self, view: View | None, colour: str) -> None:
        """Choose another window or other colours; `work` shows them."""
        self.cancel()
        self.view, self.colour = view, colour
        for pane in self._panes:
            pane.view = view

    async def work(self) -> None:
        """Show what was chosen: at once from what is known, then finer."""
        self.cancel()
        works = self._works = [Computation() for _ in self._panes]
        await self.paint()
        await asyncio.gather(*(self._work_out(*one) for one in zip(self._panes, works, strict=True)))
        if self._works is works:
            self._works = []
            self._told()

    async def paint(self) -> None:
        """Draw every map from the finest that is known; a later call spares an earlier one that waits its work."""
        self._wanted += 1
        async with self._brush:
            if self._painted == self._wanted:
                return
            self._painted = self._wanted
            materials = [pane.material(self.colour) for pane in self._panes]
            known = [one for one in materials if one is not None and one.values is not None]
            span = (
                spans([one.chart for one in known], [one.values for one in known if one.values is not None])
                if known
                else None
            )
            for pane, material in zip(self._panes, materials, strict=True):
                if material is not None:
                    await pane.paint(material, span, self.colour)
        self._told()

    async def _work_out(self, pane: MapPane, work: Computation) -> None:
        colour, view, loaded = self.colour, self.view, pane.loaded
        chart = loaded.progressive_map.chart
        if is_number(colour) and not is_of_body(colour) and loaded.measurements.known(chart, colour) is None:
            await run.io_bound(loaded.measurements.values, chart, colour, work)
            await self._show_if(work)
        if view is None or is_of_body(colour):
            work.share = 1.0
            return
        memory = loaded.service.memory
        for n in LEVELS:
            sheet = pane.fine_sheet()
            if work.cancelled:
                return
            if sheet is not None and sheet.view == view and sheet.chart.resolution >= n:
                if is_number(colour) and colour not in sheet.values:
                    values = await run.io_bound(measured, memory, sheet.chart, colour, chart, work)
                    if values is not None:
                        pane.sheet = FinerMap(view, sheet.chart, {**sheet.values, colour: values})
                        await self._show_if(work)
                continue
            if n * 2 <= chart.resolution * view.width:
                continue  # the map's own cells are finer here
            work.share = 0.0
            found = await run.io_bound(finer_map, memory, chart, view, n, colour, work)
            if found is not None and not work.cancelled:
                pane.sheet = found
                await self._show_if(work)

    async def _show_if(self, work: Computation) -> None:
        if not work.cancelled:
            await self.paint()
