"""A progress display with time left: bars on a terminal, a line now and then elsewhere.

It goes to stderr, so that stdout is data.
"""

from __future__ import annotations

import threading
import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

PLAIN_EVERY_S = 10.0
"""Time between two lines where there is no terminal [s]."""


class Display:
    """Shows how far several long pieces of work are, one bar each and the whole when there is more than one.

    Args:
        totals: Units of work of each piece, by its name.
    """

    def __init__(self, totals: dict[str, int]) -> None:
        self._totals = totals
        self._done = dict.fromkeys(totals, 0)
        self._first: dict[str, int] = {}
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
        self._whole = self._bar.add_task("all", total=sum(totals.values()), note="") if len(totals) > 1 else None
        self._tasks = {
            name: self._bar.add_task(name, total=total, note="", start=False, visible=self._whole is None)
            for name, total in totals.items()
        }
        self._lock = threading.Lock()  # pieces report from threads of their own
        self._started = self._said = time.monotonic()

    def __enter__(self) -> Display:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def show(self, name: str, done: int, note: str = "") -> None:
        """Say that `done` units of the piece `name` are finished; `note` is a figure to show beside."""
        with self._lock:
            if name not in self._first:
                self._first[name] = done
                self._bar.start_task(self._tasks[name])
            self._done[name] = done
            finished = done >= self._totals[name]
            visible = self._whole is None or not finished
            self._bar.update(self._tasks[name], completed=done, note=note, visible=visible)
            if self._whole is not None:
                self._bar.update(self._whole, completed=sum(self._done.values()))
            if not self._console.is_terminal:
                self._say(name, note)

    def _say(self, name: str, note: str) -> None:
        now = time.monotonic()
        fresh = sum(self._done.values()) - sum(self._first.values())
        if now - self._said < PLAIN_EVERY_S or fresh <= 0:
            return
        rest = sum(self._totals.values()) - sum(self._done.values())
        left = (now - self._started) / fresh * rest
        text = f"{name}: {self._done[name]}/{self._totals[name]}, {note}; {left:.0f} s left in all"
        self._console.print(text, highlight=False, soft_wrap=True)
        self._said = now
