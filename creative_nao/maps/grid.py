"""The grid over a two-dimensional PB space, what every map over it has, and its landscape: its shape in numbers.

Two readings are kept apart, since they answer different questions. A
*learned region* is made of cells where a basic action comes back (outcome `learned`). A *nearest region* is made of
appropriate cells whose nearest basic action is the same, learned or not: the coloured areas of Fig. 4. Cells that
cannot be used belong to neither.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from creative_nao.errors import SettingsError, ShapeError, shown
from creative_nao.measures import OUTCOMES, dtw_pairs
from creative_nao.measures.dtw import as_numbers
from creative_nao.measures.outcome import ALL_OUTCOMES, APPROPRIATE
from creative_nao.model import Memory
from creative_nao.schema import Field, checked

PAPER_RESOLUTION = 200
"""Points along each axis in the paper: 40,000 in all."""


def pb_grid(resolution: int = PAPER_RESOLUTION) -> np.ndarray:
    """Return `resolution` x `resolution` PB points evenly spaced in [-1, 1]^2, ends included, at least 2 on a side.

    Shape (resolution^2, 2), float64. The first PB unit changes fastest: point k lies in column k % resolution of the
    row k // resolution, rows going up with the second unit.
    """
    checked(Annotated[int, Field(ge=2)], resolution, "resolution")
    axis = np.linspace(-1.0, 1.0, resolution)
    first, second = np.meshgrid(axis, axis, indexing="xy")
    return np.stack([first, second], axis=-1).reshape(-1, 2)


def neighbour_pairs(resolution: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the pairs of neighbours in `pb_grid(resolution)`, each once: first members and second ones, as indices.

    Both are of shape (2 * resolution * (resolution - 1),): neighbours in a row, then those above each other.
    """
    cells = np.arange(resolution**2).reshape(resolution, resolution)
    first = np.concatenate([cells[:, :-1].ravel(), cells[:-1].ravel()])
    second = np.concatenate([cells[:, 1:].ravel(), cells[1:].ravel()])
    return first, second


def nearest_cell(pb: ArrayLike, resolution: int = PAPER_RESOLUTION) -> np.ndarray:
    """Return the index in `pb_grid(resolution)` nearest to each PB point: (n, 2) in [-1, 1] into (n,)."""
    points = as_numbers(pb, "pb")
    if points.ndim != 2 or points.shape[1] != 2:
        raise ShapeError(f"`pb` should have shape (n, 2), but has {points.shape}")
    cell = np.rint((points + 1.0) / 2.0 * (resolution - 1)).astype(np.int64)
    return cell[:, 1] * resolution + cell[:, 0]


@dataclass(frozen=True, eq=False, repr=False)
class GridMap:
    """A scored grid over a PB space of two units, whoever performed the movements.

    Attributes:
        resolution: Points along each axis; there are n = resolution^2.
        pb: The points, shape (n, 2), in the order of `pb_grid`.
        outcome: One of `measures.outcome.ALL_OUTCOMES` each, shape (n,) of str.
        nearest: Which basic action each is nearest to, shape (n,) of int.
        distance: DTW distance to it [rad], shape (n,).
        learned_pb: Where the basic actions themselves lie, shape (n_actions, 2).
        names: Names of the basic actions.
        record: Memory, settings and versions that made the map.
        trajectories: What the network generates at each point [rad], shape (n, n_steps, n_joints); None in a map read
            from a file, since the memory gives the same bits again.
        dt_s: Tick of the trajectories [s]; None in a map read from a file.
    """

    resolution: int
    pb: np.ndarray
    outcome: np.ndarray
    nearest: np.ndarray
    distance: np.ndarray
    learned_pb: np.ndarray
    names: tuple[str, ...]
    record: dict[str, Any]
    trajectories: np.ndarray | None = None
    dt_s: float | None = None

    @property
    def memory_name(self) -> str:
        """Name of the memory, as the record tells it, or empty."""
        return str(self.record.get("settings", {}).get("memory", ""))

    @property
    def appropriate(self) -> np.ndarray:
        """Whether each point's movement can be used, shape (n,) of bool."""
        return np.isin(self.outcome, APPROPRIATE)

    def share_pct(self, outcome: str) -> float:
        """Return the share of the map with this outcome [%]."""
        return 100.0 * float(np.mean(self.outcome == outcome))

    def learned_region_pct(self) -> np.ndarray:
        """Return the share of the map where each basic action comes back (outcome learned) [%], shape (n_actions,)."""
        mine = self.nearest[None, :] == np.arange(len(self.names))[:, None]
        return 100.0 * np.mean(mine & (self.outcome == "learned"), axis=1)

    def __repr__(self) -> str:
        name = f" of memory {self.memory_name}" if self.memory_name else ""
        shares = {outcome: self.share_pct(outcome) for outcome in ALL_OUTCOMES}
        parts = ", ".join(f"{share:.1f} % {outcome}" for outcome, share in shares.items() if share)
        return f"{type(self).__name__}{name}: {self.resolution} x {self.resolution} points; {parts}"


def region_sizes(mask: np.ndarray) -> np.ndarray:
    """Return how many cells each connected region of a grid has, in the order of their first cells, shape (n_regions,).

    The mask, shape (n_rows, n_columns) of bool, tells which cells are taken. Each has four neighbours.

    Example:
        >>> region_sizes(np.array([[1, 0, 1], [1, 0, 0]], dtype=bool)).tolist()
        [2, 1]
    """
    labels = np.zeros(mask.shape, dtype=np.int32)
    ndimage.label(mask, output=labels)
    return np.bincount(labels.ravel())[1:]


def n_border_edges(labels: np.ndarray) -> int:
    """Return how many pairs of neighbouring cells of a grid have different labels."""
    return int((labels[1:] != labels[:-1]).sum() + (labels[:, 1:] != labels[:, :-1]).sum())


@dataclass(frozen=True)
class ActionRegions:
    """What one basic action fills of a map, in one of the two readings."""

    share_pct: float  # share of all cells [%]
    n_regions: int  # connected regions; cells have four neighbours
    largest_pct: float  # share of the largest of them [%]


@dataclass(frozen=True)
class Ruggedness:
    """How fast the movement changes from a cell to the next: DTW distance of all pairs of neighbours [rad]."""

    mean: float
    median: float
    p95: float  # 95th percentile
    mean_appropriate: float | None  # over the pairs whose both cells are appropriate; None if there is no such pair


@dataclass(frozen=True)
class Landscape:
    """A PB map in numbers. All depend on the resolution; only maps of the same resolution compare.

    Attributes:
        resolution: Points along each axis.
        outcome_pct: Share of each outcome [%].
        learned: Learned regions of each basic action.
        nearest: Nearest regions of each basic action.
        learned_evenness: How evenly the learned cells are shared among the basic actions: entropy of their shares over
            its maximum, 1 if all are equal, 0 if one has everything; None if no cell is learned.
        nearest_evenness: The same of the nearest regions; None if no cell is appropriate.
        border_length: Length of all borders between cells of different colour, a colour being the nearest basic action
            or, where it cannot be used, the outcome; in PB units, of which a side of the map has 2. Borders of a rugged
            map are crinkled and grow with the resolution.
        learned_border_length: Length of the borders around the learned regions.
        ruggedness: None if the trajectories are neither in the map nor generated again.
    """

    resolution: int
    outcome_pct: dict[str, float]
    learned: dict[str, ActionRegions]
    nearest: dict[str, ActionRegions]
    learned_evenness: float | None
    nearest_evenness: float | None
    border_length: float
    learned_border_length: float
    ruggedness: Ruggedness | None

    @property
    def n_learned_regions(self) -> int:
        """Number of learned regions of all actions."""
        return sum(action.n_regions for action in self.learned.values())

    @property
    def n_nearest_regions(self) -> int:
        """Number of nearest regions of all actions."""
        return sum(action.n_regions for action in self.nearest.values())

    def figures(self) -> dict[str, Any]:
        """Return everything as plain JSON values."""
        return dataclasses.asdict(self)


def landscape(pb_map: GridMap, memory: Memory | None = None) -> Landscape:
    """Measure the shape of a map; its memory generates the trajectories again where the map, from a file, has none.

    Raises:
        SettingsError: If the map is none, or not of `memory`.
    """
    if not isinstance(pb_map, GridMap):
        raise SettingsError(f"`pb_map` should be a map, such as `pb_map(memory)` makes, but is {shown(pb_map)}")
    n = pb_map.resolution
    labels = np.where(pb_map.appropriate, pb_map.nearest, -1).reshape(n, n)
    learned_labels = np.where(pb_map.outcome == "learned", pb_map.nearest, -1).reshape(n, n)
    colours = labels.copy()
    for place, outcome in enumerate(OUTCOMES):
        unusable = (pb_map.outcome == outcome).reshape(n, n) & (labels < 0)
        colours[unusable] = -2 - place
    cell = 2.0 / (n - 1)
    learned, nearest = _by_action(learned_labels, pb_map.names), _by_action(labels, pb_map.names)
    return Landscape(
        resolution=n,
        outcome_pct={outcome: pb_map.share_pct(outcome) for outcome in OUTCOMES},
        learned=learned,
        nearest=nearest,
        learned_evenness=evenness([action.share_pct for action in learned.values()]),
        nearest_evenness=evenness([action.share_pct for action in nearest.values()]),
        border_length=cell * n_border_edges(colours),
        learned_border_length=cell * n_border_edges(learned_labels),
        ruggedness=_ruggedness(pb_map, memory),
    )


def evenness(sizes: list[float] | np.ndarray) -> float | None:
    """Return the entropy of the shares of `sizes` over its maximum, ln of their number; None if all are zero.

    Example:
        >>> evenness([5, 5]), evenness([0, 9]), round(evenness([1, 3]), 3)
        (1.0, 0.0, 0.811)
    """
    weights = np.asarray(sizes, dtype=np.float64)
    if not weights.sum() > 0:
        return None
    if len(weights) == 1:
        return 1.0
    shares = weights[weights > 0] / weights.sum()
    return float(abs((shares * np.log(shares)).sum()) / np.log(len(weights)))


def _by_action(labels: np.ndarray, names: tuple[str, ...]) -> dict[str, ActionRegions]:
    found = {}
    percent = 100.0 / labels.size
    for place, name in enumerate(names):
        sizes = region_sizes(labels == place)
        found[name] = ActionRegions(float(sizes.sum() * percent), len(sizes), float(sizes.max(initial=0) * percent))
    return found


def _ruggedness(pb_map: GridMap, memory: Memory | None) -> Ruggedness | None:
    trajectories = pb_map.trajectories
    if trajectories is None:
        if memory is None:
            return None
        if not np.array_equal(memory.pb, pb_map.learned_pb):
            raise SettingsError(
                f"`memory` should be the one of the map, {pb_map.memory_name}, but "
                f"{memory.name} learned its basic actions at other PB values"
            )
        trajectories = memory.generate(pb_map.pb)
    first, second = neighbour_pairs(pb_map.resolution)
    distances = dtw_pairs(trajectories, first, second)
    usable = pb_map.appropriate[first] & pb_map.appropriate[second]
    return Ruggedness(
        mean=float(distances.mean()),
        median=float(np.median(distances)),
        p95=float(np.percentile(distances, 95)),
        mean_appropriate=float(distances[usable].mean()) if usable.any() else None,
    )
