"""What a tab shows, as the address of the page; and the favourites, in a file that outlives the server."""

from __future__ import annotations

import contextlib
import math
import os
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated
from urllib.parse import quote, urlencode

import numpy as np

from creative_nao import storage
from creative_nao.explorer.colours import NAMES
from creative_nao.explorer.memory_service import as_coordinate
from creative_nao.explorer.view import ALL, SMALLEST, View
from creative_nao.maps.picture import NEAREST
from creative_nao.schema import Field, LongText, Text, Version1, parse, record, save_json


@dataclass(frozen=True, eq=False)
class PageAddress:
    """Where a tab is: the movement's points, shape (n, 2), more than one a path, and what is shown in which colours."""

    points: np.ndarray = field(default_factory=lambda: np.zeros((1, 2)))
    beside: str = ""  # name of the second memory, or empty
    view: View | None = None  # None is the whole map
    colour: str = NEAREST
    taught: str = ""  # name of the trainer whose memory is the first one, or empty

    def address(self) -> str:
        """Return the page's address that shows the same again."""
        path = [f"{x:.6g},{y:.6g}" for x, y in self.points]
        asked = {"path": "_".join(path)} if len(path) > 1 else dict(zip("xy", path[0].split(","), strict=True))
        asked["beside"] = self.beside
        if self.view is not None:
            asked["view"] = f"{self.view.left:.7g},{self.view.bottom:.7g},{self.view.width:.7g}"
        asked |= {"colour": self.colour if self.colour != NEAREST else "", "taught": self.taught}
        return "/?" + urlencode({key: value for key, value in asked.items() if value}, safe="/,", quote_via=quote)


def page_address(
    x: str = "0", y: str = "0", path: str = "", beside: str = "", view: str = "", colour: str = NEAREST
) -> PageAddress:
    """Return the place that an address asks for; what cannot be read is as if it was not there."""
    pairs = [pair.split(",") for pair in path.split("_")[:MAX_POINTS]] if path else []
    points = [[as_coordinate(pair[0]), as_coordinate(pair[1])] for pair in pairs if len(pair) == 2]
    window = None
    with contextlib.suppress(ValueError):
        left, bottom, width = (float(part) for part in view.split(","))
        if all(map(math.isfinite, (left, bottom, width))) and SMALLEST <= width < ALL:
            left, bottom = (min(max(low, -1.0), 1.0 - width) for low in (left, bottom))
            window = View(left, bottom, width)
    return PageAddress(
        np.array(points or [[as_coordinate(x), as_coordinate(y)]]), beside, window,
        colour if colour in NAMES else NEAREST,
    )  # fmt: skip


MAX_FILE_BYTES = 4_000_000
MAX_FAVOURITES = 500
MAX_POINTS = 200
MAX_NOTE = 300
Coordinate = Annotated[float, Field(ge=-1, le=1)]


@record
class Favourite:
    """A movement to come back to: its memory's content hash, its points, a note, and which memory stood beside."""

    memory: Text
    points: Annotated[tuple[tuple[Coordinate, Coordinate], ...], Field(min_length=1, max_length=MAX_POINTS)]
    note: Annotated[LongText, Field(max_length=MAX_NOTE)] = ""
    beside: Text = ""


@record(closed=False)
class SessionFile:
    """What the session file holds."""

    format_version: Version1
    favourites: tuple[Favourite, ...]


def default_path() -> Path:
    """Return the session file of this user, in a folder that nobody else may enter."""
    base = os.environ.get("XDG_DATA_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".local" / "share"
    folder = Path(base) / "creative_nao"
    with contextlib.suppress(OSError):  # a read-only place is told when something is to be kept there
        storage.own_folder(folder)
    return folder / "explorer.json"


class Session:
    """The favourites of all memories in one file, which need not exist; every change is written at once.

    Several explorers may share the file: a change begins from what stands there then. FileFormatError if it exists and
    is no session of ours.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        self._favourites = _read(path) if path.exists() else []

    def favourites(self, memory: str) -> list[Favourite]:
        """Return those of one memory, oldest first."""
        return [favourite for favourite in self._favourites if favourite.memory == memory]

    def add(self, favourite: Favourite) -> None:
        """Keep one more; the oldest gives way when there are too many.

        Raises:
            OSError: If the file cannot be written; the favourites then are as they were.
            FileFormatError: If the file has become no session of ours.
        """
        self._change(lambda kept: [*kept, favourite][-MAX_FAVOURITES:])

    def remove(self, favourite: Favourite) -> None:
        """Forget one; raises like `add`."""
        self._change(lambda kept: [other for other in kept if other != favourite])

    def _change(self, change: Callable[[list[Favourite]], list[Favourite]]) -> None:
        with self._lock, storage.alone(self.path.parent):
            # A file that has vanished is written again from what is remembered here.
            favourites = change(_read(self.path) if self.path.exists() else self._favourites)
            save_json(self.path, SessionFile(1, tuple(favourites)), indent=1, private=True)
            self._favourites = favourites


def _read(path: Path) -> list[Favourite]:
    where = f"{path}: not a session of the explorer, move it away to begin anew"
    session = parse(SessionFile, storage.read_json(path, "session of the explorer", MAX_FILE_BYTES, where), where)
    return list(session.favourites[-MAX_FAVOURITES:])
