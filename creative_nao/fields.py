"""The parts of a JSON object out of a file: each is taken by name, and a wrong one is named together with the file."""

from __future__ import annotations

import math
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao.arrays import npz_header, only_arrays
from creative_nao.errors import FileFormatError, shown
from creative_nao.schema import LONGEST_NAME, is_plain_name, is_writable

__all__ = [
    "LONGEST_NAME", "Fields", "is_plain_name", "is_writable", "only_arrays", "shown", "take_header", "take_record",
]  # fmt: skip


class Fields:
    """A JSON object of a file.

    Args:
        values: What stands in the file.
        where: Beginning of every message: the file and, where there are several objects, which of them.

    Raises:
        FileFormatError: If it is no object.

    Example:
        >>> Fields({"n_steps": True}, "walk.json").whole("n_steps")
        Traceback (most recent call last):
            ...
        creative_nao.errors.FileFormatError: walk.json: `n_steps` should be a whole number, but is True
    """

    def __init__(self, values: Any, where: str) -> None:
        if not isinstance(values, dict):
            raise FileFormatError(f"{where} should be a JSON object, but is {shown(values)}")
        self.values: dict[str, Any] = values
        self.where = where

    def __contains__(self, name: str) -> bool:
        return name in self.values

    def refuse(self, name: str, expected: str) -> FileFormatError:
        """Return the error that says what the field `name` should be."""
        return FileFormatError(f"{self.where}: `{name}` should be {expected}, but is {shown(self.values[name])}")

    def any(self, name: str) -> Any:
        """Return the field, whatever it is."""
        if name not in self.values:
            raise FileFormatError(f"{self.where}: `{name}` is missing")
        return self.values[name]

    def whole(self, name: str, least: float = -math.inf, most: float = math.inf) -> int:
        """Return a whole number; a truth value and 1.0 are none."""
        found = self.any(name)
        if type(found) is not int or not least <= found <= most:
            raise self.refuse(name, f"a whole number{_range(least, most)}")
        return found

    def number(self, name: str, least: float = -math.inf, most: float = math.inf) -> float:
        """Return a finite number."""
        found = self.any(name)
        if type(found) not in (int, float) or not math.isfinite(found) or not least <= found <= most:
            raise self.refuse(name, f"a number{_range(least, most)}")
        return float(found)

    def truth(self, name: str) -> bool:
        """Return true or false."""
        found = self.any(name)
        if not isinstance(found, bool):
            raise self.refuse(name, "true or false")
        return found

    def text(self, name: str, longest: int = LONGEST_NAME) -> str:
        """Return text that can be written as UTF-8."""
        found = self.any(name)
        if not isinstance(found, str) or len(found) > longest or not is_writable(found):
            raise self.refuse(name, f"text of at most {longest} characters")
        return found

    def names(self, name: str, most: int = 1_000) -> tuple[str, ...]:
        """Return a list of different names, at least one."""
        found = self.listed(name, most)
        sound = all(isinstance(one, str) and 0 < len(one) <= LONGEST_NAME and one.isprintable() for one in found)
        if not found or not sound or len(set(found)) < len(found):
            raise self.refuse(name, f"a list of different names of at most {LONGEST_NAME} characters")
        return tuple(found)

    def listed(self, name: str, most: int = 10_000_000) -> list[Any]:
        """Return a list of at most `most` entries."""
        found = self.any(name)
        if not isinstance(found, list) or len(found) > most:
            raise self.refuse(name, f"a list of at most {most} entries")
        return found

    def object(self, name: str) -> Fields:
        """Return an object."""
        return Fields(self.any(name), f"{self.where}: `{name}`")

    def objects(self, name: str, most: int = 1_000_000) -> list[Fields]:
        """Return a list of objects."""
        return [Fields(one, f"{self.where}: `{name}`, entry {k}") for k, one in enumerate(self.listed(name, most), 1)]

    def only(self, names: Collection[str]) -> None:
        """Refuse fields of other names."""
        if surplus := sorted(set(self.values) - set(names)):
            raise FileFormatError(f"{self.where}: `{surplus[0][:60]}` is no field here; there are {', '.join(names)}")

    def version(self, name: str, expected: int) -> None:
        """Refuse a file of another version of the format."""
        if type(self.any(name)) is not int or self.values[name] != expected:
            raise self.refuse(name, f"{expected}, the version that this release reads")


def _range(least: float, most: float) -> str:
    low = f" of at least {least:g}" if least > -math.inf else ""
    if most == math.inf:
        return low
    return f"{low} and at most {most:g}" if low else f" of at most {most:g}"


def take_header(path: Path, arrays: dict[str, np.ndarray], what: str) -> Fields:
    """Return the JSON object that stands as bytes in the array `header`."""
    return Fields(npz_header(path, arrays, what), f"{path}: `header`")


def take_record(header: Fields) -> dict[str, Any]:
    """Return what a file says of its making; its `settings`, if there are any, are an object."""
    record = header.object("record")
    if "settings" in record:
        record.object("settings")
    return record.values
