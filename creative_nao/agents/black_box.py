"""Agents that know nothing of behaviour: points drawn or spread, what was taught, CMA-ES, Bayesian optimisation.

The floor is random points; the ceiling is the oracle, which has computed the whole map before it chooses.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Annotated, Any, ClassVar

import numpy as np
from gymnasium.spaces import Box

from creative_nao.agents.base import Agent, BatchSearch, Context, MovementAgent
from creative_nao.errors import SettingsError
from creative_nao.maps import PAPER_RESOLUTION, PBMap, pb_grid, pb_map
from creative_nao.measures import farthest_points, score
from creative_nao.measures.outcome import APPROPRIATE
from creative_nao.schema import Count, Field, NonNegative, Positive, record


class RandomAgent(Agent):
    """Draws PB vectors uniformly from the square, whatever happened before."""

    name: ClassVar[str] = "random"

    def choose(self, observation: np.ndarray) -> np.ndarray:
        """Return a point of the action space, shape (2,)."""
        space = self.context.action_space
        return self.context.rng.uniform(space.low, space.high)


class SobolAgent(Agent):
    """Plays a scrambled Sobol sequence over the action space, whatever happened before.

    The floor for everything that only spreads its points: unlike random ones they leave no holes. Owen's scrambling
    (scipy's `qmc.Sobol`) is drawn from the episode's generator.
    """

    name: ClassVar[str] = "sobol"

    def start(self, context: Context) -> None:
        """Draw the sequence."""
        self._points = iter(sobol_points(context, context.n_actions))

    def choose(self, observation: np.ndarray) -> np.ndarray:
        """Return the next point of the sequence, shape (n_pb,)."""
        return next(self._points)


class SupervisedAgent(Agent):
    """Draws points uniformly, without replacement, from the 200 x 200 grid over [-1, 1]^2 (as many along further axes).

    The paper measures novelty and diversity on 30 trajectories drawn this way from the 40,000 that the network
    generates: what supervised training alone brings to light.
    """

    name: ClassVar[str] = "supervised"

    def start(self, context: Context) -> None:
        """Draw the points of the whole episode at once; a budget beyond the grid is a `SettingsError`."""
        grid, n_pb = pb_grid(PAPER_RESOLUTION), context.action_space.shape[0]
        if context.n_actions > len(grid):
            raise SettingsError(
                f"`n_actions` should be at most {len(grid)}, the points of the grid that agent `{self.name}` draws "
                f"from without replacement, but is {context.n_actions}"
            )
        if n_pb != 2:  # the grid of 200 points along each axis cannot be listed
            cells = context.rng.integers(PAPER_RESOLUTION, size=(context.n_actions, n_pb))
            self._drawn = iter(np.linspace(-1.0, 1.0, PAPER_RESOLUTION)[cells])
            return
        self._drawn = iter(grid[context.rng.choice(len(grid), size=context.n_actions, replace=False)])

    def choose(self, observation: np.ndarray) -> np.ndarray:
        """Return the next point drawn, shape (2,)."""
        return next(self._drawn)


class LatticeAgent(Agent):
    """Plays the cell centres of a lattice over the action space in random order, whatever happened before.

    The lattice is the one with nearly equal sides that has as many points as the budget, for 30 movements of two PB
    units 6 x 5, or the smallest that has more: then the points played are drawn from it. Which side is which is drawn
    as well.
    """

    name: ClassVar[str] = "lattice"

    def start(self, context: Context) -> None:
        """Lay out the lattice and draw the order."""
        rng, space = context.rng, context.action_space
        sides = rng.permutation(lattice_sides(context.n_actions, space.shape[0]))
        chosen = rng.choice(int(np.prod(sides)), size=context.n_actions, replace=False)
        cells = np.stack(np.unravel_index(chosen, sides), axis=-1)
        self._points = iter(space.low + (cells + 0.5) / sides * (space.high - space.low))

    def choose(self, observation: np.ndarray) -> np.ndarray:
        """Return the next point, shape (n_pb,)."""
        return next(self._points)


def lattice_sides(n_points: int, n_axes: int) -> np.ndarray:
    """Return the sides of the smallest lattice with at least `n_points` points and sides that differ by one at most.

    Example:
        >>> lattice_sides(30, 2).tolist(), lattice_sides(30, 4).tolist(), lattice_sides(100, 2).tolist()
        ([6, 5], [3, 3, 2, 2], [10, 10])
    """
    side = 1
    while (side + 1) ** n_axes < n_points:
        side += 1
    n_longer = next(n for n in range(n_axes + 1) if (side + 1) ** n * side ** (n_axes - n) >= n_points)
    return np.array([side + 1] * n_longer + [side] * (n_axes - n_longer))


@record
class SpreadSettings:
    """How the hand rule spreads its points."""

    n_drawn: Count = 256
    """Points drawn uniformly, of which the one farthest from all known ones is played."""
    failed_radius: NonNegative = 0.15
    """A point so close to one that failed counts as less far, per square root of a PB unit; the square is 2 wide."""
    failed_weight: Annotated[float, Field(ge=0.0, le=1.0)] = 0.1
    """Factor on the distance of such a point."""


class SpreadAgent(MovementAgent[SpreadSettings]):
    """The hand rule: of some random points the one farthest, in PB space, from all that were tried.

    A point next to one whose movement was inappropriate counts as less far.
    """

    name: ClassVar[str] = "spread"
    learns_within_episode: ClassVar[bool] = True
    settings_type = SpreadSettings

    def start(self, context: Context) -> None:
        """Begin with nothing tried."""
        super().start(context)
        self._known: list[np.ndarray] = []
        self._failed: list[np.ndarray] = []

    def next_pb(self) -> np.ndarray:
        """Return the farthest of the points drawn, shape (n_pb,)."""
        drawn, settings = uniform_points(self.context, self.settings.n_drawn), self.settings
        distances = nearest_distances(drawn, self._known)
        near_failed = nearest_distances(drawn, self._failed) < settings.failed_radius * np.sqrt(drawn.shape[1] / 2.0)
        return drawn[np.where(near_failed, settings.failed_weight * distances, distances).argmax()]

    def learn(self, pb: np.ndarray, observation: np.ndarray, reward: float, info: Mapping[str, Any]) -> None:
        """Keep the point where its movement has ended."""
        super().learn(pb, observation, reward, info)
        if self._held is None:
            self._known.append(np.asarray(pb, np.float64))
            if not info.get("appropriate", reward > 0.0):
                self._failed.append(self._known[-1])


class SpreadPointsAgent(SpreadAgent):
    """The hand rule that keeps away from the learned PB points too: what lies there has been taught."""

    name: ClassVar[str] = "spread_points"
    track = "points"

    def start(self, context: Context) -> None:
        """Begin with the learned points as if they had been tried."""
        super().start(context)
        self._known = [*learned_points(context, self.name)]


def sobol_points(context: Context, n: int) -> np.ndarray:
    """Return the first points of a Sobol sequence scrambled by the episode's generator, (n, n_pb)."""
    from scipy.stats import qmc

    space = context.action_space
    sequence = qmc.Sobol(space.shape[0], scramble=True, rng=context.rng)
    # A whole power of two keeps the balance of the sequence; what the budget does not reach is left.
    return space.low + sequence.random_base2(max(n - 1, 1).bit_length())[:n] * (space.high - space.low)


def uniform_points(context: Context, n: int) -> np.ndarray:
    """Draw PB vectors uniformly from the action space, shape (n, n_pb)."""
    space = context.action_space
    return context.rng.uniform(space.low, space.high, (n, *space.shape))


def nearest_distances(points: np.ndarray, known: Sequence[np.ndarray]) -> np.ndarray:
    """Return how far each of the points (n, n_pb) is from the nearest known one, (n,); infinite without any."""
    if not len(known):
        return np.full(len(points), np.inf)
    others = np.asarray(known)
    squares = (points**2).sum(axis=1)[:, None] + (others**2).sum(axis=1) - 2.0 * points @ others.T
    return np.sqrt(np.maximum(squares.min(axis=1), 0.0))


def learned_points(context: Context, agent: str) -> np.ndarray:
    """Return the learned PB points, (n_basic, n_pb); a context that tells none is a `SettingsError`."""
    if context.points is None:
        raise SettingsError(f"agent `{agent}` needs the learned PB points: the memory of the context should tell `pb`")
    return context.points


@record
class ReplaySettings:
    """How far replay strays."""

    spread: Positive = 0.1
    """Standard deviation of the steps away from a learned PB vector, in each PB unit; the square is 2 wide."""


class ReplayAgent(MovementAgent[ReplaySettings]):
    """Plays each learned PB vector once, then goes round them with a normal deviation, clipped to the space.

    What comes of doing what was taught, and of doing it inexactly. It needs a memory that tells its learned PB vectors.
    """

    name: ClassVar[str] = "replay"
    settings_type = ReplaySettings
    track = "points"

    def start(self, context: Context) -> None:
        """Read the learned PB vectors; a context without a memory is a `SettingsError`."""
        super().start(context)
        self._learned = learned_points(context, self.name)
        self._place = 0

    def next_pb(self) -> np.ndarray:
        """Return a learned PB vector or a point close to one, shape (n_pb,)."""
        turn, which = divmod(self._place, len(self._learned))
        self._place += 1
        space, pb = self.context.action_space, self._learned[which]
        if turn:
            pb = pb + self.context.rng.normal(0.0, self.settings.spread, pb.shape)
        return np.clip(pb, space.low, space.high)


@record
class CmaEsSettings:
    """How CMA-ES searches."""

    population_size: Annotated[int, Field(ge=4)] = 10
    """Movements between two updates of the distribution; of fewer than 4 no two are parents."""
    sigma: Positive = 0.8
    """First standard deviation, in each PB unit, around the centre of the space; the square is 2 wide."""


class CmaEsAgent(BatchSearch[CmaEsSettings]):
    """CMA-ES (Hansen 2016, arXiv:1604.00772) of the package `cmaes`, maximising the reward of a single action.

    What an action earns falls when something like it has joined the repertoire, so the optimum moves away from where
    the search has been: CMA-ES follows it.
    """

    name: ClassVar[str] = "cma_es"
    settings_type, package, extra = CmaEsSettings, "cmaes", "search"

    def prepare(self, context: Context, seed: int) -> None:
        """Set the distribution up."""
        low, high = context.action_space.low.astype(np.float64), context.action_space.high.astype(np.float64)
        self._search = self.load_package().CMA(
            mean=(low + high) / 2.0,
            sigma=self.settings.sigma,
            bounds=np.stack([low, high], axis=1),
            population_size=self.settings.population_size,
            seed=seed,
        )

    def propose(self) -> np.ndarray:
        """Draw a population, shape (population_size, n_pb)."""
        return np.stack([self._search.ask() for _ in range(self.settings.population_size)])

    def receive(self, pb: np.ndarray, rewards: np.ndarray, descriptors: np.ndarray) -> None:
        """Update the distribution; the package minimises."""
        self._search.tell([(point, -reward) for point, reward in zip(pb, rewards.tolist(), strict=True)])


@record
class BayesianSettings:
    """How Bayesian optimisation searches."""

    n_startup: Count = 15
    """Movements drawn uniformly before the Gaussian process decides."""


class BayesianAgent(MovementAgent[BayesianSettings]):
    """Bayesian optimisation by Optuna's `GPSampler`: Matern 5/2 kernel, logarithm of the expected improvement.

    It models what a single action earned when it was tried. A movement earns less once something like it has joined the
    repertoire, which the model takes for noise.
    """

    name: ClassVar[str] = "bayesian"
    learns_within_episode: ClassVar[bool] = True
    settings_type, package, extra = BayesianSettings, "optuna", "bayes"

    def start(self, context: Context) -> None:
        """Begin with an empty study."""
        super().start(context)
        self._optuna = self.load_package()
        space = context.action_space
        ends = zip(space.low.tolist(), space.high.tolist(), strict=True)
        uniform = self._optuna.distributions.FloatDistribution
        self._space = {f"pb_{place}": uniform(low, high) for place, (low, high) in enumerate(ends, 1)}
        with self._quiet():
            sampler = self._optuna.samplers.GPSampler(
                seed=int(context.rng.integers(2**31)), n_startup_trials=self.settings.n_startup
            )
            self._study = self._optuna.create_study(direction="maximize", sampler=sampler)

    def next_pb(self) -> np.ndarray:
        """Return the point with the largest expected improvement, shape (n_pb,)."""
        with self._quiet():
            self._trial = self._study.ask(self._space)
        return np.array([self._trial.params[name] for name in self._space])

    def learn_movement(self, reward: float, info: Mapping[str, Any]) -> None:
        """Add what the movement earned to the study."""
        with self._quiet():
            self._study.tell(self._trial, reward)

    @contextmanager
    def _quiet(self) -> Iterator[None]:
        """Keep Optuna's log lines out of progress displays, and its verbosity as its user left it."""
        logging = self._optuna.logging
        before = logging.get_verbosity()
        logging.set_verbosity(logging.WARNING)
        try:
            yield
        finally:
            logging.set_verbosity(before)


@record
class OracleSettings:
    """How much the oracle computes beforehand."""

    resolution: Annotated[int, Field(ge=2)] = PAPER_RESOLUTION
    """Points along each axis of the map; 200 are 40,000 generated movements that no other agent is granted."""
    n_planned: Count = 30
    """Choices worked out at a time; the next ones follow when they are needed."""


class OracleAgent(MovementAgent[OracleSettings]):
    """Plays the greedy selection: each movement the farthest from the basic actions and from those before it.

    It imagines the map, so that it is the ceiling where the imagined movement is scored; in physics it is a plan that
    the body may refuse. It draws nothing at random: every seed gives the same choices. Where fewer movements are
    appropriate than the budget allows, the last is repeated, which earns nothing.
    """

    name: ClassVar[str] = "oracle"
    track = "map"
    _last_plan: ClassVar[tuple[weakref.ref[Any], OracleSettings, np.ndarray] | None] = None
    """The last plan made, of any oracle: repetitions of an episode map their memory once."""
    settings_type = OracleSettings

    def start(self, context: Context) -> None:
        """Compute the map, unless the last episode of an oracle was one of the same memory.

        A memory that generates no movements, or none that is appropriate, is a `SettingsError`.
        """
        super().start(context)
        if not hasattr(context.memory, "generate"):
            raise SettingsError(
                f"agent `{self.name}` maps the memory first: `context.memory` should generate movements, but is "
                f"{type(context.memory).__name__}"
            )
        last = OracleAgent._last_plan
        if last is None or last[0]() is not context.memory or last[1] != self.settings:
            plan = self._chosen(context.memory, self.settings.n_planned)
            OracleAgent._last_plan = last = (weakref.ref(context.memory), self.settings, plan)
        self._plan, self._place = last[2], 0

    def next_pb(self) -> np.ndarray:
        """Return the next choice of the plan, shape (2,)."""
        if self._place == len(self._plan) and len(self._plan) % self.settings.n_planned == 0:
            self._plan = self._chosen(self.context.memory, self._place + self.settings.n_planned)
        pb = self._plan[min(self._place, len(self._plan) - 1)]
        self._place += 1
        return pb

    def _chosen(self, memory: Any, n_actions: int) -> np.ndarray:
        """Return the first `n_actions` greedy choices; those of a shorter plan are their beginning."""
        pb, trajectories, outcome, _ = oracle_pool(memory, self.settings.resolution)
        appropriate = np.isin(outcome, APPROPRIATE)
        if not appropriate.any():
            raise SettingsError(f"agent `{self.name}`: nothing on the map of this memory is appropriate")
        return pb[farthest_points(trajectories, memory.demonstrations, n_actions, appropriate).indices]


def oracle_pool(memory: Any, resolution: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, PBMap | None]:
    """Return what the oracle chooses from: PB points (n, n_pb), their trajectories and outcomes, n = resolution^2.

    With two PB units that is the map, which is returned too; with another number a Sobol sequence, the same each time.
    """
    n_pb = len(memory.pb[0])
    if n_pb == 2:
        scored = pb_map(memory, resolution=resolution)
        assert scored.trajectories is not None
        return scored.pb, scored.trajectories, scored.outcome, scored
    space = Box(-1.0, 1.0, (n_pb,), np.float32)
    pb = sobol_points(Context(space, space, 1, np.random.default_rng(0)), resolution**2)
    trajectories = memory.generate(pb)
    return pb, trajectories, score(trajectories, memory.demonstrations).outcome, None
