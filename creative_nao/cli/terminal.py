"""What commands share: progress with time left, Ctrl-C between two steps, the words that repeat a command.

Progress goes to stderr, so that stdout is data.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import signal
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

from creative_nao.errors import SettingsError, printable

PLAIN_EVERY_S = 10.0
"""Time between two lines of progress where there is no terminal [s]."""


class Terminal(Console):
    """A console for text out of strangers' files: nothing in it is markup, and what cannot be seen is escaped."""

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Return a text or the cell of a table as it is shown."""
        return super().render_str(printable(text, keep="\n"), **options)


class Display:
    """Progress of one or several long pieces of work: bars on a terminal, a line every ten seconds elsewhere.

    Several pieces have a bar each, while they are at work, and one for the whole.

    Args:
        totals: Units of work of each piece, by its name.
    """

    def __init__(self, totals: Mapping[str, int]) -> None:
        self._totals = dict(totals)
        self._done = dict.fromkeys(totals, 0)
        self._first: dict[str, int] = {}
        self.console = Terminal(stderr=True)
        name, note = (TextColumn(text, markup=False) for text in ("{task.description}", "{task.fields[note]}"))
        columns = (name, BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), note)
        self._bar = Progress(*columns, console=self.console, disable=not self.console.is_terminal)
        self._whole = self._bar.add_task("all", total=sum(totals.values()), note="") if len(totals) > 1 else None
        self._tasks = {
            name: self._bar.add_task(printable(name), total=total, note="", start=False, visible=self._whole is None)
            for name, total in totals.items()
        }
        self._lock = threading.Lock()  # pieces report from threads of their own
        self._started = self._printed = time.monotonic()

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._bar.stop()

    def show(
        self, name: str, done: int, note: str = "", *, total: int | None = None, seconds_left: float | None = None
    ) -> None:
        """Report the finished units of a piece, with a figure to show beside.

        `total` is for a piece whose units were not known before; the time left of all pieces, `seconds_left` [s], is
        estimated from what was done so far unless given.
        """
        with self._lock:
            self._totals[name] = total = self._totals[name] if total is None else total
            if name not in self._first:
                self._first[name] = done
                self._bar.start_task(self._tasks[name])
            self._done[name] = done
            left = self._seconds_left() if seconds_left is None else seconds_left
            time_left = "" if left is None else f"about {duration(left)} left"
            note = printable(note)
            texts = [text for text in (note, time_left if self._whole is None else "") if text]
            visible = self._whole is None or done < total
            self._bar.update(self._tasks[name], total=total, completed=done, note=", ".join(texts), visible=visible)
            if self._whole is not None:
                self._bar.update(self._whole, completed=sum(self._done.values()), note=time_left)
            now = time.monotonic()
            if not self.console.is_terminal and time_left and now - self._printed >= PLAIN_EVERY_S:
                self._printed = now
                line = f"{name}: {done}/{total}{f', {note}' if note else ''}; {time_left}"
                self.console.print(line, highlight=False, soft_wrap=True)

    def _seconds_left(self) -> float | None:
        fresh = sum(self._done.values()) - sum(self._first.values())
        if fresh <= 0:
            return None
        rest = sum(self._totals.values()) - sum(self._done.values())
        return (time.monotonic() - self._started) / fresh * rest


def duration(seconds: float) -> str:
    """Return a time as text.

    Example:
        >>> duration(125.2)
        '2 min 05 s'
    """
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


@contextlib.contextmanager
def stopped_by_signals() -> Iterator[threading.Event]:
    """While inside, SIGINT and SIGTERM set the event, so that work ends with a checkpoint; a second stops at once."""
    stop = threading.Event()

    def handle(*_: object) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def refuse_leftovers(checkpoints: Iterable[Path]) -> None:
    """Refuse to begin a training anew beside the checkpoint of an earlier one: a `SettingsError` names it."""
    for path in checkpoints:
        if path.exists():
            raise SettingsError(
                f"{path} is left from an earlier run; go on from it with --resume, or remove it to begin anew"
            )


def changed_flags(settings: Any, names: Iterable[str] | None = None, group: str = "") -> list[str]:
    """Return the flags of a settings dataclass that differ from their defaults, as one would type them.

    Only the fields `names` are looked at, if given; `group`, such as ``network.``, stands before each flag.
    """
    words = []
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if (names is None or field.name in names) and value != field.default:
            text = " ".join(map(str, value)) if isinstance(value, tuple) else str(value)
            words.append(f"--{group}{field.name.replace('_', '-')} {text}")
    return words


def remark(sentence: str) -> None:
    """Say something beside the result, on stderr."""
    print(f"creative-nao: {printable(sentence)}", file=sys.stderr)


def print_result(figures: Mapping[str, Any] | Sequence[Any], lines: Iterable[str], *, as_json: bool) -> None:
    """Print what a command found: as JSON, or the lines for people."""
    if as_json:
        print(json.dumps(figures))
        return
    for line in lines:
        print(printable(line))
