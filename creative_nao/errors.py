"""Every error that a user can cause, so that one `except CreativeNaoError` catches them all.

Each class also derives from the built-in it refines. A message names the input, what was expected, what came and,
where there is one, the next step; the command line prints it as one line.
"""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Iterable
from types import ModuleType
from typing import Any

LONGEST_MESSAGE = 990  # characters; a message quotes files, and a file may hold a name of a megabyte


class CreativeNaoError(Exception):
    """Base of all errors that a user of creative_nao can cause.

    A message is one line of at most `LONGEST_MESSAGE` characters. What it quotes may come from a stranger's file: line
    ends, terminal commands and other characters that cannot be seen are written as escapes.
    """

    def __init__(self, message: object = "") -> None:
        text = str(message)
        if len(text) > LONGEST_MESSAGE:
            text = f"{text[: LONGEST_MESSAGE // 2]} [...] {text[-(LONGEST_MESSAGE // 2 - 7) :]}"
        super().__init__(printable(text.replace("\n", " "))[:LONGEST_MESSAGE])


def printable(text: str, keep: str = "") -> str:
    r"""Return text as a terminal may show it: what cannot be seen there, but for `keep`, is written as an escape.

    Example:
        >>> printable("a name \x1b[2J")
        'a name \\x1b[2J'
    """
    if text.isprintable():
        return text
    return "".join(mark if mark.isprintable() or mark in keep else ascii(mark)[1:-1] for mark in text)


class ShapeError(CreativeNaoError, ValueError):
    """An array has the wrong shape, type or values."""


class SettingsError(CreativeNaoError, ValueError):
    """A setting is outside its range; the message names the field."""


class FileFormatError(CreativeNaoError, ValueError):
    """A file exists but does not hold what it should; the message names the file and the part."""


class NotFoundError(CreativeNaoError, LookupError):
    """A name or a file does not exist; the message offers the nearest known name."""


class MissingDependencyError(CreativeNaoError, ImportError):
    """An optional package or a system library is missing; the message says how to install it."""


def load_extra(package: str, extra: str, user: str) -> ModuleType:
    """Import an optional package; a MissingDependencyError says what needs it and which extra of ours installs it."""
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise missing_extra(package, extra, user, error) from error


def missing_extra(package: str, extra: str, user: str, why: object) -> MissingDependencyError:
    """Return the error that names a missing package, our extra that installs it and its `user`."""
    return MissingDependencyError(f'{user} needs the package `{package}`: pip install "creative-nao[{extra}]" ({why})')


class TrainingError(CreativeNaoError, ArithmeticError):
    """Training could not go on: the loss is no longer a finite number."""


class RecallWarning(UserWarning):
    """A trained memory does not give every basic action back; the message names them and says what to try."""


def nearest_name(name: str, known: Iterable[str]) -> str:
    """Return `` (did you mean `x`?)`` for the known name most like `name`, else an empty string."""
    matches = difflib.get_close_matches(str(name)[:100], [word for word in known if len(word) <= 100], n=1, cutoff=0.5)
    return f" (did you mean `{matches[0]}`?)" if matches else ""


def shown(value: Any) -> str:
    """Return the beginning of a value for a message; the whole one may be huge."""
    if isinstance(value, list | tuple | dict) and len(value) > 8:
        return f"a {type(value).__name__} of {len(value)}"
    if isinstance(value, str) and len(value) > 60:
        return f"{repr(value[:40])[:60]}... of {len(value)} characters"
    try:
        found = repr(value)
    except (RecursionError, ValueError):  # ValueError: a whole number of more digits than Python writes
        return f"a {type(value).__name__}"
    return found if len(found) <= 80 else f"{found[:60]}..."
