"""Which basic action a new one resembles in each stretch of time, so that it can be read: first this, then that.

The definition in full. A *window* of fixed length slides over the trajectory tick by tick. Each window is *aligned*
with each basic action by subsequence DTW: it may lie anywhere on the action and, within, be slower or faster; the cost
is the smallest sum of Euclidean distances of postures along a path that uses every posture of the window, divided by
the number of its postures: the mean distance at which the action is followed [rad]. A *tick's distance* from an action
is that of the best window that contains the tick. So a tick close to a seam is judged by the window on its own side,
and the seam is not smeared over a window's length.

At rest all actions are in the same guard and equally near: there `margin` is small, and the answer means little.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures.dtw import MAX_VALUE, as_numbers, refuse_where
from creative_nao.measures.outcome import BasicActions, check_basic_actions
from creative_nao.schema import NonNegative, Positive, checked

WINDOW_S = 1.5
"""About one punch and its way back."""

SWITCH_COST = 1.0  # what another basic action has to be nearer by, summed over its ticks, to be named for a while [rad]


class Stretch(NamedTuple):
    """Ticks from `first` up to, but without, `end`: they resemble one basic action at a mean `distance` [rad]."""

    first: int
    end: int
    action: int
    distance: float


@dataclass(frozen=True, eq=False)
class Attribution:
    """How each tick of a trajectory resembles each basic action, with windows of `window_steps` ticks of `dt_s` [s]."""

    distances: np.ndarray = field(repr=False)
    """Distance per posture of each tick's best window from each basic action [rad], (n_steps, n_actions)."""
    window_steps: int
    dt_s: float

    def __len__(self) -> int:
        return len(self.distances)

    @property
    def nearest(self) -> np.ndarray:
        """The basic action that each tick resembles most, shape (n_steps,) of int."""
        return self.distances.argmin(axis=1)

    @property
    def distance(self) -> np.ndarray:
        """Its distance [rad], shape (n_steps,)."""
        return self.distances.min(axis=1)

    @property
    def margin(self) -> np.ndarray:
        """How much farther the next basic action is [rad], shape (n_steps,); infinite if there is only one."""
        if self.distances.shape[1] == 1:
            return np.full(len(self), np.inf)
        ranked = np.sort(self.distances, axis=1)
        return ranked[:, 1] - ranked[:, 0]

    def stretches(self, switch_cost: float = SWITCH_COST) -> list[Stretch]:
        """Read the trajectory as a sequence of basic actions, without the flicker of `nearest`.

        Of all ways to name an action for each tick, the one whose distances, summed over the ticks, plus `switch_cost`
        [rad], 0 or more, for each change of the action are smallest; with 0 the result is `nearest`.
        """
        switch_cost = checked(NonNegative, switch_cost, "switch_cost")
        total = self.distances[0].copy()
        came_from = np.zeros(self.distances.shape, dtype=np.int64)
        stay = np.arange(len(total))
        for t in range(1, len(self)):
            best = int(total.argmin())
            change = total[best] + switch_cost < total
            came_from[t] = np.where(change, best, stay)
            total = np.where(change, total[best] + switch_cost, total) + self.distances[t]
        named = np.empty(len(self), dtype=np.int64)
        named[-1] = total.argmin()
        for t in range(len(self) - 1, 0, -1):
            named[t - 1] = came_from[t, named[t]]
        cuts = [0, *(np.flatnonzero(np.diff(named)) + 1).tolist(), len(self)]
        return [
            Stretch(first, end, int(named[first]), float(self.distances[first:end, named[first]].mean()))
            for first, end in itertools.pairwise(cuts)
        ]


def attribution(trajectory: ArrayLike, demos: BasicActions, window_s: float = WINDOW_S) -> Attribution:
    """Tell for each tick of a trajectory which basic action it resembles; the module's text defines how.

    The trajectory is (n_steps, n_joints) [rad] at the tick of `demos`. The window of `window_s` [s] is rounded to whole
    ticks, at least two; a trajectory shorter than that is one window.

    Raises:
        ShapeError: If `trajectory` is not finite, is empty or does not have the joints of the basic actions.

    Example:
        >>> from creative_nao.demonstrations import load_demonstrations
        >>> demos = load_demonstrations()
        >>> jab_then_uppercut = np.concatenate([demos.trajectories[0][:25], demos.trajectories[5][25:]])
        >>> [(demos.names[s.action], s.first) for s in attribution(jab_then_uppercut, demos).stretches()]
        [('left_jab', 0), ('right_uppercut', 25)]
    """
    check_basic_actions(demos)
    angles = as_numbers(trajectory, "trajectory")
    n_joints = demos.trajectories[0].shape[1]
    if angles.ndim != 2 or not len(angles) or angles.shape[1] != n_joints:
        raise ShapeError(
            f"`trajectory` should have shape (n_steps, {n_joints}), the joints of the basic actions, but has "
            f"{angles.shape}."
        )
    refuse_where(~(np.abs(angles) <= MAX_VALUE), angles, "trajectory", f"finite values up to {MAX_VALUE:g}")
    if round(checked(Positive, window_s, "window_s") / demos.dt_s) < 2:
        raise SettingsError(
            f"`window_s` should be at least two ticks, {2 * demos.dt_s:g} s, but is {window_s}; a posture alone is no "
            "movement."
        )
    n_window = min(round(window_s / demos.dt_s), len(angles))
    of_windows = _aligned(angles, [np.asarray(action) for action in demos.trajectories], n_window)
    padded = np.pad(of_windows, ((n_window - 1, n_window - 1), (0, 0)), constant_values=np.inf)
    # Tick t lies in the windows that begin from t - n_window + 1 to t.
    of_ticks = np.lib.stride_tricks.sliding_window_view(padded, n_window, axis=0).min(axis=-1)
    return Attribution(of_ticks, n_window, demos.dt_s)


def _aligned(angles: np.ndarray, actions: list[np.ndarray], n_window: int) -> np.ndarray:
    """Return the cost of each window of `angles` on its best place of each action, per posture, (n_windows, n_actions).

    All windows and actions are computed at once: beginning and end on an action are free.
    """
    shape = max(map(len, actions)), len(angles), len(actions)
    cost = np.full(shape, np.inf)  # beyond its end, an action has no place
    for place, action in enumerate(actions):
        cost[: len(action), :, place] = np.linalg.norm(action[:, None, :] - angles[None, :, :], axis=2)
    n_windows = len(angles) - n_window + 1
    row = cost[:, :n_windows].copy()  # the window's first posture anywhere on the action
    for i in range(1, n_window):
        here = cost[:, i : i + n_windows]
        before, row = row, np.empty_like(row)
        row[0] = before[0] + here[0]
        for j in range(1, len(cost)):
            np.minimum(before[j], before[j - 1], out=row[j])
            np.minimum(row[j], row[j - 1], out=row[j])
            row[j] += here[j]
    return row.min(axis=0) / n_window
