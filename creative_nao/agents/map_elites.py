"""MAP-Elites: keep the best movement of each kind, and vary those."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Any, ClassVar

import numpy as np

from creative_nao.agents.arm_archive import ArmArchiveSearch
from creative_nao.agents.base import Context
from creative_nao.agents.checks import at_least, positive
from creative_nao.agents.quality_diversity import bounds


@dataclass(frozen=True)
class MapElitesSettings:
    """How MAP-Elites searches.

    Raises:
        SettingsError: If a value is out of range; the message names the field.
    """

    n_initial: int = 15
    """Movements drawn uniformly before the first variation."""
    batch_size: int = 1
    """Movements between two updates of the archive."""
    sigma: float = 0.5
    """Standard deviation of a variation, in each PB unit; the square is 2 wide."""
    n_cells: int = 6
    """Cells of the archive along each of the two descriptors."""
    largest_excursion: float = 1.5
    """Upper end of the archive along each descriptor [rad]; beyond it movements fall into the last cell."""

    def __post_init__(self) -> None:
        at_least(self, 1, "n_initial", "batch_size", "n_cells")
        positive(self, "sigma", "largest_excursion")


class MapElitesAgent(ArmArchiveSearch[MapElitesSettings]):
    """MAP-Elites (Mouret and Clune 2015, arXiv:1504.04909) by pyribs' `GridArchive` and `GaussianEmitter`.

    Movements are sorted by how far each arm moves (`descriptors.arm_excursions`).

    Raises:
        MissingDependencyError: If pyribs is not installed.
    """

    name: ClassVar[str] = "map_elites"

    def __init__(self, settings: MapElitesSettings | None = None):
        super().__init__(settings or MapElitesSettings())

    def build_emitter(self, emitters: ModuleType, archive: Any, context: Context, seed: np.random.SeedSequence) -> Any:
        """Return the emitter that varies elites drawn from the archive."""
        space = context.action_space
        return emitters.GaussianEmitter(
            archive,
            sigma=self.settings.sigma,
            initial_solutions=context.rng.uniform(space.low, space.high, (self.settings.n_initial, *space.shape)),
            bounds=bounds(context),
            batch_size=self.settings.batch_size,
            seed=seed,
        )
