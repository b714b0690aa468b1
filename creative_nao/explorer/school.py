"""The apprentices of one server, under names that cannot be guessed, each as long as a tab holds it."""

from __future__ import annotations

import secrets
import threading
from typing import Any

from creative_nao.cores import usable_cores
from creative_nao.explorer.apprentice import Apprentice

PLACES = max(1, usable_cores() - 1)
"""How many learn at a time; the page keeps a core."""


class Desk:
    """An apprentice and what was made of it.

    Attributes:
        apprentice: The network that learns.
        exhibit: What the explorer's page shows of it, once it was asked for.
    """

    def __init__(self, apprentice: Apprentice) -> None:
        self.apprentice = apprentice
        self.exhibit: Any = None
        self.holders = 0


class School:
    """All apprentices; what no tab holds any more is stopped and forgotten."""

    def __init__(self) -> None:
        self.turnstile = threading.Semaphore(PLACES)
        self._desks: dict[str, Desk] = {}

    def __len__(self) -> int:
        return len(self._desks)

    def enrol(self, apprentice: Apprentice) -> str:
        """Take an apprentice in, held once, and return its name."""
        key = secrets.token_urlsafe(12)
        self._desks[key] = Desk(apprentice)
        self._desks[key].holders = 1
        return key

    def hold(self, key: str) -> Desk | None:
        """Hold an apprentice for one more tab; None if there is no such."""
        desk = self._desks.get(key)
        if desk is not None:
            desk.holders += 1
        return desk

    def desk(self, key: str) -> Desk | None:
        """Return an apprentice's desk without holding it."""
        return self._desks.get(key)

    def let_go(self, key: str) -> None:
        """Hold it for one tab less; without any, it is stopped and forgotten."""
        desk = self._desks.get(key)
        if desk is None:
            return
        desk.holders -= 1
        if desk.holders <= 0:
            desk.apprentice.stop()
            del self._desks[key]
