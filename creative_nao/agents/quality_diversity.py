"""Searches by pyribs that sort movements by how they behave: CMA-ME, MAP-Elites and novelty search.

How a movement behaves is told by a descriptor, a few numbers read off `info["trajectory"]`, the movement as it was
scored: imagined in `BoxingMental-v0`, as the encoders measured it in `Boxing-v0`. An inappropriate movement counts as
none at all: a search for variety would otherwise collect the endless variety of movements that nobody can use.
"""

from __future__ import annotations

import warnings
from abc import abstractmethod
from collections.abc import Mapping
from types import ModuleType
from typing import Annotated, Any, ClassVar, cast

import numpy as np

from creative_nao.agents.base import BatchSearch, Context, T
from creative_nao.agents.black_box import uniform_points
from creative_nao.errors import SettingsError
from creative_nao.schema import Count, Field, NonNegative, Positive, record

N_EXCURSIONS = 2


def arm_excursions(info: Mapping[str, Any]) -> np.ndarray:
    """Return how far each arm moves: the mean over its joints of largest minus smallest angle [rad].

    The first half of the joints counts as one arm and the second as the other: of the NAO the right and the left.
    A punch of the paper reads about (0.06, 0.8) or (0.8, 0.06). Shape (2,); zero for an inappropriate movement.
    """
    trajectory = _scored_trajectory(info)
    if not info["appropriate"]:
        return np.zeros(N_EXCURSIONS)
    half = (trajectory.shape[1] + 1) // 2
    excursions = np.ptp(trajectory, axis=0)
    return np.array([excursions[:half].mean(), excursions[half:].mean() if trajectory.shape[1] > 1 else 0.0])


def mean_postures(info: Mapping[str, Any], n_stretches: int) -> np.ndarray:
    """Return the mean posture in each of `n_stretches` equal stretches of a movement [rad]; at most one a tick.

    Shape (n_stretches * n_joints,), stretch by stretch; for an inappropriate movement its first posture, held.
    """
    trajectory = _scored_trajectory(info)
    n_stretches = min(n_stretches, len(trajectory))
    if not info["appropriate"]:
        return np.tile(trajectory[0], n_stretches)
    return np.concatenate([stretch.mean(axis=0) for stretch in np.array_split(trajectory, n_stretches)])


def _scored_trajectory(info: Mapping[str, Any]) -> np.ndarray:
    """Return the movement in `info`, shape (n_steps, n_joints) [rad]."""
    for term in ("trajectory", "appropriate"):
        if term not in info:
            raise SettingsError(
                f'a descriptor reads `info["{term}"]`, as the environments of creative_nao tell it, '
                f"but `info` holds only: {', '.join(info) or 'nothing'}"
            )
    return np.asarray(info["trajectory"], np.float64)


class ArmArchiveSearch(BatchSearch[T]):
    """A search of pyribs: one `GridArchive` over the excursions of both arms, and one emitter that a subclass defines.

    The objective is what a movement earned when it was tried. It is kept as it was, although the same movement would
    earn nothing a second time: the archive is a record of finds, and its elites are where new movements start from.

    Its settings tell the `n_cells` and `largest_excursion` of the archive, and `batch_size`.
    """

    package, extra = "ribs", "search"
    track = "trajectories"

    def prepare(self, context: Context, seed: int) -> None:
        """Build archive, emitter and scheduler."""
        ribs, settings = self.load_package(), cast(Any, self.settings)
        for_archive, for_emitter = np.random.SeedSequence(seed).spawn(2)
        archive = ribs.archives.GridArchive(
            solution_dim=context.action_space.shape[0],
            dims=[settings.n_cells] * N_EXCURSIONS,
            ranges=[(0.0, settings.largest_excursion)] * N_EXCURSIONS,
            seed=for_archive,
        )
        shared = {"bounds": _bounds(context), "batch_size": settings.batch_size, "seed": for_emitter}
        self._scheduler = ribs.schedulers.Scheduler(archive, [self.build_emitter(ribs.emitters, archive, **shared)])

    def propose(self) -> np.ndarray:
        """Ask the emitter, shape (n, n_pb)."""
        return self._scheduler.ask()

    def receive(self, pb: np.ndarray, rewards: np.ndarray, descriptors: np.ndarray) -> None:
        """Add the batch to the archive and tell the emitter."""
        with warnings.catch_warnings():
            # pyribs warns of an archive that stays empty: nothing appropriate yet is no mistake here.
            warnings.filterwarnings("ignore", message=".*was empty before adding solutions", category=UserWarning)
            self._scheduler.tell(rewards, descriptors)

    def describe(self, info: Mapping[str, Any]) -> np.ndarray:
        """Return how far each arm moves [rad], shape (2,)."""
        return arm_excursions(info)

    @property
    def archive(self) -> Any:
        """The archive of the running episode: a `ribs.archives` archive."""
        return self._scheduler.archive

    @abstractmethod
    def build_emitter(self, emitters: ModuleType, archive: Any, **shared: Any) -> Any:
        """Return the emitter of `ribs.emitters` that fills `archive`, made with the arguments that all have."""


def _bounds(context: Context) -> list[tuple[float, float]]:
    """Return the ends of the action space, a pair for each PB unit."""
    return list(zip(context.action_space.low.tolist(), context.action_space.high.tolist(), strict=True))


@record
class CmaMeSettings:
    """How CMA-ME searches."""

    batch_size: Annotated[int, Field(ge=2)] = 10
    """Movements between two updates of distribution and archive."""
    sigma: Positive = 1.2
    """First standard deviation, in each PB unit, around the centre of the space and after a restart around an elite."""
    n_cells: Count = 12
    """Cells of the archive along each of the two descriptors."""
    largest_excursion: Positive = 1.5
    """Upper end of the archive along each descriptor [rad]; beyond it movements fall into the last cell."""


class CmaMeAgent(ArmArchiveSearch[CmaMeSettings]):
    """CMA-ME (Fontaine et al. 2020, arXiv:1912.02400) by pyribs' `GridArchive` and `EvolutionStrategyEmitter`.

    A movement ranks first if it fills an empty cell, then by how much it improves one. Movements are sorted by how far
    each arm moves (`arm_excursions`).
    """

    name: ClassVar[str] = "cma_me"
    settings_type = CmaMeSettings

    def build_emitter(self, emitters: ModuleType, archive: Any, **shared: Any) -> Any:
        """Return the evolution strategy, ranked by improvement of the archive."""
        space = self.context.action_space
        centre = (space.low + space.high).astype(np.float64) / 2.0
        return emitters.EvolutionStrategyEmitter(
            archive, x0=centre, sigma0=self.settings.sigma, ranker="2imp", **shared
        )


@record
class MapElitesSettings:
    """How MAP-Elites searches."""

    n_initial: Count = 15
    """Movements drawn uniformly before the first variation."""
    batch_size: Count = 1
    """Movements between two updates of the archive."""
    sigma: Positive = 0.5
    """Standard deviation of a variation, in each PB unit; the square is 2 wide."""
    n_cells: Count = 6
    """Cells of the archive along each of the two descriptors."""
    largest_excursion: Positive = 1.5
    """Upper end of the archive along each descriptor [rad]; beyond it movements fall into the last cell."""


class MapElitesAgent(ArmArchiveSearch[MapElitesSettings]):
    """MAP-Elites (Mouret and Clune 2015, arXiv:1504.04909) by pyribs' `GridArchive` and `GaussianEmitter`.

    Movements are sorted by how far each arm moves (`arm_excursions`).
    """

    name: ClassVar[str] = "map_elites"
    settings_type = MapElitesSettings

    def build_emitter(self, emitters: ModuleType, archive: Any, **shared: Any) -> Any:
        """Return the emitter that varies elites drawn from the archive."""
        first = uniform_points(self.context, self.settings.n_initial)
        return emitters.GaussianEmitter(archive, sigma=self.settings.sigma, initial_solutions=first, **shared)


@record
class NoveltySearchSettings:
    """How novelty search searches."""

    n_initial: Count = 5
    """Movements drawn uniformly before the first update."""
    batch_size: Annotated[int, Field(ge=2)] = 3
    """Movements between two updates of distribution and archive."""
    sigma: Positive = 0.8
    """First standard deviation, in each PB unit, around a movement drawn from the archive; the square is 2 wide."""
    n_neighbours: Count = 3
    """Novelty is the mean distance to so many movements of the archive."""
    threshold: NonNegative = 0.5
    """A movement joins the archive when it is at least so novel, in the unit of the descriptor [rad]."""
    n_stretches: Count = 5
    """The descriptor is the mean posture in so many equal stretches of the movement."""


class NoveltySearchAgent(BatchSearch[NoveltySearchSettings]):
    """Novelty search (Lehman and Stanley 2011) by pyribs' `ProximityArchive` and `EvolutionStrategyEmitter`.

    Movements are compared by their mean posture in a few stretches of time (`mean_postures`). The reward
    plays no part; that a movement is inappropriate does: it counts as none (a minimal criterion, as Lehman and
    Stanley proposed in 2010).
    """

    name: ClassVar[str] = "novelty_search"
    settings_type, package, extra = NoveltySearchSettings, "ribs", "search"
    track = "trajectories"

    def prepare(self, context: Context, seed: int) -> None:
        """Begin with nothing: the first movements show how many joints the descriptor has."""
        self._ribs = self.load_package()
        self._seeds = np.random.SeedSequence(seed).spawn(2)
        self._scheduler: Any = None

    def propose(self) -> np.ndarray:
        """Draw the first batch uniformly, (n_initial, n_pb); after it ask the emitter, (batch_size, n_pb)."""
        return (
            uniform_points(self.context, self.settings.n_initial) if self._scheduler is None else self._scheduler.ask()
        )

    def receive(self, pb: np.ndarray, rewards: np.ndarray, descriptors: np.ndarray) -> None:
        """Add the batch to the archive and tell the emitter how novel each movement was."""
        if self._scheduler is not None:
            self._scheduler.tell(rewards, descriptors)  # the rewards are kept beside, not ranked
            return
        archive = self._ribs.archives.ProximityArchive(
            solution_dim=pb.shape[1],
            measure_dim=descriptors.shape[1],
            k_neighbors=self.settings.n_neighbours,
            novelty_threshold=self.settings.threshold,
            seed=self._seeds[0],
        )
        archive.add(pb, rewards, descriptors)
        emitter = self._ribs.emitters.EvolutionStrategyEmitter(
            archive,
            x0=archive.sample_elites(1)["solution"][0],
            sigma0=self.settings.sigma,
            ranker="nov",
            bounds=_bounds(self.context),
            batch_size=self.settings.batch_size,
            seed=self._seeds[1],
        )
        self._scheduler = self._ribs.schedulers.Scheduler(archive, [emitter])

    def describe(self, info: Mapping[str, Any]) -> np.ndarray:
        """Return the mean postures [rad], shape (n_stretches * n_joints,)."""
        return mean_postures(info, self.settings.n_stretches)
