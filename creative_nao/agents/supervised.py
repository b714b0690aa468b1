"""The paper's baseline: the trained memory alone, sampled on its grid; no reinforcement learning."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from creative_nao.agents.base import Agent, Context
from creative_nao.errors import SettingsError
from creative_nao.pb_space import PAPER_RESOLUTION, pb_grid


class SupervisedAgent(Agent):
    """Draws points uniformly, without replacement, from the 200 x 200 grid over [-1, 1]^2.

    The paper measures novelty and diversity on 30 trajectories drawn this way from the 40,000 that the network
    generates: what supervised training alone brings to light.
    """

    name: ClassVar[str] = "supervised"

    def start(self, context: Context) -> None:
        """Draw the points of the whole episode at once.

        Raises:
            SettingsError: If the budget is larger than the grid.
        """
        grid = pb_grid(PAPER_RESOLUTION)
        if context.n_actions > len(grid):
            raise SettingsError(
                f"`n_actions` should be at most {len(grid)}, the points of the grid that agent `{self.name}` draws "
                f"from without replacement, but is {context.n_actions}"
            )
        self._drawn = iter(grid[context.rng.choice(len(grid), size=context.n_actions, replace=False)])

    def choose(self, observation: np.ndarray) -> np.ndarray:
        """Return the next point drawn, shape (2,)."""
        return next(self._drawn)
