"""Novelty search: look for behaviour unlike any before, whatever it earns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from creative_nao.agents.base import Context
from creative_nao.agents.batch_search import BatchSearch
from creative_nao.agents.checks import at_least, positive
from creative_nao.agents.descriptors import mean_postures
from creative_nao.agents.quality_diversity import bounds, load_ribs, require_ribs
from creative_nao.errors import SettingsError


@dataclass(frozen=True)
class NoveltySearchSettings:
    """How novelty search searches.

    Raises:
        SettingsError: If a value is out of range; the message names the field.
    """

    n_initial: int = 5
    """Movements drawn uniformly before the first update."""
    batch_size: int = 3
    """Movements between two updates of distribution and archive."""
    sigma: float = 0.8
    """First standard deviation, in each PB unit, around a movement drawn from the archive; the square is 2 wide."""
    n_neighbours: int = 3
    """Novelty is the mean distance to so many movements of the archive."""
    threshold: float = 0.5
    """A movement joins the archive when it is at least so novel, in the unit of the descriptor [rad]."""
    n_stretches: int = 5
    """The descriptor is the mean posture in so many equal stretches of the movement."""

    def __post_init__(self) -> None:
        at_least(self, 2, "batch_size")
        at_least(self, 1, "n_initial", "n_neighbours", "n_stretches")
        positive(self, "sigma")
        if not self.threshold >= 0.0:
            raise SettingsError(f"`threshold` should be at least 0, but is {self.threshold}")


class NoveltySearchAgent(BatchSearch):
    """Novelty search (Lehman and Stanley 2011) by pyribs' `ProximityArchive` and `EvolutionStrategyEmitter`.

    Movements are compared by their mean posture in a few stretches of time (`descriptors.mean_postures`). The reward
    plays no part; that a movement is inappropriate does: it counts as none (a minimal criterion, as Lehman and
    Stanley proposed in 2010).

    Raises:
        MissingDependencyError: If pyribs is not installed.
    """

    name: ClassVar[str] = "novelty_search"

    def __init__(self, settings: NoveltySearchSettings | None = None):
        require_ribs(self.name)
        self.settings = settings or NoveltySearchSettings()

    def prepare(self, context: Context, seed: int) -> None:
        """Begin with nothing: the first movements show how many joints the descriptor has."""
        self._parts = load_ribs(self.name)
        self._seeds = np.random.SeedSequence(seed).spawn(2)
        self._scheduler: Any = None

    def propose(self) -> np.ndarray:
        """Draw the first batch uniformly, (n_initial, n_pb); after it ask the emitter, (batch_size, n_pb)."""
        if self._scheduler is not None:
            return self._scheduler.ask()
        space = self.context.action_space
        return self.context.rng.uniform(space.low, space.high, (self.settings.n_initial, *space.shape))

    def receive(self, pb: np.ndarray, rewards: np.ndarray, descriptors: np.ndarray) -> None:
        """Add the batch to the archive and tell the emitter how novel each movement was."""
        if self._scheduler is not None:
            self._scheduler.tell(rewards, descriptors)  # the rewards are kept beside, not ranked
            return
        archives, emitters, schedulers = self._parts
        archive = archives.ProximityArchive(
            solution_dim=pb.shape[1],
            measure_dim=descriptors.shape[1],
            k_neighbors=self.settings.n_neighbours,
            novelty_threshold=self.settings.threshold,
            seed=self._seeds[0],
        )
        archive.add(pb, rewards, descriptors)
        emitter = emitters.EvolutionStrategyEmitter(
            archive,
            x0=archive.sample_elites(1)["solution"][0],
            sigma0=self.settings.sigma,
            ranker="nov",
            bounds=bounds(self.context),
            batch_size=self.settings.batch_size,
            seed=self._seeds[1],
        )
        self._scheduler = schedulers.Scheduler(archive, [emitter])

    def describe(self, info: Mapping[str, Any]) -> np.ndarray:
        """Return the mean postures [rad], shape (n_stretches * n_joints,)."""
        return mean_postures(info, self.settings.n_stretches)
