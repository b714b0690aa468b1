"""Searches of pyribs: an archive of the movements found, emitters that propose new ones, a scheduler between them."""

from __future__ import annotations

import warnings
from abc import abstractmethod
from types import ModuleType
from typing import Any

import numpy as np

from creative_nao.agents.base import Context
from creative_nao.agents.batch_search import BatchSearch
from creative_nao.agents.checks import load_extra, require_extra


class RibsSearch(BatchSearch):
    """Base of the agents whose search is one archive and one emitter of pyribs. A subclass defines both.

    The objective is what a movement earned when it was tried. It is kept as it was, although the same movement would
    earn nothing a second time: the archive is a record of finds, and its elites are where new movements start from.

    Raises:
        MissingDependencyError: If pyribs is not installed.
    """

    def __init__(self) -> None:
        require_ribs(self.name)

    def prepare(self, context: Context, seed: int) -> None:
        """Build archive, emitter and scheduler."""
        archives, emitters, schedulers = load_ribs(self.name)
        for_archive, for_emitter = np.random.SeedSequence(seed).spawn(2)
        archive = self.build_archive(archives, context, for_archive)
        emitter = self.build_emitter(emitters, archive, context, for_emitter)
        self._scheduler = schedulers.Scheduler(archive, [emitter])

    def propose(self) -> np.ndarray:
        """Ask the emitter, shape (n, n_pb)."""
        return self._scheduler.ask()

    def receive(self, pb: np.ndarray, rewards: np.ndarray, descriptors: np.ndarray) -> None:
        """Add the batch to the archive and tell the emitter."""
        with warnings.catch_warnings():
            # pyribs warns of an archive that stays empty: nothing appropriate yet is no mistake here.
            warnings.filterwarnings("ignore", message=".*was empty before adding solutions", category=UserWarning)
            self._scheduler.tell(rewards, descriptors)

    @property
    def archive(self) -> Any:
        """The archive of the running episode: a `ribs.archives` archive."""
        return self._scheduler.archive

    @abstractmethod
    def build_archive(self, archives: ModuleType, context: Context, seed: np.random.SeedSequence) -> Any:
        """Return an empty archive of `ribs.archives`."""

    @abstractmethod
    def build_emitter(self, emitters: ModuleType, archive: Any, context: Context, seed: np.random.SeedSequence) -> Any:
        """Return the emitter of `ribs.emitters` that fills `archive`."""


def require_ribs(agent: str) -> None:
    """Refuse an agent that needs pyribs where it is missing.

    Raises:
        MissingDependencyError: If it is not installed.
    """
    require_extra(package="ribs", extra="search", agent=agent)


def load_ribs(agent: str) -> tuple[ModuleType, ModuleType, ModuleType]:
    """Return `ribs.archives`, `ribs.emitters` and `ribs.schedulers`.

    Raises:
        MissingDependencyError: If pyribs cannot be imported.
    """
    archives, emitters, schedulers = (
        load_extra(f"ribs.{part}", package="ribs", extra="search", agent=agent)
        for part in ("archives", "emitters", "schedulers")
    )
    return archives, emitters, schedulers


def bounds(context: Context) -> list[tuple[float, float]]:
    """Return the ends of the action space, a pair for each PB unit."""
    return list(zip(context.action_space.low.tolist(), context.action_space.high.tolist(), strict=True))
