"""Text and JSON from files that anybody may have made: bounded in size and depth, one clear error for every fault."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from creative_nao import untrusted
from creative_nao.errors import FileFormatError
from creative_nao.fields import Fields

MAX_FILE_BYTES = 20_000_000
"""Larger files are refused before they are read."""


def read_bytes(path: Path, largest: int = MAX_FILE_BYTES) -> bytes:
    """Return the content of a file of at most `largest` bytes.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If it is larger, or empty.
    """
    content = untrusted.read_bytes(path, "movement", largest)
    if not content.strip():
        raise FileFormatError(f"{path}: is empty, expected a movement.")
    return content


def as_text(path: Path, content: bytes) -> str:
    """Return UTF-8 text.

    Raises:
        FileFormatError: If it is not.
    """
    return untrusted.as_text(content, str(path), "movement")


def as_json(path: Path, text: str) -> dict[str, Any]:
    """Return the object that JSON text holds.

    Raises:
        FileFormatError: If it is torn, nested too deeply, holds NaN, or is not an object.
    """
    return Fields(untrusted.as_json(text, str(path)), str(path)).values


def number(value: object, path: Path, where: str) -> float:
    """Return a value as a finite number; `where` tells the message what it is.

    Raises:
        FileFormatError: If it is text, a truth value, not finite, or anything else.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise FileFormatError(f"{path}: {where} is {_shown(value)}, expected a number.")
    try:
        found = float(value)
    except OverflowError:
        found = math.inf
    if not math.isfinite(found):
        raise FileFormatError(f"{path}: {where} is {_shown(value)}, expected a finite number.")
    return found


def listed(value: object, path: Path, where: str) -> list[Any]:
    """Return a value that should be a list (or a tuple), as a list.

    Raises:
        FileFormatError: If it is anything else.
    """
    if not isinstance(value, list | tuple):
        raise FileFormatError(f"{path}: {where} should be a list, but is {_shown(value)}.")
    return list(value)


def names(value: object, path: Path, where: str) -> tuple[str, ...]:
    """Return a list of joint names.

    Raises:
        FileFormatError: If it is not a list of texts, or is empty.
    """
    found = listed(value, path, where)
    if not found or not all(isinstance(name, str) for name in found):
        raise FileFormatError(f"{path}: {where} should be a list of joint names, but is {_shown(value)}.")
    return tuple(found)


def _shown(value: object) -> str:
    """Return the beginning of a value for a message; the whole one may be huge."""
    if isinstance(value, list | tuple | dict):
        return f"a {type(value).__name__} of {len(value)}"
    if isinstance(value, int) and abs(value) > 10**30:
        return "a huge whole number"
    return repr(value)[:60]
