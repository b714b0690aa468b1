"""The one interface of all agents: `begin` an episode, then `ask` for a PB vector and `tell` what it earned, in turn.

Two budgets are counted: movements performed, one `ask` each, and movements imagined, by `context.imagine`. The base
class keeps the order, both budgets and the track, so that agents are judged at equal cost and knowledge and a caller's
slip is an error instead of a wrong figure.
`MovementAgent` and `BatchSearch` are what the searches build on; `PolicyAgent` plays a policy of Stable-Baselines3.
"""

from __future__ import annotations

import dataclasses
import importlib.util
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import numpy as np
from gymnasium.spaces import Box

from creative_nao.envs import Track
from creative_nao.errors import CreativeNaoError, SettingsError, ShapeError, load_extra, missing_extra, shown
from creative_nao.model.config import check_kind

T = TypeVar("T")


class AgentOrderError(CreativeNaoError, RuntimeError):
    """`begin`, `ask` and `tell` were called out of order, or beyond the budget."""


class Info(dict[str, Any]):
    """The terms of `info` that a track is told; asking for one that it is not told is a `SettingsError`."""

    def __missing__(self, term: str) -> Any:
        """Say which track is told this term."""
        if Track.OUTCOMES.visible({term: None}):
            raise KeyError(term)
        raise SettingsError(f'`info["{term}"]` is told from the track `trajectories` on: declare it as `track`')


class Imagination:
    """Imagines movements in the running episode, up to the budget `n_imagined`, and counts them in `n_used`.

    `imagine` takes PB vectors (n, n_pb) and whether the body takes part, and returns the terms of `info` of each.
    """

    def __init__(self, imagine: Callable[[np.ndarray, bool], Sequence[Mapping[str, Any]]] | None, n_imagined: int):
        self._imagine, self.n_imagined, self.n_used = imagine, n_imagined, 0

    def imagine(self, pb: np.ndarray, with_body: bool) -> Sequence[Mapping[str, Any]]:
        """Imagine the movements of PB vectors (n, n_pb); `AgentOrderError` beyond the budget, of which none is used."""
        if self.n_used + len(pb) > self.n_imagined:
            raise AgentOrderError(
                f"{len(pb)} more movements cannot be imagined: {self.n_used} of the budget of {self.n_imagined} "
                "are used in this episode"
            )
        if self._imagine is None:
            raise SettingsError("this environment cannot imagine movements: it has no method `imagine`")
        self.n_used += len(pb)
        return self._imagine(pb, with_body)


@dataclass(frozen=True)
class Context:
    """What an agent is given at the start of an episode; of what `memory` tells it keeps what its track is told.

    Attributes:
        action_space: PB vectors it may choose: Box of shape (n_pb,).
        observation_space: What `ask` receives.
        n_actions: The budget: how many times the agent may be asked, `n_decisions` times for each movement performed.
        rng: Its only source of randomness.
        memory: The memory explored; None on all tracks but `map`.
        imagination: Imagines movements and counts them; None where none may be imagined.
        points: The learned PB points of the basic actions, (n_basic, n_pb), in (-1, 1); None on the track `outcomes`.
        demonstrations: The basic actions themselves; None on `outcomes` and `points`.
        physics: Whether the robot performs movements in physics, where its body may refuse them.
    """

    action_space: Box
    observation_space: Box
    n_actions: int
    rng: np.random.Generator
    memory: Any = None
    imagination: Imagination | None = None
    points: np.ndarray | None = None
    demonstrations: Any = None
    track: Track = Track.MAP
    n_decisions: int = 1
    physics: bool = False

    @property
    def n_imagined_left(self) -> int:
        """How many movements may still be imagined in this episode."""
        return 0 if self.imagination is None else self.imagination.n_imagined - self.imagination.n_used

    def imagine(self, pb: np.ndarray, *, with_body: bool = False) -> list[Info]:
        """Imagine the movements of PB vectors: what would become of each if it were performed now.

        Nothing is performed and nothing joins the repertoire; each movement counts.

        Args:
            pb: Shape (n, n_pb), or (n_pb,) for one; where movements take several decisions also (n, n_decisions, n_pb).
            with_body: Imagine the robot performing it too, where the environment performs movements in physics.

        Returns:
            A mapping each, as `tell` receives them, with its `reward`, and `imagined` set.

        Raises:
            AgentOrderError: Beyond the budget.
            ShapeError: If `pb` has another shape or leaves the action space.
            SettingsError: If the environment cannot imagine.
        """
        points = np.atleast_2d(np.asarray(pb, np.float32))
        form, vectors = points.shape[1:-1], points.reshape(-1, points.shape[-1])
        if form not in ((), (self.n_decisions,)) or not all(self.action_space.contains(one) for one in vectors):
            raise ShapeError(f"`pb` should be PB vectors inside {self.action_space}, but is {shown(points.tolist())}")
        found = (self.imagination or Imagination(None, 0)).imagine(points, with_body)
        return [Info(self.track.visible({**info, "imagined": True})) for info in found]

    def within(self, track: str) -> Context:
        """Return this context with what agents of a track are told, and nothing else."""
        kept, memory = min(Track(track), self.track), self.memory
        points = getattr(memory, "pb", None) if self.points is None else self.points
        basic = getattr(memory, "demonstrations", None) if self.demonstrations is None else self.demonstrations
        return dataclasses.replace(
            self,
            track=kept,
            points=None if kept < Track.POINTS or points is None else np.array(points, np.float64),
            demonstrations=None if kept < Track.TRAJECTORIES else basic,
            memory=None if kept < Track.MAP else memory,
        )


class Agent(ABC):
    """Chooses PB vectors. A subclass defines `choose`, and where it keeps something, `start` and `learn`."""

    name: ClassVar[str]
    learns_within_episode: ClassVar[bool] = False
    """Whether `tell` changes what `ask` returns later in the same episode."""
    n_actions_training: int = 0
    """Actions generated before it plays, in its training; results list them. A policy or function may have it too."""
    track: str = Track.OUTCOMES
    """What it is told, a `creative_nao.envs.Track`: its context, `info` and observations hold nothing else."""
    imagines: ClassVar[bool] = False
    """Whether it calls `context.imagine` itself; `rehearse` imagines for the others."""
    n_candidates: int = 1
    """Movements that it may look at for each one that it performs; 1: none is imagined."""

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
        as_track(self.track, f"agent `{self.name}`: `track`")
        self._context = check_kind(context, Context, "context").within(self.track)
        self._n_asked, self._waits_for_tell = 0, False
        self.start(self._context)

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
        self.learn(pb, observation, reward, Info(self.context.track.visible(info)))

    def look_ahead(self, observation: np.ndarray, n: int) -> list[tuple[np.ndarray, Info]]:
        """Propose `n` PB vectors, imagine each before the next, and return them with what would become of them."""
        found = []
        for _ in range(n):
            pb = self.ask(observation)
            (info,) = self.context.imagine(pb)
            self.tell(pb, observation, float(info["reward"]), info)
            found.append((pb, info))
        return found

    def learn_performed(  # noqa: B027 - optional
        self, pb: np.ndarray, observation: np.ndarray, reward: float, info: Mapping[str, Any]
    ) -> None:
        """Take in which of the movements it looked ahead to was performed; ignored unless a subclass says otherwise."""

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
            raise missing_extra(self.package, self.extra, f"agent `{self.name}`", "it is not installed")
        self.settings: T = check_kind(
            self.settings_type() if settings is None else settings, self.settings_type, "settings"
        )

    def load_package(self) -> ModuleType:
        """Return the package that searches."""
        return load_extra(self.package, self.extra, f"agent `{self.name}`")

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
        deterministic: Take the policy's most likely action, or draw from its distribution. None: as the policy was
            judged, where it is a trained one of a bundle; else the most likely one.
        name: Under which results list it.
        track: What its observations tell. None: as the environment of its bundle; else `outcomes`.
    """

    name: ClassVar[str] = "policy"

    def __init__(
        self, policy: Policy, *, deterministic: bool | None = None, name: str | None = None, track: str | None = None
    ):
        if not callable(getattr(policy, "predict", None)):
            raise SettingsError(f"`policy` should have a method `predict`, but is {shown(policy)}")
        self.policy = policy
        judged = getattr(policy, "judged_deterministic", True)
        self.deterministic = bool(judged) if deterministic is None else deterministic
        self.track = as_track(getattr(policy, "track", Track.OUTCOMES) if track is None else track, "`track`")
        self.name = self.name if name is None else name  # pyright: ignore[reportAttributeAccessIssue]

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.policy!r}) named `{self.name}`, plays {self.way}"

    @property
    def way(self) -> str:
        """Which way it plays: its most likely actions, or drawn ones."""
        return "its most likely actions" if self.deterministic else "actions drawn from its distribution"

    def start(self, context: Context) -> None:
        """Forget the policy's state of the episode before."""
        self._state: Any = None
        self._first = True

    def look_ahead(self, observation: np.ndarray, n: int) -> list[tuple[np.ndarray, Info]]:
        """Propose the action that it would take, and then drawn ones, since its most likely one stays the same."""
        taken, judged, self.deterministic = super().look_ahead(observation, 1), self.deterministic, False
        drawn, self.deterministic = super().look_ahead(observation, n - 1), judged
        return [*taken, *drawn]

    def choose(self, observation: np.ndarray) -> np.ndarray:
        """Return the policy's action, shape (2,)."""
        episode_start, self._first = np.array([self._first]), False
        if self.deterministic:
            action, self._state = self.policy.predict(observation, self._state, episode_start, deterministic=True)
            return action
        import torch

        # Policies of Stable-Baselines3 draw from torch's global generator; the episode's own one must decide.
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(int(self.context.rng.integers(2**63)))
            action, self._state = self.policy.predict(observation, self._state, episode_start, deterministic=False)
        return action


def as_track(value: Any, name: str) -> Track:
    """Return a track given as text; anything else is a `SettingsError`."""
    try:
        return Track(value)
    except ValueError:
        raise SettingsError(f"{name} should be one of {', '.join(Track)}, but is {shown(value)}") from None
