"""Observations of the environments: a flat vector whose layout is defined once, here, and checked by a test.

There are two kinds. `cells` (-v0) tells the last action and what was found in each cell of the PB space; `tries` (-v1)
holds every try of the episode, as far as the agent's track of knowledge goes.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from gymnasium.spaces import Box

from creative_nao.errors import SettingsError, shown
from creative_nao.measures._dtw_kernels import compiled
from creative_nao.measures.outcome import ALL_OUTCOMES, APPROPRIATE

N_CELLS = 8
"""The PB space is divided into N_CELLS x N_CELLS cells."""
N_APPROPRIATE = len(APPROPRIATE)
MAX_CELLS = 100_000
"""Most cells of an observation: a PB space of up to five units."""
CELLS = "cells"
"""The observation of the -v0 environments."""


class Track(StrEnum):
    """What an agent is told; each track holds what the ones before it hold, so that `a <= b` if b knows all of a."""

    OUTCOMES = "outcomes"
    """Single numbers of its own tries: PB, outcome, nearest basic action and the distance to it, reward."""
    POINTS = "points"
    """Also the learned PB point of each basic action."""
    TRAJECTORIES = "trajectories"
    """Also whole trajectories, of basic actions and tries, and distances to every basic action."""
    MAP = "map"
    """Everything: the memory itself."""

    @property
    def rank(self) -> int:
        """Place in the order, from 0."""
        return list(Track).index(self)

    def __lt__(self, other: str) -> bool:
        return self.rank < Track(other).rank

    def __le__(self, other: str) -> bool:
        return self.rank <= Track(other).rank

    def __gt__(self, other: str) -> bool:
        return self.rank > Track(other).rank

    def __ge__(self, other: str) -> bool:
        return self.rank >= Track(other).rank

    def visible(self, info: Mapping[str, Any]) -> dict[str, Any]:
        """Return the terms of an `info`, or of something imagined, that this track holds."""
        hidden = () if self >= Track.TRAJECTORIES else _OF_TRAJECTORIES
        return {name: value for name, value in info.items() if name.lstrip("_").removeprefix("imagined_") not in hidden}


_OF_TRAJECTORIES = ("trajectory", "commanded", "basic_distances")
"""Terms of `info` that only the tracks from `trajectories` on hold."""


@dataclass(frozen=True)
class ObservationPart:
    """Consecutive elements of the observation vector that belong together, from `low` to 1."""

    name: str
    start: int
    size: int
    low: float
    meaning: str

    @property
    def stop(self) -> int:
        """Index after the last element."""
        return self.start + self.size


Parts = tuple[ObservationPart, ...]


def _in_order(parts: list[Any]) -> Parts:
    starts = np.cumsum([0, *(part[1] for part in parts)]).tolist()
    return tuple(ObservationPart(name, start, *rest) for (name, *rest), start in zip(parts, starts, strict=False))


def layout(
    n_actions: int = 6,
    n_pb: int = 2,
    n_joints: int = 0,
    n_slow: int = 0,
    *,
    n_rows: int = 0,
    track: Track = Track.TRAJECTORIES,
    n_decisions: int = 1,
    rehearsal: bool = False,
) -> Parts:
    """Return the parts of the observation, in order.

    Args:
        n_actions: Basic actions.
        n_pb: PB units.
        n_joints: Joints whose posture is observed, or 0: only where the PB may change during a movement.
        n_slow: Neurons of P_S whose activity is observed there.
        n_rows: Tries that are observed, a row each; 0 for the observation of the -v0 environments, to which the other
            arguments mean nothing.
        track: What may be told.
        n_decisions: PB vectors of a movement.
        rehearsal: Whether a step imagines a movement.
    """
    step = ("step", 1, 0.0, "share of the episode that is over")
    if not n_rows:
        parts = [
            ("pb", n_pb, -1.0, "last PB vector"),
            ("outcome", len(ALL_OUTCOMES), 0.0, "last outcome, one-hot in the order of `OUTCOMES`"),
            ("novelty", 1, 0.0, "d / (d + scale), d the last action's distance to the nearest basic action"),
            ("nearest", n_actions, 0.0, "nearest basic action of the last action, one-hot"),
            ("known", 1, 0.0, "d / (d + scale), d its distance to everything known before it"),
            (
                "cells",
                N_CELLS**n_pb,
                -1.0,
                "cells of PB space: 0 untried, -1 in vain, else best reward r there as r / (r + 1)",
            ),
            ("coverage", 1, 0.0, "share of the cells tried"),
            step,
        ]
    else:
        width = try_columns(n_actions, n_pb, track=track, n_decisions=n_decisions, rehearsal=rehearsal)[-1].stop
        points = ("points", n_actions * n_pb, -1.0, "learned PB point of each basic action, one after the other")
        rows = ("tries", n_rows * width, -1.0, "a row a try in order of time, zero where there is none yet")
        parts = [*([points] if track >= Track.POINTS else []), rows, step]
        if rehearsal:
            parts[-1] = ("step", 1, 0.0, "share of the actions to perform that are done")
            parts += [("imagined", 1, 0.0, "share of the movements to imagine that are used")]
        if n_joints:
            parts += [("path", n_decisions * n_pb, -1.0, "PB vectors of the movement under way, zero from now on")]
    if n_joints:
        parts += [
            ("posture", n_joints, -1.0, "joint angles now, -1 and 1 are the ends of the basic actions' range"),
            ("slow", n_slow, -1.0, "activity of the slowest layer P_S"),
            ("phase", 1, 0.0, "share of the movement that has unfolded, 0 before a new one"),
        ]
    return _in_order(parts)


def try_columns(
    n_actions: int = 6,
    n_pb: int = 2,
    *,
    track: Track = Track.TRAJECTORIES,
    n_decisions: int = 1,
    rehearsal: bool = False,
) -> Parts:
    """Return the columns of one try in the observation of the -v1 environments; arguments as of `layout`."""
    what = "its PB vector" if n_decisions == 1 else "its PB vectors, one after the other"
    columns = [
        ("tried", 1, 0.0, "1 where there was a try"),
        ("pb", n_decisions * n_pb, -1.0, what),
        ("outcome", len(ALL_OUTCOMES), 0.0, "its outcome, one-hot in the order of `OUTCOMES`"),
        ("reward", 1, 0.0, "r / (r + 1), r what it earned, or was worth when it was imagined"),
    ]
    if track >= Track.TRAJECTORIES:
        columns += [("distances", n_actions, 0.0, "d / (d + scale), d its distance to each basic action")]
    if rehearsal:
        columns += [
            ("performed", 1, 0.0, "1 where it was performed"),
            ("candidate", 1, 0.0, "1 at the one that a commit would perform now"),
        ]
    return _in_order(columns)


def split(observations: np.ndarray, parts: Parts, columns: Parts) -> dict[str, np.ndarray]:
    """Return the parts of observations (..., size) by name, views; `tries` as (..., n_rows, width)."""
    found = {part.name: observations[..., part.start : part.stop] for part in parts}
    if "tries" in found:
        found["tries"] = found["tries"].reshape(*observations.shape[:-1], -1, columns[-1].stop)
    return found


def chosen_layout(
    observation: Any,
    n_actions: int,
    n_pb: int,
    n_joints: int,
    n_slow: int,
    n_rows: int,
    *,
    n_decisions: int,
    rehearsal: bool,
) -> tuple[Parts, Parts]:
    """Return layout and columns of an observation, `cells` (not in rehearsal) or a track; another: SettingsError."""
    kinds = [track.value for track in Track if track is not Track.MAP] + ([] if rehearsal else [CELLS])
    if not isinstance(observation, str) or observation not in kinds:
        raise SettingsError(f"`observation` should be one of {', '.join(kinds)}, but is {shown(observation)}")
    if observation == CELLS and N_CELLS**n_pb > MAX_CELLS:
        raise SettingsError(
            f'`observation` "{CELLS}" has {N_CELLS} cells a PB unit, {N_CELLS}^{n_pb} for this memory of {n_pb} units; '
            f'take a -v1 environment, or `observation` "{Track.TRAJECTORIES}"'
        )
    if observation == CELLS:
        return layout(n_actions, n_pb, n_joints, n_slow), ()
    told: dict[str, Any] = {"track": Track(observation), "n_decisions": n_decisions, "rehearsal": rehearsal}
    parts = layout(n_actions, n_pb, n_joints, n_slow, n_rows=n_rows, **told)
    return parts, try_columns(n_actions, n_pb, **told)


def layout_table(parts: Parts) -> str:
    """Return the layout as a table in Markdown, a row for each part."""
    rows = ["| index | name | meaning | min | max | unit |", "| --- | --- | --- | --- | --- | --- |"]
    for part in parts:
        index = f"{part.start}-{part.stop - 1}" if part.size > 1 else part.start
        rows.append(f"| {index} | {part.name} | {part.meaning} | {part.low:g} | 1 | 1 |")
    return "\n".join(rows)


def observation_space(parts: Parts, columns: Parts = ()) -> Box:
    """Return the flat float32 Box of the observation; `columns` are those of its tries."""
    row = [np.full(column.size, column.low, np.float32) for column in columns]
    low = [np.full(part.size, part.low, np.float32) for part in parts]
    for part, values in zip(parts, low, strict=True):
        if part.name == "tries":
            values.reshape(-1, columns[-1].stop)[:] = np.concatenate(row)
    return Box(np.concatenate(low), np.ones(parts[-1].stop, np.float32), dtype=np.float32)


def cells_of(space: Box, n_pb: int) -> slice:
    """Return where the cells of a PB space of `n_pb` units stand in the observations of `space`.

    They follow from the bounds of the space: after the PB, the cells are the first values that may be negative. A space
    without them, of another project's environment, raises SettingsError.
    """
    negative = np.flatnonzero(space.low[n_pb:] < 0.0) + n_pb if len(space.shape) == 1 else np.empty(0, np.int64)
    size = N_CELLS**n_pb
    cells = slice(int(negative[0]), int(negative[0]) + size) if len(negative) >= size else slice(0)
    if cells.stop == 0 or np.any(space.low[cells] >= 0.0) or space.low[cells.stop] < 0.0:
        raise SettingsError(
            f"`observation_space` should have {size} cells of a PB space with {n_pb} units, as the observations of "
            f"CreativeNao/ environments do, but is {space}"
        )
    return cells


def tries_of(space: Any, n_pb: int = 0) -> tuple[Parts, Parts]:
    """Return layout and columns of observations that tell every try, a PB vector each.

    They follow from the bounds of the space, as `cells_of` says. With `n_pb`, the PB units, they may tell several PB
    vectors of a try; `slow` then counts as `posture`. A space of other observations, or of fewer than two tries, raises
    SettingsError.
    """
    if isinstance(space, Box) and len(space.shape) == 1:
        ends = np.flatnonzero(np.diff(space.low < 0.0, prepend=False, append=False)).reshape(-1, 2).tolist()
        n_told = ends.pop(0)[1] if ends and ends[0][0] == 0 else 0  # numbers of the learned PB points
        n_values = ends[0][1] - ends[0][0] if len(ends) > 1 else 0
        n_pb = n_pb or n_values
        n_decisions = n_values // n_pb if n_pb else 1
        first, stop = ends.pop() if n_decisions > 1 else (0, n_values)
        n_senses = stop - first - n_values
        told = itertools.product((Track.TRAJECTORIES, Track.POINTS) if n_told else (Track.OUTCOMES,), (False, True))
        for track, rehearsal in told if n_pb else ():
            sizes: Any = {"n_actions": n_told // n_pb, "n_pb": n_pb, "track": track, "rehearsal": rehearsal}
            sizes["n_decisions"] = n_decisions
            parts, columns = layout(n_rows=len(ends), n_joints=n_senses, **sizes), try_columns(**sizes)
            if observation_space(parts, columns) == space:
                return parts, columns
    raise SettingsError(
        "`observation_space` should tell at least two tries of one PB vector each, as CreativeNao/ environments of -v1 "
        f"and rehearsal do, but is {space}"
    )


@compiled()
def _record_kernel(vectors, starts, env_ids, pb, outcome, nearest, novelty, known, reward):
    """Write one action each into the vectors (n_envs, size); `starts` are those of six parts, in this order."""
    at_outcome, at_novelty, at_nearest, at_known, at_cells, at_coverage = starts
    n_cells = at_coverage - at_cells
    for k in range(len(env_ids)):
        vector = vectors[env_ids[k]]
        vector[: pb.shape[2]] = pb[k, -1]
        vector[at_outcome:at_known] = 0.0
        vector[at_outcome + outcome[k]] = 1.0
        vector[at_novelty] = novelty[k] / (novelty[k] + 1.0)
        vector[at_nearest + nearest[k]] = 1.0
        vector[at_known] = known[k] / (known[k] + 1.0)
        value = max(reward[k] / (reward[k] + 1.0), 0.1) if outcome[k] < N_APPROPRIATE else -1.0
        for point in pb[k]:
            cell, stride = at_cells, 1
            for unit in range(pb.shape[2]):
                cell += int(min((point[unit] + 1.0) / 2.0 * N_CELLS, N_CELLS - 1)) * stride
                stride *= N_CELLS
            vector[cell] = max(vector[cell], value) if vector[cell] != 0.0 else value
        vector[at_coverage] = np.count_nonzero(vector[at_cells:at_coverage]) / n_cells


@compiled()
def _try_kernel(vectors, first, stop, starts, env_ids, rows, pb, outcome, reward, distances):
    """Write one try each into row `rows[k]` of the vectors; `starts` are those of three columns, and their width.

    A try beyond the rows, after the end of an episode, is left out.
    """
    at_outcome, at_reward, at_distances, width = starts
    for k in range(len(env_ids)):
        if first + (rows[k] + 1) * width > stop:
            continue
        row = vectors[env_ids[k], first + rows[k] * width : first + (rows[k] + 1) * width]
        row[:] = 0.0
        row[0] = 1.0
        place = 1
        for point in pb[k]:
            for value in point:
                row[place] = value
                place += 1
        row[at_outcome + outcome[k]] = 1.0
        row[at_reward] = reward[k] / (reward[k] + 1.0)
        if at_distances:
            for j in range(distances.shape[1]):
                row[at_distances + j] = distances[k, j] / (distances[k, j] + 1.0)


class ObservationBatch:
    """The observation vectors of one or many episodes, one row each.

    Args:
        parts: Their `layout`.
        n_envs: How many.
        columns: The `try_columns`, where the layout has `tries`.
    """

    def __init__(self, parts: Parts, n_envs: int = 1, columns: Parts = ()) -> None:
        self._at = {part.name: slice(part.start, part.stop) for part in parts}
        self._columns = {part.name: part.start for part in columns}
        self._starts: tuple[int, ...]
        if "tries" in self._at:
            at = self._columns
            self._starts = at["outcome"], at["reward"], at.get("distances", 0), columns[-1].stop
        else:
            names = ("outcome", "novelty", "nearest", "known", "cells", "coverage")
            self._starts = tuple(self._at[name].start for name in names)
        self._vectors = np.zeros((n_envs, parts[-1].stop), np.float32)

    def begin(self, env_id: int, points: np.ndarray) -> None:
        """Begin an episode: all zero but the learned PB points (n_basic, n_pb), where they may be told."""
        self._vectors[env_id] = 0.0
        if "points" in self._at:
            self._vectors[env_id, self._at["points"]] = points.ravel()

    def has(self, part: str) -> bool:
        """Return whether the observations have a part of this name."""
        return part in self._at

    def set_part(self, env_ids: np.ndarray, part: str, values: np.ndarray) -> None:
        """Write one part of these vectors, if they have it: values (m, size), or (m,) for a part of one element."""
        if part in self._at:
            self._vectors[env_ids, self._at[part]] = values if values.ndim == 2 else values[:, None]

    def mark(self, env_ids: np.ndarray, rows: np.ndarray, column: str, *, only: bool = False) -> None:
        """Write 1 into a column of one try (m,) of each of these episodes; `only`: and 0 into all others."""
        tries = self._vectors[:, self._at["tries"]].reshape(len(self._vectors), -1, self._starts[-1])
        if only:
            tries[env_ids, :, self._columns[column]] = 0.0
        tries[env_ids, rows, self._columns[column]] = 1.0

    def record(
        self,
        env_ids: np.ndarray,
        rows: np.ndarray,
        pb: np.ndarray,
        outcome: np.ndarray,
        terms: dict[str, np.ndarray],
        scale: np.ndarray,
    ) -> None:
        """Write one action of each of these episodes, (m,): which try it is, its PB vectors (m, n, n_pb), its result.

        `outcome` is an index in `ALL_OUTCOMES`, `terms` are those of `info`, `scale` is the unit of the reward [rad].
        """
        vectors, starts, reward = self._vectors, self._starts, terms["reward_novelty"]
        if "tries" in self._at:
            at, distances = self._at["tries"], terms["basic_distances"] / scale[:, None]
            _try_kernel(vectors, at.start, at.stop, starts, env_ids, rows, pb, outcome, reward, distances)
        else:
            novelty, known = terms["distance"] / scale, terms["known_distance"] / scale
            _record_kernel(vectors, starts, env_ids, pb, outcome, terms["nearest"], novelty, known, reward)

    def vectors(self) -> np.ndarray:
        """Return a copy of all observations, (n_envs, size)."""
        return self._vectors.copy()

    def vector(self, env_id: int = 0) -> np.ndarray:
        """Return a copy of one observation, (size,)."""
        return self._vectors[env_id].copy()

    def set_vector(self, env_id: int, vector: np.ndarray) -> None:
        """Replace one observation by what `vector` returned."""
        self._vectors[env_id] = vector
