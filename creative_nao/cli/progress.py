"""A progress display with time left: a bar on a terminal, a line now and then elsewhere.

It goes to stderr, so that stdout is data.
"""

from __future__ import annotations

import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

PLAIN_EVERY_S = 10.0
"""Time between two lines where there is no terminal [s]."""


class Display:
    """Shows how far one long piece of work is.

    Args:
        what: What is done, for example ``training half, seed 0``.
        total: Number of units of work.
    """

    def __init__(self, what: str, total: int) -> None:
        self._what, self._total = what, total
        self._console = Console(stderr=True)
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[note]}"),
            console=self._console,
            disable=not self._console.is_terminal,
        )
        self._task = self._bar.add_task(what, total=total, note="")
        self._started = self._said = time.monotonic()
        self._first: int | None = None

    def __enter__(self) -> Display:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def show(self, done: int, note: str = "") -> None:
        """Say that `done` units are finished; `note` is a figure to show beside."""
        if self._first is None:
            self._first = done
        self._bar.update(self._task, completed=done, note=note)
        now = time.monotonic()
        if not self._console.is_terminal and now - self._said >= PLAIN_EVERY_S and done > self._first:
            left = (now - self._started) / (done - self._first) * (self._total - done)
            self._console.print(f"{self._what}: {done}/{self._total}, {left:.0f} s left, {note}", highlight=False)
            self._said = now
