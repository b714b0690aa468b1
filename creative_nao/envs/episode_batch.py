"""The episodes of one or many environments: generate, execute, score, update repertoire and observation.

Every environment, single or vectorised, is a face of this one class, so that they cannot disagree.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from creative_nao.envs.archive import RepertoireArchive
from creative_nao.envs.executors import (
    Execution,
    PhysicsExecutor,
    SharedScene,
    ThreadPool,
    imagined_executions,
)
from creative_nao.envs.memory_set import MemoryLike, MemorySet, RewardSpec
from creative_nao.envs.observation import ObservationBatch, layout, observation_space
from creative_nao.envs.rollout import DECISION_TICKS, RolloutBatch
from creative_nao.envs.viewing import Recorder
from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures import Criteria
from creative_nao.measures._dtw_kernels import measure_rows
from creative_nao.measures.outcome import ALL_OUTCOMES, APPROPRIATE, NO_FAULT, OUTCOME_CODE, outcome_codes
from creative_nao.model import Memory
from creative_nao.robot import PhysicalLimits
from creative_nao.schema import Count, checked

EPISODE_ACTIONS = 30
"""Actions in an episode: the sample size of the paper's measures."""
_OUTCOME_NAMES = np.array(ALL_OUTCOMES, dtype=object)


class EpisodeBatch:
    """The episodes of `n_envs` environments.

    Args:
        memory: See `MemorySet`.
        n_envs: How many environments.
        n_actions: Actions in an episode.
        criteria: Where the lines between outcomes are drawn; default: the paper's.
        modulated: Whether the PB may change during a movement; a step is then a decision, else a whole movement.
        limits: From where on a performance counts as failed; None: movements are not performed in physics.
        n_threads: Threads; None for one a processor core.
        render_mode: See `Recorder`.
        overlay: Whether colour frames carry a caption.

    Attributes:
        specs: The memory of each environment's episode.
        n_done: Actions finished in each episode, shape (n_envs,).

    Raises:
        NotFoundError: If there is no such memory.
        SettingsError: If an argument is of a wrong kind or out of range, or the memory does not suit.
    """

    def __init__(
        self,
        memory: MemoryLike,
        n_envs: int = 1,
        n_actions: int = EPISODE_ACTIONS,
        criteria: Criteria | None = None,
        *,
        modulated: bool = False,
        limits: PhysicalLimits | None = None,
        n_threads: int | None = 1,
        render_mode: str | None = None,
        overlay: bool = False,
    ) -> None:
        self.n_actions = checked(Count, n_actions, "n_actions")
        self.criteria = checked(Criteria | None, criteria, "criteria") or Criteria()
        limits = checked(PhysicalLimits | None, limits, "limits")
        self.shared = SharedScene()
        self.recorder = Recorder(self.shared, render_mode, overlay, n_envs)
        self.threads = ThreadPool(n_threads)
        self.memories = MemorySet(memory, self.criteria)
        first = self.memories.first
        n_basic, joints = first.demonstrations.n_actions, first.demonstrations.joints
        self.parts = layout(n_basic, first.n_pb)
        if modulated:
            if not isinstance(first.memory, Memory):
                raise SettingsError(
                    "`memory` should be a `creative_nao.Memory`, whose network can be stopped between ticks, "
                    f"but is a {type(first.memory).__name__}"
                )
            self.parts = layout(n_basic, first.n_pb, len(joints), first.memory.network.layer_sizes[-1])
        self.executor = None  # movements count as executed the way they were generated
        if limits is not None:
            self.executor = PhysicsExecutor(n_envs, self.threads, self.shared, limits, joints)
        self.observation_space = observation_space(self.parts)
        self.observations = ObservationBatch(self.parts, n_envs)
        self.archive = RepertoireArchive(n_envs, n_basic, first.n_steps, len(joints))
        self.n_done = np.zeros(n_envs, np.int64)
        self.specs: list[RewardSpec] = [first] * n_envs
        self._dt_s = np.zeros(n_envs)
        self._speed_limit = np.zeros((n_envs, len(joints)))
        self._excursion_limit = np.zeros(n_envs)
        for env_id in range(n_envs):
            self._use(env_id, first)
        self.rollout = RolloutBatch(self.specs, self.observations) if modulated else None

    @property
    def n_decisions(self) -> int:
        """Steps that one action takes."""
        return 1 if self.rollout is None else self.rollout.n_decisions

    def _use(self, env_id: int, spec: RewardSpec) -> None:
        """Give an environment this memory and an empty repertoire."""
        self.specs[env_id] = spec
        self.archive.set_basic_actions(env_id, spec.demonstrations, spec.scale)
        self._dt_s[env_id] = spec.demonstrations.dt_s
        self._speed_limit[env_id] = spec.speed_limit
        self._excursion_limit[env_id] = spec.excursion_limit

    def reset(self, env_id: int, wanted: str | None, rng: Callable[[], np.random.Generator]) -> None:
        """Begin an episode, with the memory named `wanted` (NotFoundError: not here) or one drawn with `rng()`."""
        spec = self.memories.draw(rng) if wanted is None else self.memories.named(wanted)
        if spec is self.specs[env_id]:
            self.archive.clear(env_id)
        else:
            self._use(env_id, spec)
        self.observations.clear(env_id)
        self.n_done[env_id] = 0
        self.recorder.clear(env_id)
        if self.executor is not None:
            self.executor.reset(env_id)
        if self.rollout is not None:
            self.rollout.reset(env_id)

    def step(
        self, env_ids: np.ndarray, pb: np.ndarray
    ) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray, dict[str, np.ndarray]]:
        """Step environments: one movement each, or one decision where the PB may change during a movement.

        Args:
            env_ids: Which, shape (m,), rising.
            pb: PB vectors in [-1, 1], shape (m, n_pb).

        Returns:
            Rewards (m,); terms of `info`, arrays over the m environments by name; places among the m of those that
            finished a movement, (k,); terms of `info` of the finished movements, arrays over those k.

        Raises:
            ShapeError: If a memory does not generate what it should.
        """
        if self.rollout is None:
            reward, finished_terms = self._whole_movements(env_ids, pb)
            done = self.n_done[env_ids]
            self.observations.set_part(env_ids, "step", np.minimum(done / self.n_actions, 1.0))
            return reward, {"pb": pb, "step": done}, np.arange(len(env_ids)), finished_terms
        rollout, n = self.rollout, self.n_decisions
        rollout.advance(env_ids, pb)
        terms = {
            "pb": pb,
            "step": self.n_done[env_ids] * n + rollout.n_decided[env_ids],
            "tick": np.minimum(rollout.n_decided[env_ids] * DECISION_TICKS, self.memories.first.n_steps),
            "posture": rollout.posture[env_ids],
        }
        reward, finished_terms = np.zeros(len(env_ids)), {}
        (finished,) = (rollout.n_decided[env_ids] == n).nonzero()
        if len(finished):
            who = env_ids[finished]
            paths, generated = rollout.pb[who], rollout.angles[who]
            reward[finished], finished_terms = self._execute_and_score(who, paths, generated)
            finished_terms["pb_path"] = paths
            for env_id in who:
                rollout.next_movement(env_id)
        progress = (self.n_done[env_ids] + rollout.n_decided[env_ids] / n) / self.n_actions
        self.observations.set_part(env_ids, "pb", pb)
        self.observations.set_part(env_ids, "step", np.minimum(progress, 1.0))
        rollout.observe(env_ids)
        return reward, terms, finished, finished_terms

    def _whole_movements(self, env_ids: np.ndarray, pb: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        def by_memory() -> np.ndarray:  # the movements of one memory are generated together, so by one thread
            return np.argsort([id(self.specs[env_id]) for env_id in env_ids], kind="stable")

        def generate(rows: Any) -> tuple[np.ndarray]:
            return (self._generate(env_ids[rows], pb[rows]),)

        def generate_and_compare(rows: Any) -> tuple[np.ndarray, ...]:
            generated = self._generate(env_ids[rows], pb[rows])
            return generated, *self._compare(env_ids[rows], generated, generated)

        order = by_memory if self.memories.names else None
        if self.executor is not None or self.recorder.mode is not None:
            (generated,) = self.threads.map_rows(generate, len(env_ids), order)
            return self._execute_and_score(env_ids, pb[:, None], generated)
        generated, *distances = self.threads.map_rows(generate_and_compare, len(env_ids), order)
        return self._score(env_ids, pb[:, None], generated, distances)

    def _generate(self, env_ids: np.ndarray, pb: np.ndarray) -> np.ndarray:
        """Return the movements (m, n_steps, n_joints) of PB points, each by the memory of its environment."""
        first = self.specs[env_ids[0]]
        if all(self.specs[env_id] is first for env_id in env_ids):
            return first.generate(pb)
        out = np.empty((len(env_ids), first.n_steps, len(first.demonstrations.joints)))
        groups: dict[str, list[int]] = {}
        for row, env_id in enumerate(env_ids):
            groups.setdefault(self.specs[env_id].name, []).append(row)
        for rows in groups.values():
            out[rows] = self.specs[env_ids[rows[0]]].generate(pb[rows])
        return out

    def _compare(
        self, env_ids: np.ndarray, generated: np.ndarray, trajectories: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return of movements as commanded and as executed, both (m, n_steps, n_joints), what `_score` asks for.

        These are the DTW distances to everything known [rad], (m, lanes); whether a joint is too fast, (m,) of bool;
        how far the most moving joint travels [rad], (m,). Changes nothing, so that threads may share the work.
        """
        too_fast, excursion = np.zeros(len(env_ids), bool), np.zeros(len(env_ids))
        bad = measure_rows(env_ids, generated, trajectories, self._dt_s, self._speed_limit, too_fast, excursion)
        if bad >= 0:
            raise ShapeError(
                f"a memory should generate, and a robot measure, finite angles, but movement {bad} of "
                f"{len(env_ids)} holds one that is not"
            )
        return self.archive.compare(env_ids, trajectories), too_fast, excursion

    def _execute_and_score(
        self, env_ids: np.ndarray, pb: np.ndarray, generated: np.ndarray
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        dt_s = self._dt_s[env_ids].tolist()
        shown, executions = self.recorder.mode is not None, None
        if self.executor is not None:
            executions = self.executor.execute(env_ids, generated, dt_s, shown)
        elif shown:
            executions = imagined_executions(self.shared, self.memories.first.demonstrations.joints, generated, dt_s)
        trajectories = generated if executions is None else np.stack([one.trajectory for one in executions])
        distances = self.threads.map_rows(
            lambda rows: self._compare(env_ids[rows], generated[rows], trajectories[rows]), len(env_ids)
        )
        reward, terms = self._score(env_ids, pb, trajectories, distances, executions)
        if executions is not None:
            terms |= {name: np.array([one.figures[name] for one in executions]) for name in executions[0].figures}
            captions = zip(terms["outcome"], terms["nearest_name"], reward, strict=True)
            for env_id, execution, (outcome, nearest, earned) in zip(env_ids, executions, captions, strict=True):
                self.recorder.record(env_id, execution, f"{outcome}, nearest {nearest}, reward {earned:.2f}")
        return reward, terms

    def _score(
        self,
        env_ids: np.ndarray,
        pb: np.ndarray,
        trajectories: np.ndarray,
        distances: Sequence[np.ndarray],
        executions: Sequence[Execution] | None = None,
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Score movements (m, n_steps, n_joints) of PB vectors (m, n, n_pb); update repertoires and observations.

        Returns the rewards, (m,), and the terms of `info`, arrays over the movements by name.
        """
        archive, fault = self.archive, None
        if executions is not None:
            fault = np.array([NO_FAULT if one.fault is None else OUTCOME_CODE[one.fault] for one in executions])
        to_known, too_fast, excursion = distances
        to_basic = to_known[:, : archive.n_basic]
        nearest, distance, known_distance = to_basic.argmin(axis=1), to_basic.min(axis=1), to_known.min(axis=1)
        outcome = outcome_codes(
            distance,
            too_fast=too_fast,
            non_moving=excursion < self._excursion_limit[env_ids],
            fault=fault,
            learned_threshold=self.criteria.learned_threshold,
        )
        appropriate = outcome < len(APPROPRIATE)
        scale = archive.scale[env_ids]
        known = known_distance / scale
        reward = np.where(appropriate, known, 0.0)
        archive.accept(env_ids, appropriate, trajectories, to_known)
        self.n_done[env_ids] += 1
        self.observations.record_action(
            env_ids, pb=pb, outcome=outcome, nearest=nearest, novelty=distance / scale, known=known, reward=reward
        )
        names = [self.specs[env_id].demonstrations.names[k] for env_id, k in zip(env_ids, nearest, strict=True)]
        terms = {
            "outcome": _OUTCOME_NAMES[outcome],
            "appropriate": appropriate,
            "nearest": nearest,
            "nearest_name": np.array(names, object),
            "distance": distance,
            "known_distance": known_distance,
            "reward_novelty": reward.copy(),
            "repertoire_size": archive.sizes[env_ids] - archive.n_basic,
            "trajectory": trajectories,
        }
        return reward, terms

    def measures(self, env_id: int) -> dict[str, float | None]:
        """Return the paper's three measures of an episode so far; see `RepertoireArchive.measures`."""
        return self.archive.measures(env_id, int(self.n_done[env_id]))

    def get_state(self, env_id: int) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Return the state of one episode as JSON-able values and arrays, for `set_state`."""
        values: dict[str, Any] = {"memory": self.specs[env_id].name, "n_actions": int(self.n_done[env_id])}
        arrays = {"observation": self.observations.vector(env_id), **self.archive.get_state(env_id)}
        if self.executor is not None:
            arrays |= self.executor.get_state(env_id)
        if self.rollout is not None:
            more_values, more_arrays = self.rollout.get_state(env_id)
            values, arrays = values | more_values, arrays | more_arrays
        return values, arrays

    def set_state(self, env_id: int, values: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        """Restore what `get_state` returned; the errors are those of `MemorySet.named` and `RolloutBatch.set_state`."""
        self._use(env_id, self.memories.named(values["memory"], "`state`"))
        self.n_done[env_id] = values["n_actions"]
        self.observations.set_vector(env_id, arrays["observation"])
        self.archive.set_state(env_id, arrays)
        self.recorder.clear(env_id)
        if self.executor is not None:
            self.executor.set_state(env_id, arrays)
        if self.rollout is not None:
            self.rollout.set_state(env_id, values, arrays)

    def close(self) -> None:
        """End the threads and free what drawing took; may be called again."""
        self.threads.close()
        self.recorder.close()
