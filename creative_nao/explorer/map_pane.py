"""The map of one memory in a tab: its picture, legend and marks, and what all maps of a tab share."""

from __future__ import annotations

import asyncio
import dataclasses
from collections.abc import Callable

import numpy as np
from nicegui import events, run, ui

from creative_nao.explorer import colours
from creative_nao.explorer.markup import legend_html
from creative_nao.explorer.memory_service import ALL_WORDS, OUTCOME_WORDS, spoken
from creative_nao.explorer.registry import LEVELS, Computation, FinerMap, LoadedMemory, finer_map, measured
from creative_nao.explorer.view import SIZE, View, cell_of
from creative_nao.maps import PBMap
from creative_nao.maps.picture import NEAREST

KEYS_HELP = "arrow keys move by one cell, with Shift by ten; 1 to 6 go to a basic action; plus and minus zoom, 0 shows "
KEYS_HELP += "the whole map; Space pauses; R surprises; S keeps; U goes back"

Source = tuple[PBMap, str, np.ndarray | None]
"""What a map is painted from: the cells, the colouring, and their numbers if it is one."""


def _address(
    pb_map: PBMap, colour: str, view: View, values: np.ndarray | None = None, span: tuple[float, float] | None = None
) -> str:
    return colours.png_address(colours.map_picture(pb_map, colour, view, values, span).quantize(256))


class MapPane:
    """One map in a tab; the view None is the whole map, the finer cells are of this view or an earlier one."""

    view: View | None = None
    finer: FinerMap | None = None

    def __init__(self, loaded: LoadedMemory) -> None:
        self.loaded = loaded

    def build(self) -> None:
        """Lay it out; whoever does that also listens to `image`."""
        pb_map, frame = self.loaded.pb_map, self.frame()
        self._painted: tuple[PBMap, tuple[object, ...]] = (pb_map, (NEAREST, frame, None))
        self.image = ui.interactive_image(
            _address(pb_map, NEAREST, frame), events=["pointerdown", "pointermove", "pointerup"]
        )
        label = f"Map of the PB space of memory {self.loaded.name}: {KEYS_HELP}".replace('"', "'")
        self.image.classes("cn-map").mark("map").props(f'tabindex=0 role=application aria-label="{label}"')
        self.hover = ui.label("").classes("cn-hover text-sm")
        self.legend = ui.html(legend_html(pb_map, NEAREST), sanitize=False).classes("cn-legend")  # escapes the names

    def frame(self) -> View:
        """Return the square of the PB space that is shown."""
        return View.whole(self.loaded.pb_map.resolution) if self.view is None else self.view

    def pb_of(self, event: events.GenericEventArguments) -> tuple[float, float]:
        """Return the PB point under the pointer."""
        return self.frame().to_pb(*(as_pixel(event.args.get(key)) for key in ("image_x", "image_y")))

    def finest(self) -> PBMap:
        """Return the finest map that covers all that is shown."""
        covering = self.covering()
        return self.loaded.pb_map if covering is None else covering.pb_map

    def covering(self) -> FinerMap | None:
        """Return the finer cells if they cover all that is shown."""
        fits = self.view is not None and self.finer is not None and self.view.within(self.finer.view)
        return self.finer if fits else None

    def source(self, colour: str) -> Source | None:
        """Return the finest that the map can be painted from now; None if its numbers are not known yet."""
        physical, pb_map, covering = self.loaded.physical, self.loaded.pb_map, self.covering()
        if colours.is_physical(colour):
            if physical is None:
                return pb_map, NEAREST, None
            return physical, colour, colours.physical_figure(physical, colour) if colours.is_number(colour) else None
        if covering is not None and (not colours.is_number(colour) or colour in covering.values):
            return covering.pb_map, colour, covering.values.get(colour)
        known = self.loaded.known(pb_map, colour)
        return None if colours.is_number(colour) and known is None else (pb_map, colour, known)

    async def paint(self, source: Source, span: tuple[float, float] | None, asked: str) -> None:
        """Draw the map and its legend, unless they are drawn; `asked` is the colouring that was asked for."""
        frame = self.frame()
        pb_map, colour, values = source
        settings = (asked, frame, span)
        if pb_map is self._painted[0] and settings == self._painted[1]:
            return
        picture = await run.io_bound(_address, pb_map, colour, frame, values, span)
        if picture is None or self.image.is_deleted or frame != self.frame():
            return
        self._painted = pb_map, settings
        self.image.set_source(picture)
        whole = pb_map if colours.is_physical(colour) else self.loaded.pb_map
        self.legend.content = legend_html(whole, colour, None if values is None else span, lacking=colour != asked)

    def describe(self, pb: tuple[float, float], colour: str) -> None:
        """Show in words what lies at a PB point."""
        pb_map, digits = self.finest(), self.frame().digits
        cell = cell_of(pb_map, pb)
        text = (
            f"{pb[0]:.{digits}f}, {pb[1]:.{digits}f}: {OUTCOME_WORDS[str(pb_map.outcome[cell])]}, "
            f"nearest {spoken(pb_map.names[pb_map.nearest[cell]])}, novelty {pb_map.distance[cell]:.1f}"
        )
        if (source := self.source(colour)) is not None:
            shown, colour, values = source
            if colours.is_physical(colour):
                text += f"; on the robot: {ALL_WORDS[str(shown.outcome[cell_of(shown, pb)])]}"
            if values is not None and colour != "novelty":
                text += f"; {colours.scale_label(colour)}: {values[cell_of(shown, pb)]:.3g}"
        self.hover.text = text


def as_pixel(value: object) -> float:
    """Return a pixel from anything a browser sends; what is no number counts as the middle of the map."""
    fits = isinstance(value, int | float) and value == value
    return float(min(max(value, 0), SIZE)) if fits else SIZE / 2  # type: ignore[type-var]


class MapState:
    """What all maps of a tab have in common; it calls `changed` when what the page says about them has changed."""

    def __init__(self, panes: list[MapPane], changed: Callable[[], None]) -> None:
        self._panes, self._changed = panes, changed
        self.view: View | None = None
        self.colour = NEAREST
        self._works: list[Computation] = []
        self._asked = self._painted = 0
        self._painting = asyncio.Lock()

    @property
    def share(self) -> float | None:
        """How much of the work is done, or None if there is none."""
        return min((work.share for work in self._works), default=None)

    @property
    def fineness(self) -> int | None:
        """Finer cells along each side of the window, or None while there are none."""
        covering = [pane.covering() for pane in self._panes]
        return None if None in covering else min(finer.pb_map.resolution for finer in covering if finer)

    def cancel(self) -> None:
        """End all work, for instance since the tab has gone."""
        for work in self._works:
            work.cancelled = True
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
        await asyncio.gather(*(self._refine(*pair) for pair in zip(self._panes, works, strict=True)))
        if self._works is works:
            self._works = []
            self._changed()

    async def paint(self) -> None:
        """Draw every map from the finest that is known; of calls that wait only the last draws."""
        self._asked += 1
        async with self._painting:
            if self._painted == self._asked:
                return
            self._painted = self._asked
            sources = [pane.source(self.colour) for pane in self._panes]
            numbers = [(source[0], source[2]) for source in sources if source is not None and source[2] is not None]
            span = colours.shared_span(numbers) if numbers else None
            for pane, source in zip(self._panes, sources, strict=True):
                if source is not None:
                    await pane.paint(source, span, self.colour)
        self._changed()

    async def _refine(self, pane: MapPane, work: Computation) -> None:
        colour, view, loaded = self.colour, self.view, pane.loaded
        pb_map = loaded.pb_map
        if colours.is_number(colour) and not colours.is_physical(colour) and loaded.known(pb_map, colour) is None:
            await run.io_bound(loaded.numbers, pb_map, colour, work)
            await self._paint_unless(work)
        if view is None or colours.is_physical(colour):
            work.share = 1.0
            return
        memory = loaded.service.memory
        for n in LEVELS:
            if work.cancelled:
                return
            finer, known = None, pane.covering()
            if known is not None and known.view == view and known.pb_map.resolution >= n:
                if colours.is_number(colour) and colour not in known.values:
                    values = await run.io_bound(measured, memory, known.pb_map, colour, pb_map, work)
                    if values is not None:
                        finer = dataclasses.replace(known, values={**known.values, colour: values})
            elif n * 2 > pb_map.resolution * view.width:  # else the map's own cells are finer here
                work.share = 0.0
                finer = await run.io_bound(finer_map, memory, pb_map, view, n, colour, work)
            if finer is not None and not work.cancelled:
                pane.finer = finer
                await self._paint_unless(work)

    async def _paint_unless(self, work: Computation) -> None:
        if not work.cancelled:
            await self.paint()
