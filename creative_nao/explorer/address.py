"""What a tab shows, as the address of the page: shared, bookmarked or reloaded, it shows the same again."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from urllib.parse import quote

import numpy as np

from creative_nao.explorer.colours import NAMES, NEAREST
from creative_nao.explorer.mind import as_coordinate
from creative_nao.explorer.session import MAX_POINTS
from creative_nao.explorer.view import ALL, SMALLEST, View


@dataclass(frozen=True, eq=False)
class Place:
    """Where a tab is.

    Attributes:
        points: Where the movement shown comes from, shape (n, 2); more than one are a path.
        beside: Name of the second memory, or empty.
        view: Window of the map; None is the whole map.
        colour: What the colours of the map tell.
        taught: Name of the apprentice whose memory is the first one, or empty.
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


def place_of(
    x: str = "0", y: str = "0", path: str = "", beside: str = "", view: str = "", colour: str = NEAREST
) -> Place:
    """Return the place that an address asks for; what cannot be read is as if it was not there."""
    pairs = [pair.split(",") for pair in path.split("_")[:MAX_POINTS]] if path else []
    points = [[as_coordinate(pair[0]), as_coordinate(pair[1])] for pair in pairs if len(pair) == 2]
    return Place(
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
