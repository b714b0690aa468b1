"""Agents that think in whole movements: one PB vector each, judged when the movement is scored."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np

from creative_nao.agents.base import Agent, Context


class MovementAgent(Agent):
    """Chooses one PB vector for each movement. A subclass defines `next_pb`, and `judge` where it learns.

    Where a movement takes several decisions (`CreativeNao/BoxingModulation-v0`), the PB vector is held until the
    movement is scored, so that every reward belongs to one point of the PB space.
    """

    def start(self, context: Context) -> None:
        """Forget the PB vector held; a subclass calls this before it prepares anything else."""
        self._held: np.ndarray | None = None

    def choose(self, observation: np.ndarray) -> np.ndarray:
        """Return the PB vector of the movement, shape (n_pb,)."""
        if self._held is None:
            self._held = self.next_pb()
        return self._held

    def learn(self, pb: np.ndarray, observation: np.ndarray, reward: float, info: Mapping[str, Any]) -> None:
        """Judge the movement if it has ended: while it unfolds, `info` tells its tick and no outcome yet."""
        if "tick" in info and "outcome" not in info:
            return
        self._held = None
        self.judge(reward, info)

    @abstractmethod
    def next_pb(self) -> np.ndarray:
        """Return the PB vector of the next movement, shape (n_pb,)."""

    def judge(self, reward: float, info: Mapping[str, Any]) -> None:
        """Take in what the last movement earned; ignored unless a subclass says otherwise."""
