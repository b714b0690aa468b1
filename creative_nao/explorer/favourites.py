"""The favourites of all memories, in a file that outlives the server."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from creative_nao import storage
from creative_nao.errors import FileFormatError, NotFoundError
from creative_nao.explorer.registry import MAX_POINTS
from creative_nao.schema import Field, LongText, Text, Version1, parse, record, save_json

MAX_FILE_BYTES = 4_000_000
MAX_FAVOURITES = 500
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
        """Return those of one memory, oldest first, with those that other explorers have kept since."""
        with self._lock, contextlib.suppress(OSError, FileFormatError, NotFoundError):
            self._favourites = _read(self.path)
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
