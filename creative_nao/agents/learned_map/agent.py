"""The agent `learned_map`: it looks where its network expects the largest reward, and keeps all that it imagines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np

from creative_nao.agents.base import Context
from creative_nao.agents.black_box import learned_points
from creative_nao.agents.rehearsal import PlanningAgent
from creative_nao.envs.observation import try_columns
from creative_nao.measures import reward_scale
from creative_nao.measures.outcome import OUTCOME_CODE
from creative_nao.schema import Count, Field, NonNegative, UnitInterval, record

if TYPE_CHECKING:
    from creative_nao.agents.bundle import TrainedPolicy

MAX_ROWS = 400
"""Most tries that the network is shown: of more imagined ones, some evenly over the episode."""


@record
class LearnedMapSettings:
    """Where the learned map looks; a bundle holds what was chosen on validation memories."""

    n_candidates: Annotated[int, Field(ge=4, le=65_536)] = 1024
    """Points at which the map is asked."""
    optimism: Annotated[float, Field(ge=-100, le=100)] = 0.0
    """Weight of the spread of the expected distance."""
    temperature: NonNegative = 0.0
    """Candidates to imagine are drawn with probability exp(value / temperature); 0 takes the best."""
    spacing: NonNegative = 0.0
    """Least distance of points that are chosen together, in PB units; the square is 2 wide."""
    n_at_once: Count = 16
    """Movements imagined together, before the map is asked again."""
    first_share: UnitInterval = 0.0
    """Part of the budget of imagining that is spread evenly before the first movement is performed."""


def pick(
    values: np.ndarray, points: np.ndarray, n: int, settings: LearnedMapSettings, rng: np.random.Generator
) -> np.ndarray:
    """Return the places of `n` of the points (m, n_pb) by their values (m,): the best, or drawn, spaced out."""
    left = values.astype(np.float64)
    if settings.temperature:
        left = left / settings.temperature + rng.gumbel(size=len(left))
    chosen: list[int] = []
    while len(chosen) < n:
        place = int(left.argmax())
        chosen.append(place)
        near = ((points - points[place]) ** 2).sum(axis=1) < settings.spacing**2
        left[near] -= 1e9  # all are near: the best of those that were set back fewest times
        left[place] = -np.inf
    return np.array(chosen)


class LearnedMapAgent(PlanningAgent[LearnedMapSettings]):
    """Expects what each point would earn now, by a network that has seen other memories, and takes the best.

    Without imagining it performs the best point; else it imagines there, shows the network all that it has imagined,
    and performs the farthest movement of all those. It reads `info` and works in every environment of the project whose
    memories have as many PB units and basic actions as those it was trained on.

    Args:
        policy: A trained map, from `load_agent`.
        settings: Where it looks; None takes those of the bundle.
    """

    name: ClassVar[str] = "learned_map"
    settings_type = LearnedMapSettings

    def __init__(self, policy: TrainedPolicy, settings: LearnedMapSettings | None = None):
        self.policy, self.deterministic = policy, True
        self._map: Any = policy.policy
        super().__init__(self._map.settings if settings is None else settings)
        self.n_actions_training = policy.header.n_actions_training

    def start(self, context: Context) -> None:
        """Begin with the learned points."""
        self._points = learned_points(context, self.name)
        self._map.check_form(self._points)
        self._unit = reward_scale(context.demonstrations)
        self._columns = {part.name: part for part in try_columns(*self._points.shape)}
        self._performed: list[np.ndarray] = []
        self._imagined: dict[bytes, tuple[np.ndarray, int | None]] = {}
        """Rows of movements imagined and not performed, and their places in the pool."""
        self._n_pooled = 0
        super().start(context)

    def untried(self) -> np.ndarray:
        """Return the point with the largest expected reward, shape (n_pb,)."""
        return self.where(1)[0]

    def where(self, n: int) -> np.ndarray:
        """Return the points to look at next, shape (n, n_pb)."""
        space, rng = self.context.action_space, self.context.rng
        points = self._map.candidates
        within = rng.uniform(-0.5, 0.5, points.shape) * self._map.candidate_gap
        points = np.clip(points + within, space.low, space.high).astype(np.float32)
        values = self._map.expected_reward(self._points, *self.rows(), points, self.settings.optimism)
        return points[pick(values, points, n, self.settings, rng)].astype(np.float64)

    def rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Return all tries as rows of the -v1 observation, (n, width), and whether each was performed, (n,).

        Those performed stand last, in the order of time. The reward of one that was imagined is what it is worth now.
        """
        n_kept = min(len(self._imagined), max(MAX_ROWS - len(self._performed), 0))
        kept = np.linspace(0, len(self._imagined) - 1, n_kept).round().astype(np.int64)
        imagined = [*self._imagined.values()]
        rows = []
        for row, place in (imagined[one] for one in kept):
            if place is not None:
                row[self._columns["reward"].start] = _bounded(max(self._distances[place], 0.0) / self._unit)
            rows.append(row)
        rows += self._performed[-MAX_ROWS:]
        found = np.array(rows, np.float32).reshape(len(rows), self._columns["distances"].stop)
        return found, np.arange(len(rows)) >= n_kept

    def learn_imagined(self, pb: np.ndarray, info: Mapping[str, Any]) -> None:
        """Keep what was imagined."""
        if info.get("imagined"):
            usable = bool(info["appropriate"])
            self._imagined[_key(pb)] = self._row(pb, info), self._n_pooled if usable else None
            self._n_pooled += usable

    def learn(self, pb: np.ndarray, observation: np.ndarray, reward: float, info: Mapping[str, Any]) -> None:
        """Keep what was performed, where it has ended."""
        super().learn(pb, observation, reward, info)
        if self._held is None:
            self._imagined.pop(_key(pb), None)
            self._performed.append(self._row(pb, info))

    def _row(self, pb: np.ndarray, info: Mapping[str, Any]) -> np.ndarray:
        at = self._columns
        row = np.zeros(at["distances"].stop, np.float32)
        row[0] = 1.0
        row[at["pb"].start : at["pb"].stop] = pb
        row[at["outcome"].start + OUTCOME_CODE[info["outcome"]]] = 1.0
        row[at["reward"].start] = _bounded(info["reward_novelty"])
        row[at["distances"].start :] = _bounded(np.asarray(info["basic_distances"]) / self._unit)
        return row


def _bounded(value: Any) -> Any:
    return value / (value + 1.0)


def _key(pb: np.ndarray) -> bytes:
    return np.asarray(pb, np.float32).tobytes()
