"""Covariance matrix adaptation: a normal distribution that moves to where rewards are high."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from creative_nao.agents.base import Context
from creative_nao.agents.batch_search import BatchSearch
from creative_nao.agents.checks import at_least, load_extra, positive, require_extra


@dataclass(frozen=True)
class CmaEsSettings:
    """How CMA-ES searches.

    Raises:
        SettingsError: If a value is out of range; the message names the field.
    """

    population_size: int = 10
    """Movements between two updates of the distribution."""
    sigma: float = 0.8
    """First standard deviation, in each PB unit, around the centre of the space; the square is 2 wide."""

    def __post_init__(self) -> None:
        at_least(self, 4, "population_size")  # below, no two of them are parents
        positive(self, "sigma")


class CmaEsAgent(BatchSearch):
    """CMA-ES (Hansen 2016, arXiv:1604.00772) of the package `cmaes`, maximising the reward of a single action.

    What an action earns falls when something like it has joined the repertoire, so the optimum moves away from where
    the search has been: CMA-ES follows it.

    Raises:
        MissingDependencyError: If `cmaes` is not installed.
    """

    name: ClassVar[str] = "cma_es"

    def __init__(self, settings: CmaEsSettings | None = None):
        require_extra(package="cmaes", extra="search", agent=self.name)
        self.settings = settings or CmaEsSettings()

    def prepare(self, context: Context, seed: int) -> None:
        """Set the distribution up."""
        cmaes = load_extra("cmaes", package="cmaes", extra="search", agent=self.name)
        low, high = context.action_space.low.astype(np.float64), context.action_space.high.astype(np.float64)
        self._search = cmaes.CMA(
            mean=(low + high) / 2.0,
            sigma=self.settings.sigma,
            bounds=np.stack([low, high], axis=1),
            population_size=self.settings.population_size,
            seed=seed,
        )

    def propose(self) -> np.ndarray:
        """Draw a population, shape (population_size, n_pb)."""
        return np.stack([self._search.ask() for _ in range(self.settings.population_size)])

    def receive(self, pb: np.ndarray, rewards: np.ndarray, descriptors: np.ndarray) -> None:
        """Update the distribution; the package minimises."""
        self._search.tell([(point, -reward) for point, reward in zip(pb, rewards.tolist(), strict=True)])
