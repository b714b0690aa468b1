"""Threads that help a vector environment: compiled code and MuJoCo run side by side, Python does not."""

from __future__ import annotations

import queue
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any

import numpy as np

from creative_nao.cores import usable_cores
from creative_nao.envs.performers import Body, Performed, SharedScene
from creative_nao.errors import SettingsError
from creative_nao.robot import PhysicalLimits

LEAST = 8
"""Fewest movements a thread is given: below, handing them over costs more than it saves."""


class Crew:
    """A few threads, started when first needed; copies and pickles start their own.

    Args:
        n_threads: How many; None for one a processor core.

    Raises:
        SettingsError: If it is below 1.
    """

    def __init__(self, n_threads: int | None = None) -> None:
        if n_threads is not None and n_threads < 1:
            raise SettingsError(f"`n_threads` should be at least 1 or None, but is {n_threads}")
        self.n_threads = n_threads or usable_cores()
        self._pool: ThreadPoolExecutor | None = None

    def map(self, function: Callable[[Any], Any], pieces: Sequence[Any]) -> list[Any]:
        """Return what `function` makes of each piece, in order; an error of one is raised here."""
        if self.n_threads == 1 or len(pieces) < 2:
            return [function(piece) for piece in pieces]
        return list(self._threads().map(function, pieces))

    def share(self, work: Callable[[np.ndarray], None], places: np.ndarray) -> None:
        """Cut places into even pieces, one a thread unless they would become too small, and let each be worked on.

        The calling thread takes the first piece, which saves waking another.

        Args:
            work: Called with some of the places; keeps what it finds where no other piece does.
            places: Shape (m,).
        """
        first, *others = np.array_split(places, max(1, min(self.n_threads, len(places) // LEAST)))
        started = [self._threads().submit(work, piece) for piece in others]
        try:
            work(first)
        finally:
            wait(started)  # also after an error: nobody may still write when the caller goes on
        for one in started:
            one.result()

    def _threads(self) -> ThreadPoolExecutor:
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.n_threads, thread_name_prefix="creative-nao")
        return self._pool

    def close(self) -> None:
        """End the threads; a later call of `map` starts new ones."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def __getstate__(self) -> dict[str, Any]:
        return {"n_threads": self.n_threads, "_pool": None}


class Bodies:
    """A robot a thread, all in one scene; each performs from the settled guard, so it does not matter which one does.

    Args:
        crew: The threads.
        shared: Where the robots stand.
        limits: From where on a performance counts as failed.
    """

    def __init__(self, crew: Crew, shared: SharedScene, limits: PhysicalLimits) -> None:
        self._crew, self._shared, self.limits = crew, shared, limits
        self._idle: queue.SimpleQueue[Body] | None = None
        self._guard: np.ndarray | None = None

    def perform(
        self, generated: np.ndarray, dt_s: Sequence[float], joints: tuple[str, ...], keep_frames: bool
    ) -> tuple[list[Performed], np.ndarray]:
        """Perform trajectories (m, n_steps, 8) [rad]; return what came of them and the states they ended in, (m, n)."""
        idle = self._ready()

        def one(place: int) -> tuple[Performed, np.ndarray]:
            body = idle.get()
            try:
                return body.perform(generated[place], dt_s[place], joints, keep_frames), body.get_state()
            finally:
                idle.put(body)

        found = self._crew.map(one, range(len(generated)))
        return [performed for performed, _ in found], np.stack([state for _, state in found])

    def guard(self) -> np.ndarray:
        """Return MuJoCo's state of the settled guard, (n,)."""
        self._ready()
        assert self._guard is not None
        return self._guard

    def _ready(self) -> queue.SimpleQueue[Body]:
        if self._idle is None:
            self._idle = queue.SimpleQueue()
            for _ in range(self._crew.n_threads):
                body = Body(self._shared, self.limits)
                body.reset()
                self._guard = body.get_state()
                self._idle.put(body)
        return self._idle

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_idle": None, "_guard": None}
