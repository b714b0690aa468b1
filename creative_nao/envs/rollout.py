"""What lasts from step to step beside the repertoire: movements under way, and movements that wait to be performed.

- `RolloutBatch`: the PB may change every few ticks of a movement, the state of the network goes on.
- `CandidateBatch`: the best movement imagined since the last performance.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from creative_nao.envs.memory_set import RewardSpec
from creative_nao.envs.observation import ObservationBatch
from creative_nao.envs.state import NETWORK_ARRAYS
from creative_nao.errors import SettingsError
from creative_nao.model.generation import ClosedLoopGenerator, Rollout

DECISION_TICKS = 5
"""Ticks from one decision about the PB to the next."""


def held_in_turn(points: np.ndarray, n_segments: int, n_decisions: int) -> np.ndarray:
    """Return the PB vectors of all decisions, (n, n_decisions, n_pb), of movements of a few PB vectors each.

    `points` (n, n_segments * n_pb) are these, one after the other; each is held for an equal share of the decisions.
    """
    segments = points.reshape(len(points), n_segments, points.shape[1] // n_segments)
    return segments[:, np.arange(n_decisions) * n_segments // n_decisions]


class RolloutBatch:
    """The movements under way of one or many environments, one each.

    Args:
        specs: Memory of each environment's episode; this very list is read again whenever a movement begins.
        observations: Where posture, P_S and phase are written.

    Attributes:
        n_decisions: Decisions of a movement; the last one holds for what is left of it.
        n_decided: Decisions taken in the movement under way, shape (n_envs,).
        angles: The movements as far as they are generated [rad], shape (n_envs, n_steps, n_joints).
        pb: Their PB vectors, shape (n_envs, n_decisions, n_pb).
        posture: Where the joints stand [rad], shape (n_envs, n_joints).
    """

    def __init__(self, specs: list[RewardSpec], observations: ObservationBatch) -> None:
        first = specs[0]
        n_envs, n_joints = len(specs), len(first.demonstrations.joints)
        self._specs, self._observations = specs, observations
        self._n_steps = first.n_steps
        self.n_decisions = -(-first.n_steps // DECISION_TICKS)
        self.n_decided = np.zeros(n_envs, np.int64)
        self.angles = np.zeros((n_envs, first.n_steps, n_joints))
        self.pb = np.zeros((n_envs, self.n_decisions, first.n_pb))
        references = first.memory.encoding.references
        self._low, self._high = references[:, 0], references[:, -1]
        self._under_way: list[Rollout] = [self._generator(env_id).begin(1) for env_id in range(n_envs)]
        self.posture = np.zeros((n_envs, n_joints))
        for env_id in range(n_envs):
            self.reset(env_id)

    def _generator(self, env_id: int) -> ClosedLoopGenerator:
        return self._specs[env_id].memory.generator

    def reset(self, env_id: int) -> None:
        """Begin an episode: the robot stands in its initial posture, and its observation shows it."""
        self.next_movement(env_id)
        self.posture[env_id] = self._specs[env_id].demonstrations.initial_posture
        self.observe(np.array([env_id]))

    def next_movement(self, env_id: int) -> None:
        """Begin the next movement, with the network at rest."""
        self.n_decided[env_id] = 0
        self._under_way[env_id] = self._generator(env_id).begin(1)

    def advance(self, env_ids: np.ndarray, pb: np.ndarray) -> None:
        """Generate these movements until their next decision, under PB vectors (m, n_pb)."""
        for env_id, point in zip(env_ids, pb, strict=True):
            under_way, decided = self._under_way[env_id], self.n_decided[env_id]
            first = under_way.tick
            n_ticks = min(DECISION_TICKS, self._n_steps - first)
            angles = self._generator(env_id).advance(under_way, point[None], n_ticks)[0]
            self.angles[env_id, first : first + n_ticks] = angles
            self.posture[env_id] = angles[-1]
            self.pb[env_id, decided] = point
            self.n_decided[env_id] = decided + 1

    def observe(self, env_ids: np.ndarray) -> None:
        """Write posture, P_S, phase and the PB vectors so far into the observations."""
        observations = self._observations
        if observations.has("path"):
            decided = np.arange(self.n_decisions) < self.n_decided[env_ids, None]
            path = np.where(decided[:, :, None], self.pb[env_ids], 0.0)
            observations.set_part(env_ids, "path", path.reshape(len(env_ids), -1))
        share = 2.0 * (self.posture[env_ids] - self._low) / (self._high - self._low) - 1.0
        observations.set_part(env_ids, "posture", np.minimum(np.maximum(share, -1.0), 1.0))
        n_slow = self._generator(0).n_slow
        slow = np.concatenate([self._under_way[env_id].activity[:, -n_slow:] for env_id in env_ids])
        observations.set_part(env_ids, "slow", np.minimum(np.maximum(slow, -1.0), 1.0))
        observations.set_part(env_ids, "phase", self.n_decided[env_ids] / self.n_decisions)

    def get_state(self, env_id: int) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Return a movement under way as JSON-able values and arrays, for `set_state`."""
        under_way = self._under_way[env_id]
        values = {"n_decided": int(self.n_decided[env_id]), "tick": under_way.tick}
        network = zip(NETWORK_ARRAYS, (under_way.code, under_way.state, under_way.activity), strict=True)
        mine = {"unfolded": self.angles[env_id], "pb_path": self.pb[env_id], "posture": self.posture[env_id]}
        return values, {name: array.copy() for name, array in (*network, *mine.items())}

    def set_state(self, env_id: int, values: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        """Restore what `get_state` returned; one that does not fit the memory in place raises SettingsError."""
        decided, tick = values["n_decided"], values["tick"]
        if decided >= self.n_decisions or tick != min(decided * DECISION_TICKS, self._n_steps):
            raise SettingsError(
                f"`state`: its `n_decided` should be below {self.n_decisions}, its `tick` {DECISION_TICKS} times that, "
                f"but they are {decided} and {tick}"
            )
        rest = self._generator(env_id).begin(1)
        for name, array in zip(NETWORK_ARRAYS, (rest.code, rest.state, rest.activity), strict=True):
            if arrays[name].shape != array.shape:
                raise SettingsError(
                    f"`state`: its array `{name}` should have shape {array.shape}, but has {arrays[name].shape}"
                )
        self.n_decided[env_id] = decided
        self._under_way[env_id] = Rollout(tick, *(arrays[name].copy() for name in NETWORK_ARRAYS))
        self.angles[env_id] = arrays["unfolded"]
        self.pb[env_id] = arrays["pb_path"]
        self.posture[env_id] = arrays["posture"]


class CandidateBatch:
    """The best movement that each of `n_envs` robots imagined since it performed one; if none is usable, the last.

    Attributes:
        row: The how manieth imagined movement of the episode it is, from 0; -1 before there is one, shape (n_envs,).
    """

    def __init__(self, n_envs: int, n_steps: int, n_joints: int, n_pb: int) -> None:
        self.row = np.full(n_envs, -1)
        self._value = np.full(n_envs, -1.0)
        self._pb = np.zeros((n_envs, n_pb))
        self._trajectory = np.zeros((n_envs, n_steps, n_joints))

    def reset(self, env_ids: Any) -> None:
        """Forget the candidates of these robots."""
        self.row[env_ids], self._value[env_ids] = -1, -1.0

    def offer(
        self, env_ids: np.ndarray, rows: np.ndarray, pb: np.ndarray, value: np.ndarray, trajectories: np.ndarray
    ) -> None:
        """Take what was imagined where it is worth more than the candidate; `value` (m,) is -1 if it is not usable."""
        better = (value > self._value[env_ids]) | (self._value[env_ids] < 0.0)
        who = env_ids[better]
        self.row[who], self._value[who] = rows[better], value[better]
        self._pb[who], self._trajectory[who] = pb[better], trajectories[better]

    def take(self, env_ids: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rows (m,), PB vectors (m, n_pb) and movements (m, n_steps, n_joints) of candidates; forget them."""
        taken = self.row[env_ids], self._pb[env_ids], self._trajectory[env_ids]
        self.reset(env_ids)
        return taken

    def get_state(self, env_id: int) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Return a candidate as JSON-able values and arrays, for `set_state`."""
        arrays = {"candidate_pb": self._pb[env_id], "candidate_trajectory": self._trajectory[env_id]}
        arrays["candidate_value"] = self._value[env_id : env_id + 1]
        return {"candidate": int(self.row[env_id]) + 1}, {name: array.copy() for name, array in arrays.items()}

    def set_state(self, env_id: int, values: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        """Restore what `get_state` returned; a candidate that was not imagined raises SettingsError."""
        if values["candidate"] > values["n_imagined"]:
            raise SettingsError(
                f"`state`: its `candidate` should be at most its `n_imagined`, {values['n_imagined']}, "
                f"but is {values['candidate']}"
            )
        self.row[env_id] = values["candidate"] - 1
        self._value[env_id] = arrays["candidate_value"][0]
        self._pb[env_id], self._trajectory[env_id] = arrays["candidate_pb"], arrays["candidate_trajectory"]
