"""Bytes, text and JSON from files that anybody may have made: bounded before they are read, nothing run.

Every fault is one `FileFormatError` that names the file. Links are followed as the system follows them; what is not a
plain file in the end (a folder, a pipe, a device, a link to nothing) counts as not there. `fields.py` takes the parts
of a JSON object, `npz.py` and `tensorfile.py` arrays.
"""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

from creative_nao.errors import FileFormatError, NotFoundError

MAX_TEXT_BYTES = 64_000_000
"""Largest JSON file, a run folder's results; smaller limits are given where they are known."""
MAX_DEPTH = 64
"""Lists and objects within each other that JSON may have."""
MAX_DIGITS = 40
"""Of a whole number in JSON; the state of a random generator has 39."""


def read_bytes(path: Path, what: str, largest: int = MAX_TEXT_BYTES) -> bytes:
    """Return the content of a file of at most `largest` bytes.

    Args:
        path: The file.
        what: What it should be, for messages: ``suite``.
        largest: A larger file is refused before a byte of it is read.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If it is larger or cannot be read.
    """
    if not os.path.isfile(path):  # unlike `Path.is_file`, says no to a name that is too long
        raise NotFoundError(f"no {what} at {path}")
    try:
        with open(path, "rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            content = b"" if size > largest else stream.read(largest + 1)
    except OSError as error:
        raise FileFormatError(f"{path}: the {what} cannot be read: {error.strerror}") from error
    if max(size, len(content)) > largest:
        raise FileFormatError(f"{path}: has {max(size, len(content))} bytes, expected at most {largest} of a {what}")
    return content


def read_text(path: Path, what: str, largest: int = MAX_TEXT_BYTES) -> str:
    """Return UTF-8 text, with or without a byte order mark, of a file of at most `largest` bytes.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If it is larger, cannot be read, or is not UTF-8.
    """
    return as_text(read_bytes(path, what, largest), f"{path}", what)


def as_text(content: bytes, where: str, what: str) -> str:
    """Return bytes as UTF-8 text, without its byte order mark; `where` begins the message and names the file.

    Raises:
        FileFormatError: If it is not UTF-8.
    """
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        wide = content[:4].startswith((b"\xff\xfe", b"\xfe\xff", b"\0\0\xfe\xff"))
        hint = "perhaps UTF-16; " if wide else ""
        raise FileFormatError(
            f"{where}: byte {error.start} of the {what} is not UTF-8 text; {hint}save the file in UTF-8"
        ) from None


def as_json(text: str, where: str) -> Any:
    """Return what JSON text holds; `where` begins the message and names the file.

    Raises:
        FileFormatError: If it is torn, is nested more than `MAX_DEPTH` deep, says a name twice, or holds a number that
            is not finite or has more than `MAX_DIGITS` digits.
    """
    try:
        found = json.loads(
            text, parse_constant=_refuse, parse_float=_finite, parse_int=_whole, object_pairs_hook=_each_once
        )
        deep = _is_deep(found)
    except RecursionError:
        deep, found = True, None
    except ValueError as error:
        raise FileFormatError(f"{where}: not JSON ({error})") from error
    if deep:
        raise FileFormatError(f"{where}: not JSON (it is nested too deeply)")
    return found


def _refuse(word: str) -> float:
    raise ValueError(f"it holds {word}")


def _finite(digits: str) -> float:
    found = float(digits)
    return found if math.isfinite(found) else _refuse(digits[:20])


def _whole(digits: str) -> int:
    if len(digits) > MAX_DIGITS:
        raise ValueError(f"it holds a whole number of {len(digits)} digits")
    return int(digits)


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        seen: set[str] = set()  # counting each name would take hours in an object of millions
        again = next(name for name, _ in pairs if name in seen or seen.add(name))
        raise ValueError(f"it says `{again[:60]}` twice")
    return found


def _is_deep(value: Any) -> bool:
    level = [value]
    for _ in range(MAX_DEPTH):
        level = [one for outer in level if isinstance(outer, list | dict) for one in _parts(outer)]
        if not level:
            return False
    return True


def _parts(outer: list[Any] | dict[str, Any]) -> list[Any]:
    inner = outer if isinstance(outer, list) else outer.values()
    return [one for one in inner if isinstance(one, list | dict)]
