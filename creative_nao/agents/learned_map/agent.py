"""The agent `learned_map`: it looks where its network expects the largest reward, and keeps all that it imagines."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np

from creative_nao.agents.base import Context
from creative_nao.agents.black_box import learned_points
from creative_nao.agents.learned_map.truth import spread_points
from creative_nao.agents.rehearsal import BodySettings, PlanningAgent
from creative_nao.envs.episode_batch import EPISODE_ACTIONS
from creative_nao.envs.observation import try_columns
from creative_nao.errors import SettingsError
from creative_nao.measures import reward_scale
from creative_nao.measures.outcome import OUTCOME_CODE
from creative_nao.schema import Field, UnitInterval, record

if TYPE_CHECKING:
    from creative_nao.agents.bundle import TrainedPolicy

MAX_ROWS = 400
"""Most tries that the network is shown: of more imagined ones, some evenly over the episode."""
LOCAL_SIGMA = 0.1
"""Standard deviation of the points around the best movement, in each PB unit."""
Ask = Callable[[np.ndarray], tuple[np.ndarray, ...]]
"""Probability of being appropriate, distance and its spread of PB points, as of `AttentiveMap.expect`."""


@record
class LearnedMapSettings:
    """Where the learned map looks; a bundle holds what was chosen on validation memories."""

    n_asked: Annotated[int, Field(ge=4, le=65_536)] = 256
    """Points spread over the PB space at which the map is asked first."""
    n_refined: Annotated[int, Field(ge=0, le=65_536)] = 64
    """Points around the best of them that are asked then."""
    first_share: UnitInterval = 0.0
    """Part of the budget of imagining that is spread evenly before the first movement is performed."""
    n_expected: Annotated[int, Field(ge=1, le=9_999)] = 9_999
    """Most points that are imagined before a movement where the map expects most; what else the budget allows is drawn
    around the best movement imagined and not yet performed."""
    long_first_share: UnitInterval = 0.5
    """`first_share` in episodes of more than 30 movements, which are more than a map is taught by."""


def refined(
    ask: Ask, candidates: np.ndarray, n_refined: int, best: float = 0.0, n_segments: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Return candidates (n, n_pb), more points around the best of them, and the value of all.

    The value is the expected reward; with `best` above 0 it is what is expected beyond it, of a normal distribution.
    """

    def value(pb: np.ndarray) -> np.ndarray:
        probability, distance, spread = ask(pb)
        if best > 0.0:
            from scipy.special import ndtr

            z = (distance - best) / spread
            distance = spread * (z * ndtr(z) + np.exp(-(z**2) / 2.0) / np.sqrt(2.0 * np.pi))
        return probability * distance

    values, n_pb = value(candidates), candidates.shape[1]
    if not n_refined:
        return candidates, values
    gap = cell(len(candidates), n_pb, n_segments) * spread_points(n_pb, n_refined)
    around = np.clip(candidates[values.argmax()] + gap, -1.0, 1.0).astype(np.float32)
    return np.concatenate([candidates, around]), np.concatenate([values, value(around)])


def cell(n_points: int, n_pb: int, n_segments: int = 1) -> float:
    """Return the distance of neighbours among points spread over the PB space; 0.4 where a point is several PB vectors.

    In ten dimensions it would exceed the space: so the agent earns 15.4 on validation memories, with 0.4 it earns 17.2.
    """
    return 0.4 if n_segments > 1 else 2.0 / (n_points ** (1.0 / n_pb) - 1.0)


class LearnedMapAgent(PlanningAgent[LearnedMapSettings]):
    """Expects what each point would earn now, by a network that has seen other memories, and takes the best.

    Without imagining it performs the best point; else it imagines where most is expected beyond the best movement
    imagined so far, and around that one, shows the network all that it has imagined, and performs the farthest movement
    of all those. It reads `info` and works in every environment of the project whose memories have as many PB units and
    basic actions as those it was trained on; in physics it weighs movements by the body sense.

    Args:
        trained: A trained map, from `load_agent`.
        settings: Where it looks; None takes those of the bundle.
    """

    name: ClassVar[str] = "learned_map"
    body = BodySettings("sense")
    _map: Any
    settings_type = LearnedMapSettings

    def __init__(self, trained: TrainedPolicy, settings: LearnedMapSettings | None = None):
        self.trained, self._map = trained, trained.policy
        super().__init__(self._map.settings if settings is None else settings)
        self.n_segments = self._map.n_segments
        self.n_actions_training = trained.header.n_actions_training

    def start(self, context: Context) -> None:
        """Begin with the learned points."""
        self._points = learned_points(context, self.name)
        if self._points.shape != (form := (self._map.n_basic, *self._map.action_space.shape)):
            told = f"learned points (basic actions, PB units) of shape {form}, but these are {self._points.shape}"
            raise SettingsError(f"agent `{self.name}` was trained with {told}")
        self._points = np.tile(self._points, (1, self.n_segments))
        self._unit = reward_scale(context.demonstrations)
        self._columns = {part.name: part for part in try_columns(*self._points.shape)}
        self._candidates = spread_points(self._points.shape[1], self.settings.n_asked)
        self._performed: list[np.ndarray] = []
        self._imagined: dict[bytes, tuple[np.ndarray, int | None]] = {}
        """Rows of movements imagined and not performed, and their places in the pool."""
        self._n_pooled = 0
        super().start(context)

    def first_share(self) -> float:
        """Return the part of the budget that is imagined before the first movement; of long episodes another."""
        return self.settings.long_first_share if self._n_left > EPISODE_ACTIONS else self.settings.first_share

    def expect(self, pb: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return what it expects of PB points (n, n_pb) now: probability of being appropriate, distance, spread, (n,).

        The distance is that to everything known, in units of the reward; the reward expected is probability x distance.
        """
        return self._map.expect(self._points, *self.rows())(pb)

    def untried(self) -> np.ndarray:
        """Return the point with the largest expected reward, shape (n_pb,)."""
        return self.where(1)[0]

    def where(self, n: int) -> np.ndarray:
        """Return the best of points shifted at random within their cells, best first, then local ones, (n, n_pb)."""
        n_pb, rng = self._points.shape[1], self.context.rng
        n_local = 0 if (place := self.best()) is None else max(n - self.settings.n_expected, 0)
        spread = self._candidates if n <= len(self._candidates) else spread_points(n_pb, 2 * n)
        shift = cell(len(spread), n_pb, self.n_segments if n == 1 else 1) * rng.uniform(-0.5, 0.5, spread.shape)
        best = 0.0 if place is None else float(self._distances[place]) / self._unit
        candidates = np.clip(spread + shift, -1.0, 1.0).astype(np.float32)
        n_refined = self.settings.n_refined if n == 1 else 0  # else all would lie around the best
        pb, values = refined(self._map.expect(self._points, *self.rows()), candidates, n_refined, best, self.n_segments)
        chosen = pb[np.argsort(-values, kind="stable")[: n - n_local]].astype(np.float64)
        return np.concatenate([chosen, self.around_best(n_local, LOCAL_SIGMA)]) if n_local else chosen

    def rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Return all tries as rows of the -v1 observation, (n, width), and whether each was performed, (n,).

        Those performed stand last, in the order of time. The reward of one that was imagined is what it is worth now.
        """
        n_kept = min(len(self._imagined), max(MAX_ROWS - len(self._performed), 0))
        imagined, rows = [*self._imagined.values()], []
        for one in np.linspace(0, len(imagined) - 1, n_kept).round().astype(np.int64):
            row, place = imagined[one]
            if place is not None:
                row[self._columns["reward"].start] = _bounded(max(self._distances[place], 0.0) / self._unit)
            rows.append(row)
        rows += self._performed[-MAX_ROWS:]
        found = np.array(rows, np.float32).reshape(len(rows), self._columns["distances"].stop)
        return found, np.arange(len(rows)) >= n_kept

    def learn_imagined(self, pb: np.ndarray, info: Mapping[str, Any]) -> None:
        """Keep what was imagined."""
        if info.get("imagined"):
            place = self._n_pooled if info["appropriate"] else None
            self._imagined[pb.astype(np.float32).tobytes()] = self._row(pb, info), place
            self._n_pooled += bool(info["appropriate"])

    def learn(self, pb: np.ndarray, observation: np.ndarray, reward: float, info: Mapping[str, Any]) -> None:
        """Keep what was performed, where it has ended."""
        pb = pb if self.n_segments == 1 or self._held is None else self._held
        super().learn(pb, observation, reward, info)
        if self._held is None:
            self._imagined.pop(pb.astype(np.float32).tobytes(), None)
            self._performed.append(self._row(pb, info))

    def _row(self, pb: np.ndarray, info: Mapping[str, Any]) -> np.ndarray:
        at, row = self._columns, np.zeros(self._columns["distances"].stop, np.float32)
        row[0] = 1.0
        row[at["pb"].start : at["pb"].stop] = pb
        row[at["outcome"].start + OUTCOME_CODE[info["outcome"]]] = 1.0
        row[at["reward"].start] = _bounded(info["reward_novelty"])
        row[at["distances"].start :] = _bounded(np.asarray(info["basic_distances"]) / self._unit)
        return row


def _bounded(value: Any) -> Any:
    return value / (value + 1.0)
