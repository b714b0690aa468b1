"""Imagining before performing: any agent can look at k movements and perform the most novel; `plan` keeps them all."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import numpy as np
from gymnasium.spaces import Box

from creative_nao.agents.base import Agent, Context, MovementAgent, check_kind
from creative_nao.agents.black_box import RandomAgent, sobol_points, uniform_points
from creative_nao.agents.body_sense import shipped_sense
from creative_nao.envs import Track
from creative_nao.envs.rollout import held_in_turn
from creative_nao.errors import SettingsError
from creative_nao.measures import dtw_matrix
from creative_nao.measures.outcome import PHYSICAL_FAULTS
from creative_nao.schema import Count, Field, Index, Positive, UnitInterval, checked, record

S = TypeVar("S")


@record
class RehearsalSettings:
    """How much is imagined before a movement is performed."""

    n_candidates: Annotated[int, Field(ge=1, le=100_000)] = 8
    """Movements looked at for each one performed. With 1, what is proposed is performed and nothing is imagined."""
    n_with_body: Index = 0
    """So many of them are kept to imagine the best with the body, one after another until it refuses none."""

    def __post_init__(self) -> None:
        if self.n_with_body >= self.n_candidates:
            raise SettingsError(f"`n_with_body` should be below `n_candidates` {self.n_candidates}")


class Rehearsal(MovementAgent[RehearsalSettings]):
    """Imagines proposals of an agent and performs the farthest from everything known: mental simulation.

    The agent inside is told what became of each imagined movement as if it had been performed, so that one that
    learns within an episode learns from what it imagines. A policy sees the observation of what was performed.

    Args:
        agent: Proposes movements.
        settings: How many it looks at.
        name: Under which results list it; None takes the agent's with `@` and the number of candidates.
    """

    name: ClassVar[str] = "rehearsal"
    learns_within_episode: ClassVar[bool] = True
    settings_type = RehearsalSettings

    def __init__(self, agent: Agent, settings: RehearsalSettings | None = None, *, name: str | None = None):
        super().__init__(settings)
        self.agent = check_kind(agent, Agent, "agent")
        self.n_candidates = self.settings.n_candidates
        self.track = agent.track  # pyright: ignore[reportAttributeAccessIssue]
        self.name = name or f"{agent.name}@{self.n_candidates}"  # pyright: ignore[reportAttributeAccessIssue]

    def start(self, context: Context) -> None:
        """Begin an episode of the agent inside, which may propose `n_candidates` movements for each performed."""
        super().start(context)
        self.agent.begin(replace(context, n_actions=context.n_actions * self.n_candidates))

    def choose(self, observation: np.ndarray) -> np.ndarray:
        """Return the PB vector of the movement, shape (n_pb,)."""
        self._observation = observation
        return super().choose(observation)

    def next_pb(self) -> np.ndarray:
        """Imagine, and return the PB vector of the best movement, shape (n_pb,)."""
        if self.n_candidates == 1:
            return self.agent.ask(self._observation)
        n_with_body = self.settings.n_with_body
        found = self.agent.look_ahead(self._observation, self.n_candidates - n_with_body)
        ranked = sorted(found, key=lambda one: -one[1]["reward"])  # stable: of equal ones the first
        for pb, _ in ranked[:n_with_body]:
            (info,) = self.context.imagine(pb, with_body=True)
            if info["appropriate"]:
                return pb
        return ranked[min(n_with_body, len(ranked) - 1)][0]

    def learn(self, pb: np.ndarray, observation: np.ndarray, reward: float, info: Mapping[str, Any]) -> None:
        """Tell the agent inside which movement was performed, where one has ended."""
        super().learn(pb, observation, reward, info)
        if self._held is None:
            tell = self.agent.tell if self.n_candidates == 1 else self.agent.learn_performed
            tell(pb, observation, reward, info)


class ImagineAgent(Rehearsal):
    """Imagines uniformly drawn movements and performs the one farthest from everything known."""

    name: ClassVar[str] = "imagine"

    def __init__(self, settings: RehearsalSettings | None = None, *, name: str | None = None):
        super().__init__(RandomAgent(), settings, name=name or self.name)


class ImagineWithBodyAgent(ImagineAgent):
    """Imagines uniformly drawn movements, then the best with the body, and performs the first that it can do."""

    name: ClassVar[str] = "imagine_with_body"

    def __init__(self, settings: RehearsalSettings | None = None, *, name: str | None = None):
        super().__init__(RehearsalSettings(n_candidates=16, n_with_body=8) if settings is None else settings, name=name)


@record
class BodySettings:
    """How a planning agent heeds the body, where the robot performs in physics."""

    use: Literal["none", "sense", "simulate", "both"] = "none"
    """`sense`: weigh each movement by the probability that the body accepts it (`BodySense`); `simulate`: imagine the
    best with the body, one after another until it accepts one."""
    n_simulated: Count = 8
    """Most movements that are imagined with the body before each one performed: they count as imagined, and cost a
    simulation of the physics each."""
    refused_scale: Positive = 10.0
    """Distance [rad] from a refused movement at which the probability that another is accepted has 63 % left."""


class PlanningAgent(MovementAgent[S]):
    """Keeps every movement that it imagines and performs the one farthest from what is known by then.

    A subclass says where to imagine in `where`, and what to perform without imagining in `untried`. `first_share` of
    the budget is imagined, evenly spread (Sobol), before the first movement, the rest in equal parts before each.
    Where the robot performs in physics, `body` tells how the agent heeds what the body may refuse.
    Where a movement takes several decisions, it may be of `n_segments` PB vectors, held in turn
    (`envs.rollout.held_in_turn`); a point is then all of them, n_segments * n_pb values.
    """

    body: BodySettings = BodySettings()
    n_segments: int = 1

    learns_within_episode: ClassVar[bool] = True
    imagines: ClassVar[bool] = True
    track = Track.TRAJECTORIES

    def start(self, context: Context) -> None:
        """Imagine the first share."""
        super().start(context)
        if self.n_segments > context.n_decisions:
            told = f"{self.n_segments} PB vectors, but decisions of a movement here: {context.n_decisions}"
            raise SettingsError(f"agent `{self.name}` holds in turn {told}; in CreativeNao/BoxingModulation-v0: 10")
        self._known = list(context.demonstrations.trajectories)
        self._n_left = context.n_actions // context.n_decisions
        use = self.body.use if context.physics else "none"
        self._sense = shipped_sense() if use in ("sense", "both") else None
        self._n_simulated = self.body.n_simulated if use in ("simulate", "both") else 0
        self._heeds_body = use != "none"
        self._refused: list[np.ndarray] = []
        self._pool_pb: list[np.ndarray] = []
        self._pool: list[np.ndarray] = []
        self._distances = self._accepted = np.empty(0)
        n_first = round(self.first_share() * context.n_imagined_left)
        space, n = context.action_space, self.n_segments
        self._point_context = replace(context, action_space=Box(np.tile(space.low, n), np.tile(space.high, n)))
        self._spread = iter(sobol_points(self._point_context, max(n_first, self._n_left)))
        if n_first:
            self.imagine(np.array([next(self._spread) for _ in range(n_first)]))

    def first_share(self) -> float:
        """Return the part of the budget that is imagined before the first movement: a setting."""
        return self.settings.first_share  # pyright: ignore[reportAttributeAccessIssue]

    def choose(self, observation: np.ndarray) -> np.ndarray:
        """Return the PB vector of the movement, or of this decision in it, shape (n_pb,)."""
        held = super().choose(observation)
        return held if self.n_segments == 1 else self.path(held[None])[0, self._n_asked % self.context.n_decisions]

    def path(self, points: np.ndarray) -> np.ndarray:
        """Return points (n, n_segments * n_pb) as `Context.imagine` takes them."""
        return points if self.n_segments == 1 else held_in_turn(points, self.n_segments, self.context.n_decisions)

    def accepted(self, moves: Sequence[np.ndarray]) -> np.ndarray:
        """Return how likely the body accepts movements (n, n_steps, n_joints), (n,); 1 where it takes no part."""
        chance = np.ones(len(moves))
        if self._sense is not None:
            chance *= 1.0 - self._sense.refusal(np.asarray(moves), self.context.demonstrations.dt_s)
        return chance * self._unlike(moves, self._refused)

    def _unlike(self, moves: Sequence[np.ndarray], refused: Sequence[np.ndarray]) -> np.ndarray:
        """Return the factor by which refused movements make similar ones (n, n_steps, n_joints) less likely, (n,)."""
        if not len(refused) or not len(moves):
            return np.ones(len(moves))
        return (-np.expm1(-(dtw_matrix(moves, refused) + 1e-9) / self.body.refused_scale)).prod(axis=1)

    def imagine(self, points: np.ndarray) -> None:
        """Imagine movements, shape (n, n_pb), and keep those that are appropriate."""
        found = [*zip(points, self.context.imagine(self.path(points)), strict=True)]
        for pb, info in found:
            self.learn_imagined(pb, info)
        kept = [(pb, info["trajectory"]) for pb, info in found if info["appropriate"]]
        if kept:
            moves = [move for _, move in kept]
            self._pool_pb += [pb for pb, _ in kept]
            self._pool += moves
            self._distances = np.concatenate([self._distances, dtw_matrix(moves, self._known).min(axis=1)])
            self._accepted = np.concatenate([self._accepted, self.accepted(moves)])

    def best(self) -> int | None:
        """Return the place of the movement kept that is worth most, None if none is left."""
        worth = self._distances * self._accepted
        place = int(worth.argmax()) if len(worth) else 0
        return place if len(worth) and np.isfinite(worth[place]) and worth[place] >= 0.0 else None

    def next_pb(self) -> np.ndarray:
        """Imagine a part of the budget, and return the PB vector of the movement that is worth most."""
        self._is_imagined = False
        n = self.context.n_imagined_left // self._n_left
        n_simulated = min(self._n_simulated, max(n - 1, 0))
        if n:
            self.imagine(self.where(n - n_simulated))
        for n_left in range(n_simulated, -1, -1):
            if (place := self.best()) is None:
                break
            self._distances[place] = -np.inf  # performed once, or refused
            pb = self._pool_pb[place]
            if not n_left or self.context.imagine(self.path(pb[None]), with_body=True)[0]["appropriate"]:
                self._is_imagined = True
                return pb
            self.refuse(self._pool[place])
        return self.untried()

    def refuse(self, move: np.ndarray) -> None:
        """Take in that the body has refused a movement (n_steps, n_joints): similar ones are less likely to succeed."""
        self._refused.append(move)
        self._accepted = self._accepted * self._unlike(self._pool, [move])

    def learn(self, pb: np.ndarray, observation: np.ndarray, reward: float, info: Mapping[str, Any]) -> None:
        """Take in a movement that has ended: an appropriate one is known from now on."""
        pb = pb if self.n_segments == 1 or self._held is None else self._held
        super().learn(pb, observation, reward, info)
        if self._held is not None:
            return
        self._n_left -= 1
        if not (self._is_imagined and info["appropriate"]):  # else nothing new
            self.learn_imagined(np.asarray(pb, np.float64), info)
        if info["appropriate"]:
            self._known.append(np.asarray(info["trajectory"]))
            if self._pool:
                self._distances = np.minimum(self._distances, dtw_matrix(self._pool, self._known[-1:])[:, 0])
        elif self._heeds_body and info["outcome"] in PHYSICAL_FAULTS:
            self.refuse(np.asarray(info["commanded"]))

    def around_best(self, n: int, sigma: float) -> np.ndarray:
        """Draw points normally distributed around the movement kept that is worth most, shape (n, n_pb)."""
        space = self._point_context.action_space
        best = self._pool_pb[int((self._distances * self._accepted).argmax())]
        return np.clip(best + self.context.rng.normal(0.0, sigma, (n, *space.shape)), space.low, space.high)

    @abstractmethod
    def where(self, n: int) -> np.ndarray:
        """Return where to imagine next, shape (n, n_pb)."""

    def untried(self) -> np.ndarray:
        """Return what to perform where nothing was imagined, shape (n_pb,)."""
        return next(self._spread)

    def learn_imagined(self, pb: np.ndarray, info: Mapping[str, Any]) -> None:
        """Take in a movement, imagined or performed; ignored unless a subclass says otherwise."""


@record
class PlanSettings:
    """When and where the planner imagines."""

    first_share: UnitInterval = 0.5
    """Part of the budget that is imagined, evenly spread, before the first movement is performed."""
    sigma: Positive = 0.2
    """Standard deviation of the later points around the best one imagined, in each PB unit; the square is 2 wide."""


class PlanAgent(PlanningAgent[PlanSettings]):
    """Imagines half of its budget first, evenly spread, the rest around the best so far; performs the farthest of all.

    Without imagining it plays a Sobol sequence.
    """

    name: ClassVar[str] = "plan"
    settings_type = PlanSettings

    def where(self, n: int) -> np.ndarray:
        """Draw points around the best movement imagined and not yet performed, shape (n, n_pb)."""
        return self.around_best(n, self.settings.sigma) if self._pool else uniform_points(self._point_context, n)


class PlanModulatedAgent(PlanAgent):
    """Plans movements of five PB vectors, held in turn; it needs an environment in which the PB may change."""

    name: ClassVar[str] = "plan_modulated"
    n_segments = 5


class PlanWithSenseAgent(PlanAgent):
    """Plans, and weighs each movement by the learned probability that the body accepts it (`BodySense`)."""

    name: ClassVar[str] = "plan_with_sense"
    body = BodySettings("sense")


class PlanWithBodyAgent(PlanAgent):
    """Plans with the body sense, imagines the best movements with the body too, and performs the first it accepts."""

    name: ClassVar[str] = "plan_with_body"
    body = BodySettings("both")


def rehearse(agent: Agent, n_candidates: int) -> Agent:
    """Return an agent that imagines `n_candidates` proposals for each movement and performs the most novel one.

    One that imagines by itself (`imagines`) is given this budget instead. The name tells it, as `spread@8`.

    Example:
        >>> from creative_nao.agents import SpreadAgent
        >>> rehearse(SpreadAgent(), 8).name
        'spread@8'
    """
    n_candidates = checked(Count, n_candidates, "n_candidates")
    name = f"{check_kind(agent, Agent, 'agent').name}@{n_candidates}"
    if isinstance(agent, Rehearsal):
        settings = replace(agent.settings, n_candidates=n_candidates)
        kind: Any = type(agent)
        return kind(settings, name=name) if isinstance(agent, ImagineAgent) else Rehearsal(agent.agent, settings)
    if not agent.imagines:
        return Rehearsal(agent, RehearsalSettings(n_candidates))
    agent.n_candidates = n_candidates
    agent.name = name  # pyright: ignore[reportAttributeAccessIssue]
    return agent
