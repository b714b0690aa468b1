"""What a tab shows, as the address of the page; and the favourites, in a file that outlives the server."""

from __future__ import annotations

import json
import math
import os
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from urllib.parse import quote

import numpy as np

from creative_nao import storage
from creative_nao.errors import FileFormatError, SettingsError
from creative_nao.explorer.colours import NAMES, NEAREST
from creative_nao.explorer.memory_service import as_coordinate
from creative_nao.explorer.view import ALL, SMALLEST, View
from creative_nao.fields import LONGEST_NAME, Fields, is_writable
from creative_nao.storage import as_json, read_text


@dataclass(frozen=True, eq=False)
class PageAddress:
    """Where a tab is.

    Attributes:
        points: Where the movement shown comes from, shape (n, 2); more than one are a path.
        beside: Name of the second memory, or empty.
        view: Window of the map; None is the whole map.
        colour: What the colours of the map tell.
        taught: Name of the trainer whose memory is the first one, or empty.
    """

    points: np.ndarray = field(default_factory=lambda: np.zeros((1, 2)))
    beside: str = ""
    view: View | None = None
    colour: str = NEAREST
    taught: str = ""

    def address(self) -> str:
        """Return the page's address that shows the same again."""
        if len(self.points) == 1:
            parts = [f"x={self.points[0, 0]:.6g}", f"y={self.points[0, 1]:.6g}"]
        else:
            parts = ["path=" + "_".join(f"{x:.6g},{y:.6g}" for x, y in self.points)]
        if self.beside:
            parts.append(f"beside={quote(self.beside)}")
        if self.view is not None:
            parts.append(f"view={self.view.left:.7g},{self.view.bottom:.7g},{self.view.width:.7g}")
        if self.colour != NEAREST:
            parts.append(f"colour={self.colour}")
        if self.taught:
            parts.append(f"taught={quote(self.taught)}")
        return "/?" + "&".join(parts)


def page_address(
    x: str = "0", y: str = "0", path: str = "", beside: str = "", view: str = "", colour: str = NEAREST
) -> PageAddress:
    """Return the place that an address asks for; what cannot be read is as if it was not there."""
    pairs = [pair.split(",") for pair in path.split("_")[:MAX_POINTS]] if path else []
    points = [[as_coordinate(pair[0]), as_coordinate(pair[1])] for pair in pairs if len(pair) == 2]
    return PageAddress(
        np.array(points if points else [[as_coordinate(x), as_coordinate(y)]]),
        beside,
        _view_of(view),
        colour if colour in NAMES else NEAREST,
    )


def _view_of(text: str) -> View | None:
    try:
        left, bottom, width = (float(part) for part in text.split(","))
    except ValueError:
        return None
    if not all(map(math.isfinite, (left, bottom, width))) or not SMALLEST <= width < ALL:
        return None
    left, bottom = (min(max(low, -1.0), 1.0 - width) for low in (left, bottom))
    return View(left, bottom, width)


FORMAT_VERSION = 1
MAX_FILE_BYTES = 4_000_000
MAX_FAVOURITES = 500
MAX_POINTS = 200
MAX_NOTE = 300


@dataclass(frozen=True)
class Favourite:
    """A movement to come back to: its memory's content hash, its points, a note, and which memory stood beside."""

    memory: str
    points: tuple[tuple[float, float], ...]
    note: str = ""
    beside: str = ""

    def __post_init__(self) -> None:
        """Check the fields, which may come from a file."""
        points = np.asarray(self.points)
        fits = points.ndim == 2 and points.shape[1:] == (2,) and 1 <= len(points) <= MAX_POINTS
        if not fits or points.dtype.kind not in "fi" or not (np.abs(points) <= 1).all():
            raise SettingsError("`points` of a favourite should be 1 to 200 pairs of numbers in [-1, 1]")
        for field_name, longest in (("note", MAX_NOTE), ("memory", LONGEST_NAME), ("beside", LONGEST_NAME)):
            text = getattr(self, field_name)
            if not isinstance(text, str) or len(text) > longest or not is_writable(text):
                raise SettingsError(f"`{field_name}` of a favourite should be text of at most {longest} characters")
        object.__setattr__(self, "points", tuple((float(a), float(b)) for a, b in points))


def default_path() -> Path:
    """Return the session file of this user."""
    base = os.environ.get("XDG_DATA_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".local" / "share"
    return Path(base) / "creative_nao" / "explorer.json"


class Session:
    """The favourites of all memories in one file; every change is written at once.

    Several explorers may share the file: a change begins from what stands there then.

    Args:
        path: The file; it need not exist.

    Raises:
        FileFormatError: If it exists and is no session of ours.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        self._favourites = _read(path) if path.exists() else []

    def favourites(self, memory: str) -> list[Favourite]:
        """Return those of one memory, oldest first."""
        return [one for one in self._favourites if one.memory == memory]

    def add(self, favourite: Favourite) -> None:
        """Keep one more; the oldest gives way when there are too many.

        Raises:
            OSError: If the file cannot be written; the favourites then are as they were.
            FileFormatError: If the file has become no session of ours.
        """
        self._change(lambda found: [*found, favourite][-MAX_FAVOURITES:])

    def remove(self, favourite: Favourite) -> None:
        """Forget one; raises like `add`."""
        self._change(lambda found: [one for one in found if one != favourite])

    def _change(self, change: Callable[[list[Favourite]], list[Favourite]]) -> None:
        with self._lock, storage.alone(self.path.parent):
            # A file that has vanished is written again from what is remembered here.
            favourites = change(_read(self.path) if self.path.exists() else self._favourites)
            content = {"format_version": FORMAT_VERSION, "favourites": [asdict(one) for one in favourites]}
            storage.write_text(self.path, json.dumps(content, indent=1) + "\n")
            self._favourites = favourites


def _read(path: Path) -> list[Favourite]:
    where = f"{path}: not a session of the explorer, move it away to begin anew"
    found = Fields(as_json(read_text(path, "session of the explorer", MAX_FILE_BYTES), where), where)
    found.version("format_version", FORMAT_VERSION)
    favourites = []
    for told in found.objects("favourites"):
        told.only(("memory", "points", "note", "beside"))
        points, beside = tuple(told.listed("points", MAX_POINTS)), told.text("beside") if "beside" in told else ""
        try:
            favourites.append(Favourite(told.text("memory"), points, told.text("note", MAX_NOTE), beside))
        except FileFormatError:
            raise
        except (ValueError, TypeError, OverflowError) as error:
            raise FileFormatError(f"{told.where}: {error}") from error
    return favourites[-MAX_FAVOURITES:]
