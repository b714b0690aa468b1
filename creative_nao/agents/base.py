"""The one interface of all agents: `begin` an episode, then `ask` for a PB vector and `tell` what it earned, in turn.

The budget is counted in generated actions: one `ask` is one. The base class keeps the order and the budget, so that
every agent is judged at the same number of generated actions and a caller's slip is an error instead of a wrong figure.
`MovementAgent` and `BatchSearch` are what the searches build on; `PolicyAgent` plays a policy of Stable-Baselines3.
"""

from __future__ import annotations

import importlib
import importlib.util
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import numpy as np
from gymnasium.spaces import Box

from creative_nao.errors import CreativeNaoError, MissingDependencyError, SettingsError, ShapeError, shown

T = TypeVar("T")


class AgentOrderError(CreativeNaoError, RuntimeError):
    """`begin`, `ask` and `tell` were called out of order, or beyond the budget."""


@dataclass(frozen=True)
class Context:
    """What an agent is given at the start of an episode.

    Attributes:
        action_space: PB vectors it may choose: Box of shape (2,).
        observation_space: What `ask` receives.
        n_actions: The budget: how many actions may be generated.
        rng: Its only source of randomness.
        memory: The memory explored, for agents that legitimately know its learned PB vectors (`pb`, shape
            (n_actions, 2), in (-1, 1)); None for the others.
    """

    action_space: Box
    observation_space: Box
    n_actions: int
    rng: np.random.Generator
    memory: Any = None


class Agent(ABC):
    """Chooses PB vectors. A subclass defines `choose`, and where it keeps something, `start` and `learn`."""

    name: ClassVar[str]
    learns_within_episode: ClassVar[bool] = False
    """Whether `tell` changes what `ask` returns later in the same episode."""
    n_actions_training: int = 0
    """Actions generated before it plays, in its training; results list them. A policy or function may have it too."""

    _context: Context | None = None
    _n_asked = 0
    _waits_for_tell = False

    def __repr__(self) -> str:
        settings = getattr(self, "settings", None)
        return f"{type(self).__name__}({'' if settings is None else repr(settings)}) named `{self.name}`"

    @property
    def context(self) -> Context:
        """The context of the running episode; `AgentOrderError` if none has begun."""
        if self._context is None:
            raise AgentOrderError(f"agent `{self.name}`: no episode has begun; call `begin(context)` first")
        return self._context

    def begin(self, context: Context) -> None:
        """Start an episode; whatever the agent kept of the one before is gone, save what it learned in training."""
        self._context, self._n_asked, self._waits_for_tell = check_kind(context, Context, "context"), 0, False
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
        chosen = self.choose(observation)
        try:
            pb = None if isinstance(chosen, np.ma.MaskedArray) else np.asarray(chosen, dtype=np.float32)
        except (TypeError, ValueError):
            pb = None
        if pb is None or not context.action_space.contains(pb):
            raise ShapeError(
                f"agent `{self.name}` should choose a PB vector inside {context.action_space}, but chose "
                f"{shown(chosen if pb is None else pb.tolist())}"
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


class MovementAgent(Agent, Generic[T]):
    """Chooses one PB vector for each movement. A subclass defines `next_pb`, and `learn_movement` where it learns.

    Where a movement takes several decisions (`CreativeNao/BoxingModulation-v0`), the PB vector is held until the
    movement is scored, so that every reward belongs to one point of the PB space.

    Args:
        settings: Of the class `settings_type`; None takes the default ones.

    Raises:
        SettingsError: If they are those of another agent.
        MissingDependencyError: If the package that searches is not installed.
    """

    settings_type: ClassVar[type[Any]]
    package: ClassVar[str] = ""
    """The package that searches, and our extra that installs it."""
    extra: ClassVar[str] = ""

    def __init__(self, settings: T | None = None):
        if self.package and importlib.util.find_spec(self.package) is None:
            raise _missing(self.package, self.extra, self.name, "it is not installed")
        self.settings: T = check_kind(
            self.settings_type() if settings is None else settings, self.settings_type, "settings"
        )

    def load_package(self) -> ModuleType:
        """Return the package that searches."""
        return load_extra(self.package, self.extra, self.name)

    def start(self, context: Context) -> None:
        """Forget the PB vector held; a subclass calls this before it prepares anything else."""
        self._held: np.ndarray | None = None

    def choose(self, observation: np.ndarray) -> np.ndarray:
        """Return the PB vector of the movement, shape (n_pb,)."""
        if self._held is None:
            self._held = self.next_pb()
        return self._held

    def learn(self, pb: np.ndarray, observation: np.ndarray, reward: float, info: Mapping[str, Any]) -> None:
        """Learn from a movement that has ended; before its last tick `info` has a `tick` and no `outcome`."""
        if "tick" in info and "outcome" not in info:
            return
        self._held = None
        self.learn_movement(reward, info)

    @abstractmethod
    def next_pb(self) -> np.ndarray:
        """Return the PB vector of the next movement, shape (n_pb,)."""

    def learn_movement(self, reward: float, info: Mapping[str, Any]) -> None:
        """Take in what the last movement earned; ignored unless a subclass says otherwise."""


class BatchSearch(MovementAgent[T]):
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

    def learn_movement(self, reward: float, info: Mapping[str, Any]) -> None:
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
        if not callable(getattr(policy, "predict", None)):
            raise SettingsError(f"`policy` should have a method `predict`, but is {shown(policy)}")
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


def check_kind(value: Any, kind: type[T], name: str) -> T:
    """Return an argument that has to be of a class; else a `SettingsError` names it."""
    if not isinstance(value, kind):
        raise SettingsError(f"`{name}` should be of the class {kind.__name__}, but is {shown(value)}")
    return value


def load_extra(package: str, extra: str, agent: str) -> ModuleType:
    """Import an optional package, or raise a `MissingDependencyError` that names package and extra."""
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise _missing(package, extra, agent, error) from error


def _missing(package: str, extra: str, agent: str, why: object) -> MissingDependencyError:
    return MissingDependencyError(
        f'agent `{agent}` needs the package `{package}`: pip install "creative-nao[{extra}]" ({why})'
    )
