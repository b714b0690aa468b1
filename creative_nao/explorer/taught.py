"""A memory that was taught in the page, as the explorer's page shows it."""

from __future__ import annotations

from dataclasses import replace

from creative_nao.explorer.page import Exhibit
from creative_nao.explorer.shelf import Shelf
from creative_nao.model import Memory

RESOLUTION = 100
"""Points along each side of its map: a quarter of the time of the paper's, for a memory that may soon learn on."""


def taught_exhibit(memory: Memory, shown: Exhibit, key: str) -> Exhibit:
    """Return an exhibit of a taught memory with the robot and the favourites of another one.

    Args:
        memory: What was taught.
        shown: The exhibit of this server.
        key: Name of the apprentice in the `School`, for the page's address.
    """
    shelf = Shelf([memory], RESOLUTION)
    shelf.start()
    return replace(shown, shelf=shelf, crowd=None, taught=key)
