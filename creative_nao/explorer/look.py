"""How the maps of a tab look: which window, in which colours; what is not known yet is worked out beside."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from nicegui import run

from creative_nao.explorer.colours import NEAREST, is_number, is_of_body, spans
from creative_nao.explorer.finer import LEVELS, Sheet, finer_sheet
from creative_nao.explorer.map_pane import MapPane
from creative_nao.explorer.measuring import measured
from creative_nao.explorer.view import View
from creative_nao.explorer.work import Work


class Look:
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
        self._works: list[Work] = []
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

    def call_off(self) -> None:
        """End all work, for instance since the tab has gone."""
        for work in self._works:
            work.call_off()
        self._works = []

    def set(self, view: View | None, colour: str) -> None:
        """Choose another window or other colours; `work` shows them."""
        self.call_off()
        self.view, self.colour = view, colour
        for pane in self._panes:
            pane.view = view

    async def work(self) -> None:
        """Show what was chosen: at once from what is known, then finer."""
        self.call_off()
        works = self._works = [Work() for _ in self._panes]
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

    async def _work_out(self, pane: MapPane, work: Work) -> None:
        colour, view, subject = self.colour, self.view, pane.subject
        chart = subject.charting.chart
        if is_number(colour) and not is_of_body(colour) and subject.measurements.known(chart, colour) is None:
            await run.io_bound(subject.measurements.values, chart, colour, work)
            await self._show_if(work)
        if view is None or is_of_body(colour):
            work.share = 1.0
            return
        memory = subject.mind.memory
        for n in LEVELS:
            sheet = pane.fine_sheet()
            if work.called_off:
                return
            if sheet is not None and sheet.view == view and sheet.chart.resolution >= n:
                if is_number(colour) and colour not in sheet.values:
                    values = await run.io_bound(measured, memory, sheet.chart, colour, chart, work)
                    if values is not None:
                        pane.sheet = Sheet(view, sheet.chart, {**sheet.values, colour: values})
                        await self._show_if(work)
                continue
            if n * 2 <= chart.resolution * view.width:
                continue  # the map's own cells are finer here
            work.share = 0.0
            found = await run.io_bound(finer_sheet, memory, chart, view, n, colour, work)
            if found is not None and not work.called_off:
                pane.sheet = found
                await self._show_if(work)

    async def _show_if(self, work: Work) -> None:
        if not work.called_off:
            await self.paint()
