"""The map of one memory in a tab: its picture, its legend, and what lies under the pointer."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from nicegui import events, run, ui

from creative_nao.explorer.colours import NEAREST, Chart, Scale, figure_of_body, is_number, is_of_body, scale_label
from creative_nao.explorer.finer import Sheet
from creative_nao.explorer.legend import legend_html
from creative_nao.explorer.map_view import map_address, overlay
from creative_nao.explorer.subject import Subject
from creative_nao.explorer.view import SIZE, View, cell_of
from creative_nao.explorer.words import BODY_WORDS, OUTCOME_WORDS, spoken

if TYPE_CHECKING:
    from creative_nao.explorer.page import Tab

KEYS_HELP = "arrow keys move by one cell, with Shift by ten; 1 to 6 go to a basic action; plus and minus zoom, 0 shows "
KEYS_HELP += "the whole map; Space pauses; R surprises; S keeps; U goes back"
_KEYS = "['ArrowLeft','ArrowRight','ArrowUp','ArrowDown','0','1','2','3','4','5','6','r','s','u','+','=','-']"
_TOUCHED = "(e) => { if (!window.mapPinch && ((e.buttons & 1) || e.mouse_event_type === 'pointerup')) emit(e) }"
_HOVERED = "(e) => { if (!e.buttons) emit(e) }"
_PRESSED = f"(e) => {{ if ({_KEYS}.includes(e.key) && !e.ctrlKey && !e.metaKey) {{ e.preventDefault(); emit(e) }} }}"
LACKING = "No physical map of this memory was given (--physical): nearest actions instead."


class Material(NamedTuple):
    """What a map is painted from."""

    chart: Chart
    colour: str
    values: np.ndarray | None


class MapPane:
    """One map in a tab.

    Args:
        subject: The memory.

    Attributes:
        view: What of the PB space is shown; None is the whole map.
        sheet: Finer cells, of this view or an earlier one.
    """

    def __init__(self, subject: Subject) -> None:
        self.subject = subject
        self.view: View | None = None
        self.sheet: Sheet | None = None

    def build(self, tab: Tab) -> None:
        """Lay it out; what is done to it goes to the tab."""
        chart = self.subject.charting.chart
        picture = map_address(chart, view=self.frame())
        self._painted: tuple[Chart, str, View, tuple[float, float] | None] = (chart, NEAREST, self.frame(), None)
        self.image = ui.interactive_image(picture, events=["pointerdown", "pointermove", "pointerup"])
        label = f"Map of the PB space of memory {self.subject.name}: {KEYS_HELP}".replace('"', "'")
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
        return View.whole(self.subject.charting.chart.resolution) if self.view is None else self.view

    def pb_of(self, event: events.GenericEventArguments) -> tuple[float, float]:
        """Return the PB point under the pointer."""
        return self.frame().to_pb(*(as_pixel(event.args.get(key)) for key in ("image_x", "image_y")))

    def cell(self) -> float:
        """Return the width of a cell that is shown, in PB units."""
        sheet = self.fine_sheet()
        chart = self.subject.charting.chart if sheet is None else sheet.chart
        return float(chart.pb[1, 0] - chart.pb[0, 0])

    def fine_sheet(self) -> Sheet | None:
        """Return the finer cells if they cover all that is shown."""
        fits = self.view is not None and self.sheet is not None and self.view.within(self.sheet.view)
        return self.sheet if fits else None

    def material(self, colour: str) -> Material | None:
        """Return the finest that the map can be painted from now; None if its numbers are not known yet."""
        subject = self.subject
        if is_of_body(colour):
            if subject.physical is None:
                return Material(subject.charting.chart, NEAREST, None)
            number = figure_of_body(subject.physical, colour) if is_number(colour) else None
            return Material(subject.physical, colour, number)
        sheet = self.fine_sheet()
        if sheet is not None and (not is_number(colour) or colour in sheet.values):
            return Material(sheet.chart, colour, sheet.values.get(colour))
        chart = subject.charting.chart
        if not is_number(colour):
            return Material(chart, colour, None)
        known = subject.measurements.known(chart, colour)
        return None if known is None else Material(chart, colour, known)

    async def paint(self, material: Material, span: tuple[float, float] | None, asked: str) -> None:
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
        whole: Chart = material.chart if is_of_body(material.colour) else self.subject.charting.chart
        scale = None if span is None or material.values is None else Scale(scale_label(material.colour), *span)
        lacking = "" if material.colour == asked else f"<div>{LACKING}</div>"
        self.legend.content = lacking + legend_html(whole, material.colour, scale)

    def redraw(self, points: np.ndarray, tab: Tab) -> None:
        """Draw the marks anew."""
        crowd = tab.exhibit.crowd if self.subject is tab.exhibit.shelf.first else None
        learned = self.subject.mind.memory.pb
        self.image.content = overlay(self.frame(), learned, points, tab.marks, crowd)

    def tell(self, pb: tuple[float, float], colour: str) -> None:
        """Say what lies at a PB point."""
        sheet = self.fine_sheet()
        chart = self.subject.charting.chart if sheet is None else sheet.chart
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
