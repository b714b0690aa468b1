"""The paper's baseline: the trained memory alone, sampled on its grid; no reinforcement learning."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from creative_nao.agents.base import Agent, Context
from creative_nao.errors import SettingsError

RESOLUTION = 200
"""Grid points along each PB axis, evenly spaced over [-1, 1] (the paper's generation)."""


class SupervisedAgent(Agent):
    """Draws points uniformly, without replacement, from the 200 x 200 grid over [-1, 1]^2.

    The paper measures novelty and diversity on 30 trajectories drawn this way from the 40,000 that the network
    generates: what supervised training alone brings to light.
    """

    name: ClassVar[str] = "supervised"

    def start(self, context: Context) -> None:
        """Draw the cells of the whole episode at once.

        Raises:
            SettingsError: If the budget is larger than the grid.
        """
        if context.n_actions > RESOLUTION**2:
            raise SettingsError(
                f"`n_actions` should be at most {RESOLUTION**2}, the cells of the grid that agent `{self.name}` draws "
                f"from without replacement, but is {context.n_actions}"
            )
        self._cells = iter(context.rng.choice(RESOLUTION**2, size=context.n_actions, replace=False))

    def choose(self, observation: np.ndarray) -> np.ndarray:
        """Return the next cell drawn, shape (2,)."""
        axis = np.linspace(-1.0, 1.0, RESOLUTION)
        row, column = divmod(int(next(self._cells)), RESOLUTION)
        return np.array([axis[column], axis[row]])
