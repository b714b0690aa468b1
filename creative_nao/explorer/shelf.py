"""The memories that the page can show: those it was started with, and those that ship with the package."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path

from creative_nao.errors import NotFoundError, nearest_name
from creative_nao.explorer.physical import physical_map_of
from creative_nao.explorer.subject import Subject
from creative_nao.model import Memory, load_memory, shipped_memories
from creative_nao.pb_space import PAPER_RESOLUTION

NONE = "none"
"""What an address says when there shall be no second memory."""


class Shelf:
    """Memories by name, each loaded when it is first asked for and then shared by all tabs.

    Args:
        memories: Those the page was started with: the one it shows, and perhaps one beside it.
        resolution: Points along each axis of their maps.
        physical: Files of physical maps; each is used with the memory that it belongs to.

    Attributes:
        first: The memory that the page is about.
        beside: Name of the one shown beside it from the start, or empty.
        names: All that may be asked for.
    """

    def __init__(
        self, memories: Sequence[Memory], resolution: int = PAPER_RESOLUTION, physical: Sequence[Path] = ()
    ) -> None:
        self._resolution, self._physical = resolution, tuple(physical)
        self._lock = threading.Lock()
        self._subjects = {memory.name: self._subject(memory) for memory in memories}
        started = list(self._subjects)
        self.first = self._subjects[started[0]]
        self.beside = started[1] if len(started) > 1 else ""
        self.names = tuple(dict.fromkeys([*started, *shipped_memories()]))

    def get(self, name: str) -> Subject:
        """Return a memory, loaded now if it was not asked for before; its fine map is then computed beside.

        Raises:
            NotFoundError: If it is none of `names`; an address never names a file of its own choice.
        """
        if name not in self.names:
            raise NotFoundError(f"no memory `{name:.60}` here{nearest_name(name, self.names)}")
        with self._lock:
            if name not in self._subjects:
                self._subjects[name] = self._subject(load_memory(name))
                self._subjects[name].charting.start()
            return self._subjects[name]

    def start(self) -> None:
        """Compute the fine maps of the memories that the page was started with."""
        for subject in self._subjects.values():
            subject.charting.start()

    def _subject(self, memory: Memory) -> Subject:
        return Subject(memory, self._resolution, physical_map_of(memory, self._physical))
