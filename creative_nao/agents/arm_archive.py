"""Searches that sort movements by how far each arm moves: what CMA-ME and MAP-Elites have in common."""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from creative_nao.agents.base import Context
from creative_nao.agents.descriptors import N_EXCURSIONS, arm_excursions
from creative_nao.agents.quality_diversity import RibsSearch


class ArmGrid(Protocol):
    """The settings that say how fine the archive is."""

    @property
    def n_cells(self) -> int:
        """Cells along each of the two descriptors."""
        ...

    @property
    def largest_excursion(self) -> float:
        """Upper end along each descriptor [rad]."""
        ...


Settings = TypeVar("Settings", bound=ArmGrid)


class ArmArchiveSearch(RibsSearch, Generic[Settings]):
    """A search whose archive is pyribs' `GridArchive` over the excursions of both arms.

    A subclass defines the emitter.
    """

    def __init__(self, settings: Settings):
        super().__init__()
        self.settings = settings

    def build_archive(self, archives: ModuleType, context: Context, seed: np.random.SeedSequence) -> Any:
        """Return a grid over the excursions of both arms."""
        return archives.GridArchive(
            solution_dim=context.action_space.shape[0],
            dims=[self.settings.n_cells] * N_EXCURSIONS,
            ranges=[(0.0, self.settings.largest_excursion)] * N_EXCURSIONS,
            seed=seed,
        )

    def describe(self, info: Mapping[str, Any]) -> np.ndarray:
        """Return how far each arm moves [rad], shape (2,)."""
        return arm_excursions(info)
