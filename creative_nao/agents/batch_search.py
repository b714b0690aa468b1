"""Searches that propose a batch of PB vectors and want all its results together."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from creative_nao.agents.base import Context
from creative_nao.agents.movement import MovementAgent


class BatchSearch(MovementAgent):
    """Asks its search for a batch, hands it out one by one and gives the rewards back when all are known.

    A subclass defines `prepare`, `propose` and `receive`, and `describe` where its search reads more than rewards.
    """

    learns_within_episode: ClassVar[bool] = True

    def start(self, context: Context) -> None:
        """Begin with an empty search."""
        super().start(context)
        self._batch: np.ndarray = np.empty((0, 0))
        self._rewards: list[float] = []
        self._descriptors: list[np.ndarray] = []
        # The packages behind take whole numbers as seeds; the episode's generator decides them.
        self.prepare(context, int(context.rng.integers(2**31)))

    def next_pb(self) -> np.ndarray:
        """Return the next PB vector of the batch, shape (n_pb,)."""
        if len(self._rewards) == len(self._batch):
            self._batch, self._rewards, self._descriptors = np.asarray(self.propose(), np.float64), [], []
        return self._batch[len(self._rewards)]

    def judge(self, reward: float, info: Mapping[str, Any]) -> None:
        """Keep a result; hand the batch back when it is complete."""
        self._rewards.append(reward)
        self._descriptors.append(self.describe(info))
        if len(self._rewards) == len(self._batch):
            self.receive(self._batch, np.array(self._rewards), np.array(self._descriptors))

    @abstractmethod
    def prepare(self, context: Context, seed: int) -> None:
        """Set the search up for an episode; `seed` is its only source of randomness beside `context.rng`."""

    @abstractmethod
    def propose(self) -> np.ndarray:
        """Return a batch of PB vectors, shape (n, n_pb)."""

    @abstractmethod
    def receive(self, pb: np.ndarray, rewards: np.ndarray, descriptors: np.ndarray) -> None:
        """Take in the batch (n, n_pb), what it earned (n,) and how it behaved (n, n_descriptor)."""

    def describe(self, info: Mapping[str, Any]) -> np.ndarray:
        """Return the descriptor of a movement; empty unless a subclass has one."""
        return np.empty(0)
