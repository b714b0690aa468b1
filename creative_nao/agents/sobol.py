"""Points that fill the PB space evenly, in an order that is even at every length."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from creative_nao.agents.base import Agent, Context


class SobolAgent(Agent):
    """Plays a scrambled Sobol sequence over the action space, whatever happened before.

    The floor for everything that only spreads its points: unlike random ones they leave no holes. Owen's scrambling
    (scipy's `qmc.Sobol`) is drawn from the episode's generator.
    """

    name: ClassVar[str] = "sobol"

    def start(self, context: Context) -> None:
        """Draw the sequence."""
        from scipy.stats import qmc

        space = context.action_space
        sequence = qmc.Sobol(space.shape[0], scramble=True, rng=context.rng)
        # A whole power of two keeps the balance of the sequence; what the budget does not reach is left.
        points = sequence.random_base2(max(context.n_actions - 1, 1).bit_length())
        self._points = iter(space.low + points * (space.high - space.low))

    def choose(self, observation: np.ndarray) -> np.ndarray:
        """Return the next point of the sequence, shape (n_pb,)."""
        return next(self._points)
