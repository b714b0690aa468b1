"""Bayesian optimisation: a Gaussian process over the PB space, and the point it expects most of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from creative_nao.agents.base import Context
from creative_nao.agents.checks import at_least, load_extra, require_extra
from creative_nao.agents.movement import MovementAgent


@dataclass(frozen=True)
class BayesianSettings:
    """How Bayesian optimisation searches.

    Raises:
        SettingsError: If a value is out of range; the message names the field.
    """

    n_startup: int = 15
    """Movements drawn uniformly before the Gaussian process decides."""

    def __post_init__(self) -> None:
        at_least(self, 1, "n_startup")


class BayesianAgent(MovementAgent):
    """Bayesian optimisation by Optuna's `GPSampler`: Matern 5/2 kernel, logarithm of the expected improvement.

    It models what a single action earned when it was tried. A movement earns less once something like it has joined the
    repertoire, which the model takes for noise.

    Raises:
        MissingDependencyError: If Optuna is not installed.
    """

    name: ClassVar[str] = "bayesian"
    learns_within_episode: ClassVar[bool] = True

    def __init__(self, settings: BayesianSettings | None = None):
        require_extra(package="optuna", extra="bayes", agent=self.name)
        self.settings = settings or BayesianSettings()

    def start(self, context: Context) -> None:
        """Begin with an empty study."""
        super().start(context)
        self._optuna = load_extra("optuna", package="optuna", extra="bayes", agent=self.name)
        space = context.action_space
        ends = zip(space.low.tolist(), space.high.tolist(), strict=True)
        uniform = self._optuna.distributions.FloatDistribution
        self._space = {f"pb_{place}": uniform(low, high) for place, (low, high) in enumerate(ends, 1)}
        with self._quiet():
            sampler = self._optuna.samplers.GPSampler(
                seed=int(context.rng.integers(2**31)), n_startup_trials=self.settings.n_startup
            )
            self._study = self._optuna.create_study(direction="maximize", sampler=sampler)

    def next_pb(self) -> np.ndarray:
        """Return the point with the largest expected improvement, shape (n_pb,)."""
        with self._quiet():
            self._trial = self._study.ask(self._space)
        return np.array([self._trial.params[name] for name in self._space])

    def judge(self, reward: float, info: Mapping[str, Any]) -> None:
        """Add what the movement earned to the study."""
        with self._quiet():
            self._study.tell(self._trial, reward)

    @contextmanager
    def _quiet(self) -> Iterator[None]:
        """Keep Optuna's log lines out of progress displays, and its verbosity as its user left it."""
        logging = self._optuna.logging
        before = logging.get_verbosity()
        logging.set_verbosity(logging.WARNING)
        try:
            yield
        finally:
            logging.set_verbosity(before)
