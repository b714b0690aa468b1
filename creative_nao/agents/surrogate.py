"""A surrogate of the memory: a Gaussian process over whole trajectories predicts what untried points would give."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from creative_nao.agents.base import Context
from creative_nao.agents.black_box import learned_points, uniform_points
from creative_nao.agents.rehearsal import PlanningAgent
from creative_nao.measures import dtw_matrix
from creative_nao.schema import Count, Field, NonNegative, Positive, UnitInterval, record

NOISE = 1e-4
"""Variance of the noise of the process, as a share of its own: keeps the kernel matrix of close points invertible."""


@record
class SurrogateSettings:
    """How the surrogate models and chooses."""

    n_drawn: Count = 256
    """Points drawn uniformly, of which those with the largest expected reward are taken."""
    length_scales: Annotated[tuple[Positive, ...], Field(min_length=1)] = (0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0)
    """Length scales of the kernel, in root mean squares over the PB units; the likeliest is taken."""
    optimism: NonNegative = 0.0
    """Weight of the uncertainty of a prediction, in standard deviations."""
    prior_appropriate: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.85
    """Share of appropriate movements far away from everything tried."""
    first_share: UnitInterval = 0.5
    """Part of the budget of imagining that is spread evenly before the first movement is performed."""
    n_fitted: Annotated[int, Field(ge=10)] = 400
    """Most movements that the process is fitted to: of more, some evenly over the episode."""


class SurrogateAgent(PlanningAgent[SurrogateSettings]):
    """Fits a Gaussian process from PB points to trajectories and looks where it expects the largest reward.

    It is fitted to the learned points with their basic actions and to every movement performed or imagined. The
    expected reward of a point is the distance (dynamic time warping) of the predicted trajectory to the nearest known
    one, plus its uncertainty, times the probability that the movement is appropriate, which the same process tells.
    Without imagining it performs the best point; else it imagines there, and performs the farthest movement of all that
    it has imagined.
    """

    name: ClassVar[str] = "surrogate"
    settings_type = SurrogateSettings

    def start(self, context: Context) -> None:
        """Begin with the basic actions."""
        points, basic = learned_points(context, self.name), context.demonstrations.trajectories
        self._at, self._usable = list(points), [1.0] * len(points)
        longest = max(map(len, basic))
        self._moves = [np.pad(move, ((0, longest - len(move)), (0, 0)), mode="edge") for move in basic]
        super().start(context)

    def untried(self) -> np.ndarray:
        """Return the point with the largest expected reward, shape (n_pb,)."""
        return self.where(1)[0]

    def learn_imagined(self, pb: np.ndarray, info: Mapping[str, Any]) -> None:
        """Add a movement to what the process is fitted to."""
        self._at.append(pb)
        self._moves.append(np.asarray(info["trajectory"]))
        self._usable.append(float(info["appropriate"]))

    def where(self, n: int) -> np.ndarray:
        """Return the `n` best of the points drawn, best first, shape (n, n_pb)."""
        settings = self.settings
        drawn = uniform_points(self.context, max(settings.n_drawn, n))
        mean, deviation, appropriate = self.predict(drawn)
        distance = dtw_matrix(mean.astype(np.float32), self._known, dtype=np.float32).min(axis=1)
        value = appropriate * (distance + settings.optimism * deviation) * self.accepted(list(mean))
        return drawn[np.argsort(-value, kind="stable")[:n]]

    def predict(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return what the surrogate expects at PB points (n, n_pb).

        Returns:
            Trajectories (n, n_steps, n_joints) [rad]; their uncertainty, summed over the ticks [rad], (n,); and the
            probabilities that they are appropriate, (n,).
        """
        n = len(self._at)
        kept = np.unique(np.linspace(0, n - 1, min(n, self.settings.n_fitted)).round().astype(np.int64))
        at, moves = np.array([self._at[k] for k in kept]), np.array([self._moves[k] for k in kept])
        usable = np.array([self._usable[k] for k in kept])
        n_steps, n_joints = moves.shape[1:]
        flat = moves.reshape(len(at), -1)
        centre = flat.mean(axis=0)
        flat = flat - centre
        factor, scale, variance = _likeliest(_squared_gaps(at, at), flat, self.settings.length_scales)
        across = _kernel(_squared_gaps(points, at), scale)
        weights = cho_solve(factor, across.T, check_finite=False).T
        left = np.maximum(1.0 - (weights * across).sum(axis=1), 0.0)
        deviation = n_steps * np.sqrt(n_joints * variance * left)
        prior = self.settings.prior_appropriate
        appropriate = np.clip(prior + weights @ (usable - prior), 0.0, 1.0)
        return (weights @ flat + centre).reshape(-1, n_steps, n_joints), deviation, appropriate


def _squared_gaps(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the mean squared difference per PB unit of points (n, n_pb) and (m, n_pb), shape (n, m)."""
    return ((one[:, None] - other) ** 2).mean(axis=-1)


def _kernel(gaps: np.ndarray, scale: float) -> np.ndarray:
    """Return the Matern 5/2 kernel at squared gaps."""
    r = np.sqrt(5.0 * gaps) / scale
    return (1.0 + r + r**2 / 3.0) * np.exp(-r)


def _factor(gaps: np.ndarray, scale: float) -> Any:
    """Return the Cholesky factor of the kernel matrix of points with these squared gaps, for `cho_solve`."""
    return cho_factor(_kernel(gaps, scale) + NOISE * np.eye(len(gaps)), lower=True, check_finite=False)


def _likeliest(gaps: np.ndarray, flat: np.ndarray, scales: tuple[float, ...]) -> tuple[Any, float, float]:
    """Return the Cholesky factor, length scale and variance per value with the largest marginal likelihood.

    Args:
        gaps: Squared gaps between the points, (n, n).
        flat: Centred trajectories at them, (n, n_values).
        scales: Length scales to choose from.
    """
    best: tuple[float, Any] = (-np.inf, None)
    inner = flat @ flat.T  # all that the likelihood needs of the values
    for scale in scales:
        factor = _factor(gaps, scale)
        variance = max(float(np.trace(cho_solve(factor, inner, check_finite=False))) / flat.size, 1e-12)
        likelihood = -len(gaps) * np.log(variance) - 2.0 * np.log(np.diag(factor[0])).sum()
        if likelihood > best[0]:
            best = (likelihood, (factor, scale, variance))
    return best[1]
