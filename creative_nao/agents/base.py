"""The one interface of all agents: `begin` an episode, then `ask` for a PB vector and `tell` what it earned, in turn.

The budget is counted in generated actions: one `ask` is one. The base class keeps the order and the budget, so that
every agent is judged at the same number of generated actions and a caller's slip is an error instead of a wrong figure.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from gymnasium.spaces import Box

from creative_nao.errors import CreativeNaoError, ShapeError


class AgentOrderError(CreativeNaoError, RuntimeError):
    """`begin`, `ask` and `tell` were called out of order, or beyond the budget."""


class LearnedMemory(Protocol):
    """What an agent may know of the robot's memory beforehand."""

    @property
    def pb(self) -> np.ndarray:
        """Learned PB values, shape (n_actions, 2), in (-1, 1)."""
        ...


@dataclass(frozen=True)
class Context:
    """What an agent is given at the start of an episode.

    Attributes:
        action_space: PB vectors it may choose: Box of shape (2,).
        observation_space: What `ask` receives.
        n_actions: The budget: how many actions may be generated.
        rng: Its only source of randomness.
        memory: The memory explored, for agents that legitimately know its learned PB vectors; None for the others.
    """

    action_space: Box
    observation_space: Box
    n_actions: int
    rng: np.random.Generator
    memory: LearnedMemory | None = None


class Agent(ABC):
    """Chooses PB vectors. A subclass defines `choose`, and where it keeps something, `start` and `learn`.

    Example:
        >>> agent.begin(context)                                    # doctest: +SKIP
        >>> pb = agent.ask(observation)                             # doctest: +SKIP
        >>> agent.tell(pb, observation, reward=0.7, info=info)      # doctest: +SKIP
    """

    name: ClassVar[str]
    learns_within_episode: ClassVar[bool] = False
    """Whether `tell` changes what `ask` returns later in the same episode."""

    _context: Context | None = None
    _n_asked = 0
    _waits_for_tell = False

    @property
    def context(self) -> Context:
        """The context of the running episode.

        Raises:
            AgentOrderError: If no episode has begun.
        """
        if self._context is None:
            raise AgentOrderError(f"agent `{self.name}`: no episode has begun; call `begin(context)` first")
        return self._context

    def begin(self, context: Context) -> None:
        """Start an episode; whatever the agent kept of the one before is gone, save what it learned in training."""
        self._context, self._n_asked, self._waits_for_tell = context, 0, False
        self.start(context)

    def ask(self, observation: np.ndarray) -> np.ndarray:
        """Return the next PB vector to generate.

        Args:
            observation: The environment's last observation, shape of `context.observation_space`.

        Returns:
            Shape (2,), float32, inside the action space.

        Raises:
            AgentOrderError: Before `begin`, when the last `ask` was not told, or when the budget is spent.
            ShapeError: If the agent chose something outside the action space.
        """
        context = self.context
        if self._waits_for_tell:
            raise AgentOrderError(
                f"agent `{self.name}`: `ask` was called twice; `tell` it first what action {self._n_asked} earned"
            )
        if self._n_asked >= context.n_actions:
            raise AgentOrderError(
                f"agent `{self.name}`: the budget of {context.n_actions} generated actions is spent; "
                "call `begin(context)` for another episode"
            )
        pb = np.asarray(self.choose(observation), dtype=np.float32)
        if not context.action_space.contains(pb):
            raise ShapeError(
                f"agent `{self.name}` should choose a PB vector inside {context.action_space}, but chose {pb.tolist()}"
            )
        self._n_asked += 1
        self._waits_for_tell = True
        return pb

    def tell(self, pb: np.ndarray, observation: np.ndarray, reward: float, info: Mapping[str, Any]) -> None:
        """Say what the PB vector last asked for earned.

        Args:
            pb: The PB vector generated, shape (2,).
            observation: The observation that followed.
            reward: Its reward.
            info: The environment's terms of the step.

        Raises:
            AgentOrderError: If there was no `ask` to answer.
        """
        if not self._waits_for_tell:
            raise AgentOrderError(f"agent `{self.name}`: `tell` has no `ask` before it; call `ask(observation)` first")
        self._waits_for_tell = False
        self.learn(pb, observation, reward, info)

    def start(self, context: Context) -> None:  # noqa: B027 - optional
        """Prepare for an episode; nothing to prepare unless a subclass says so."""

    @abstractmethod
    def choose(self, observation: np.ndarray) -> np.ndarray:
        """Return the next PB vector, shape (2,)."""

    def learn(  # noqa: B027 - optional
        self, pb: np.ndarray, observation: np.ndarray, reward: float, info: Mapping[str, Any]
    ) -> None:
        """Take in what a PB vector earned; ignored unless a subclass says otherwise."""
