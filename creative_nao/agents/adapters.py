"""Between our ask and tell, the `predict` of Stable-Baselines3 and plain functions: each can be entered as an agent."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, Protocol

import numpy as np

from creative_nao.agents.base import Agent, Context
from creative_nao.errors import SettingsError


class Policy(Protocol):
    """Anything with the `predict` of Stable-Baselines3."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[np.ndarray, Any]:
        """Return actions for observations, and the state to hand in next time."""
        ...


class PolicyAgent(Agent):
    """Plays a policy as an agent.

    Args:
        policy: Anything with `predict`.
        deterministic: Take the policy's most likely action, or draw from its distribution.
        name: Under which results list it.
    """

    name: ClassVar[str] = "policy"

    def __init__(self, policy: Policy, *, deterministic: bool = True, name: str | None = None):
        self.policy = policy
        self.deterministic = deterministic
        if name is not None:
            self.name = name  # pyright: ignore[reportAttributeAccessIssue]

    def start(self, context: Context) -> None:
        """Forget the policy's state of the episode before."""
        self._state: Any = None
        self._first = True

    def choose(self, observation: np.ndarray) -> np.ndarray:
        """Return the policy's action, shape (2,)."""
        episode_start = np.array([self._first])
        self._first = False
        if self.deterministic:
            action, self._state = self.policy.predict(observation, self._state, episode_start, deterministic=True)
            return action
        import torch

        # Policies of Stable-Baselines3 draw from torch's global generator; the episode's own one must decide.
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(int(self.context.rng.integers(2**63)))
            action, self._state = self.policy.predict(observation, self._state, episode_start, deterministic=False)
        return action


class FunctionAgent(Agent):
    """Plays a plain function as an agent.

    Args:
        function: Takes the observation and returns a PB vector, shape (n_pb,), inside the action space. It is told
            nothing else; what it draws at random it has to seed itself.
        name: Under which results list it.

    Example:
        >>> agent = FunctionAgent(lambda observation: -observation[:2], name="opposite")
    """

    name: ClassVar[str] = "function"

    def __init__(self, function: Callable[[np.ndarray], Any], *, name: str | None = None):
        self.function = function
        if name is not None:
            self.name = name  # pyright: ignore[reportAttributeAccessIssue]

    def choose(self, observation: np.ndarray) -> np.ndarray:
        """Return what the function says, shape (n_pb,)."""
        return np.asarray(self.function(observation))


def as_agent(entered: Any, *, name: str | None = None) -> Agent:
    """Return anything that can choose PB vectors as an agent.

    Args:
        entered: An `Agent`, anything with the `predict` of Stable-Baselines3, or a function from observations to PB
            vectors.
        name: Under which results list it; default: its own.

    Raises:
        SettingsError: If it is none of these.
    """
    if isinstance(entered, Agent):
        if name is not None:
            entered.name = name  # pyright: ignore[reportAttributeAccessIssue]
        return entered
    if callable(getattr(entered, "predict", None)):
        return PolicyAgent(entered, name=name)
    if callable(entered) and not isinstance(entered, type):
        return FunctionAgent(entered, name=name)
    raise SettingsError(
        f"an agent should be an `Agent`, an object with `predict` or a function from observations to PB vectors, "
        f"but is {entered!r}"
    )


class AgentPolicy:
    """Gives an agent the `predict` of Stable-Baselines3, for one observation or a batch of them.

    `predict` never hears of rewards, so only agents that do not learn within an episode can be entered.

    Args:
        make_agent: Makes one agent; a batch of n observations uses n of them.
        make_context: Makes the context of each episode.

    Raises:
        SettingsError: If the agent learns within an episode.

    Example:
        >>> policy = AgentPolicy(RandomAgent, lambda: context)      # doctest: +SKIP
        >>> action, state = policy.predict(observation)             # doctest: +SKIP
    """

    def __init__(self, make_agent: Callable[[], Agent], make_context: Callable[[], Context]):
        agent = make_agent()
        if agent.learns_within_episode:
            raise SettingsError(
                f"agent `{agent.name}` learns from rewards within an episode, which `predict` never receives; "
                "use its `ask` and `tell`"
            )
        self._make_agent, self._make_context = make_agent, make_context
        self._agents: list[Agent] = []
        self._left: list[int] = []

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | bool | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Return actions for observations.

        Args:
            observation: Shape (n_values,) or (n, n_values).
            state: Handed back unchanged; agents keep their own.
            episode_start: Shape (n,); where True, that agent begins a new episode. So it does when its budget is spent.
            deterministic: Ignored: an agent decides by itself what it draws.

        Returns:
            Actions of shape (2,) or (n, 2), and `state`.
        """
        observation = np.asarray(observation)
        batch = observation[None] if observation.ndim == 1 else observation
        if len(self._agents) != len(batch):
            self._agents, self._left = [self._make_agent() for _ in batch], [0] * len(batch)
        starts = np.broadcast_to(False if episode_start is None else episode_start, (len(batch),))
        actions = np.stack([self._one(place, row, bool(starts[place])) for place, row in enumerate(batch)])
        return (actions[0] if observation.ndim == 1 else actions), state

    def _one(self, place: int, observation: np.ndarray, start: bool) -> np.ndarray:
        agent = self._agents[place]
        if start or self._left[place] == 0:
            context = self._make_context()
            agent.begin(context)
            self._left[place] = context.n_actions
        pb = agent.ask(observation)
        self._left[place] -= 1
        agent.tell(pb, observation, float("nan"), {})
        return pb
