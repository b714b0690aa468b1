"""CMA-ME: evolution strategies that move to where the archive improves."""

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
class CmaMeSettings:
    """How CMA-ME searches.

    Raises:
        SettingsError: If a value is out of range; the message names the field.
    """

    batch_size: int = 10
    """Movements between two updates of distribution and archive."""
    sigma: float = 1.2
    """First standard deviation, in each PB unit, around the centre of the space and after a restart around an elite."""
    n_cells: int = 12
    """Cells of the archive along each of the two descriptors."""
    largest_excursion: float = 1.5
    """Upper end of the archive along each descriptor [rad]; beyond it movements fall into the last cell."""

    def __post_init__(self) -> None:
        at_least(self, 2, "batch_size")
        at_least(self, 1, "n_cells")
        positive(self, "sigma", "largest_excursion")


class CmaMeAgent(ArmArchiveSearch[CmaMeSettings]):
    """CMA-ME (Fontaine et al. 2020, arXiv:1912.02400) by pyribs' `GridArchive` and `EvolutionStrategyEmitter`.

    A movement ranks first if it fills an empty cell, then by how much it improves one. Movements are sorted by how far
    each arm moves (`descriptors.arm_excursions`).

    Raises:
        MissingDependencyError: If pyribs is not installed.
    """

    name: ClassVar[str] = "cma_me"

    def __init__(self, settings: CmaMeSettings | None = None):
        super().__init__(settings or CmaMeSettings())

    def build_emitter(self, emitters: ModuleType, archive: Any, context: Context, seed: np.random.SeedSequence) -> Any:
        """Return the evolution strategy, ranked by improvement of the archive."""
        space = context.action_space
        return emitters.EvolutionStrategyEmitter(
            archive,
            x0=(space.low + space.high).astype(np.float64) / 2.0,
            sigma0=self.settings.sigma,
            ranker="2imp",
            bounds=bounds(context),
            batch_size=self.settings.batch_size,
            seed=seed,
        )
