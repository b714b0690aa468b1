"""Random search: the floor that every search must beat."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from creative_nao.agents.base import Agent


class RandomAgent(Agent):
    """Draws PB vectors uniformly from the square, whatever happened before."""

    name: ClassVar[str] = "random"

    def choose(self, observation: np.ndarray) -> np.ndarray:
        """Return a point of the action space, shape (2,)."""
        space = self.context.action_space
        return self.context.rng.uniform(space.low, space.high)
