"""What the server keeps for each open tab, and its end: nothing of a tab outlives its browser's.

A tab ends when its connection has been gone for `server.RECONNECT_S`: closed, crashed, or silent until the heartbeat
gave it up. A page that was asked for and never connected ends after a minute.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from nicegui import ui

MAX_TABS = 200
"""More are refused: each holds a page's worth of state."""


class Kept(Protocol):
    """What belongs to one tab."""

    def close(self) -> None:
        """Stop what runs for the tab and let go of what it holds."""
        ...


class Tabs:
    """The open tabs of one server."""

    def __init__(self) -> None:
        self._kept: dict[str, Kept] = {}

    def __len__(self) -> int:
        return len(self._kept)

    def admits(self, kept: Kept, *ends: Callable[[], object]) -> bool:
        """Keep what belongs to the tab being built until it goes, then call `ends`; too many are told so instead."""
        if len(self._kept) >= MAX_TABS:
            for end in ends:
                end()
            ui.label(f"{MAX_TABS} tabs are open. Close some, wait a minute and reload this page.")
            return False
        client = ui.context.client
        key = client.id
        self._kept[key] = kept
        client.on_delete(lambda: self._release(key))
        for end in ends:
            client.on_delete(end)
        return True

    def _release(self, key: str) -> None:
        kept = self._kept.pop(key, None)
        if kept is not None:
            kept.close()
