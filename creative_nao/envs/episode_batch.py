"""The episodes of one or many environments: generate, execute, score, update repertoire and observation.

Every environment, single or vectorised, is a face of this one class, so that they cannot disagree.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from creative_nao.envs.archive import RepertoireArchive
from creative_nao.envs.executors import (
    NO_FIGURES,
    Execution,
    PhysicsExecutor,
    SharedScene,
    ThreadPool,
    imagined_executions,
)
from creative_nao.envs.memory_set import MemoryLike, MemorySet, RewardSpec
from creative_nao.envs.observation import CELLS, ObservationBatch, chosen_layout, observation_space
from creative_nao.envs.rollout import DECISION_TICKS, CandidateBatch, RolloutBatch
from creative_nao.envs.viewing import Recorder
from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures import Criteria
from creative_nao.measures._dtw_kernels import measure_rows
from creative_nao.measures.outcome import ALL_OUTCOMES, APPROPRIATE, NO_FAULT, OUTCOME_CODE, outcome_codes
from creative_nao.model import Memory
from creative_nao.robot import PhysicalLimits
from creative_nao.schema import Count, Index, checked

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
        n_imagined: Movements that may be imagined in an episode.
        observation: What is observed: `cells`, or the tries of the episode as far as the `Track` of this name knows.
        rehearsal: Whether a step imagines a movement, and performs one only on demand.
        drawing: `width`, `height` and `camera_name` of frames, see `Recorder`.

    Attributes:
        specs: The memory of each environment's episode.
        n_done: Actions finished in each episode, shape (n_envs,).
        n_imagined_done: Movements imagined in each episode, shape (n_envs,).

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
        n_imagined: int = 0,
        observation: str = CELLS,
        rehearsal: bool = False,
        **drawing: Any,
    ) -> None:
        self.n_actions = checked(Count, n_actions, "n_actions")
        self.n_imagined = checked(Count if rehearsal else Index, n_imagined, "n_imagined")
        self.criteria = checked(Criteria | None, criteria, "criteria") or Criteria()
        limits = checked(PhysicalLimits | None, limits, "limits")
        self.shared = SharedScene()
        self.recorder = Recorder(self.shared, render_mode, overlay, n_envs, **drawing)
        self.threads = ThreadPool(n_threads)
        self.memories = MemorySet(memory, self.criteria)
        first = self.memories.first
        n_basic, joints = first.demonstrations.n_actions, first.demonstrations.joints
        n_slow, n_decisions = 0, 1
        if modulated:
            if not isinstance(first.memory, Memory):
                raise SettingsError(
                    "`memory` should be a `creative_nao.Memory`, whose network can be stopped between ticks, "
                    f"but is a {type(first.memory).__name__}"
                )
            n_slow, n_decisions = first.memory.network.layer_sizes[-1], -(-first.n_steps // DECISION_TICKS)
        self.parts, self.columns = chosen_layout(
            observation, n_basic, first.n_pb, len(joints) if modulated else 0, n_slow,
            self.n_imagined if rehearsal else self.n_actions, n_decisions=n_decisions, rehearsal=rehearsal,
        )  # fmt: skip
        self.executor = None  # movements count as executed the way they were generated
        if limits is not None:
            self.executor = PhysicsExecutor(n_envs, self.threads, self.shared, limits, joints)
        self.observation_space = observation_space(self.parts, self.columns)
        self.observations = ObservationBatch(self.parts, n_envs, self.columns)
        self.archive = RepertoireArchive(n_envs, n_basic, first.n_steps, len(joints))
        self.n_done, self.n_imagined_done = np.zeros((2, n_envs), np.int64)
        self.specs: list[RewardSpec] = [first] * n_envs
        self._dt_s = np.zeros(n_envs)
        self._speed_limit = np.zeros((n_envs, len(joints)))
        self._excursion_limit = np.zeros(n_envs)
        for env_id in range(n_envs):
            self._use(env_id, first)
        self.rollout = RolloutBatch(self.specs, self.observations) if modulated else None
        self.candidates = CandidateBatch(n_envs, first.n_steps, len(joints), first.n_pb) if rehearsal else None
        self.n_action = first.n_pb + rehearsal

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
        self.observations.begin(env_id, spec.memory.pb)
        self.n_done[env_id] = self.n_imagined_done[env_id] = 0
        self.recorder.clear(env_id)
        for part in (self.executor, self.rollout, self.candidates):
            if part is not None:
                part.reset(env_id)

    @property
    def n_episode_steps(self) -> int:
        """Most steps of an episode."""
        return self.n_imagined if self.candidates is not None else self.n_actions * self.n_decisions

    def ended(self, env_ids: Any = slice(None)) -> Any:
        """Return whether these episodes are over, of bool; by default for all."""
        ended = self.n_done[env_ids] >= self.n_actions
        return ended if self.candidates is None else ended | (self.n_imagined_done[env_ids] >= self.n_imagined)

    def step(
        self, env_ids: np.ndarray, pb: np.ndarray
    ) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray, dict[str, np.ndarray]]:
        """Step environments: one movement each; one decision of it where the PB may change; in rehearsal imagine one.

        Args:
            env_ids: Which, shape (m,), rising.
            pb: PB vectors in [-1, 1], shape (m, n_pb); in rehearsal (m, n_pb + 1), above 0 in the end where the best
                is performed.

        Returns:
            Rewards (m,); terms of `info`, arrays over the m environments by name; places among the m of those that
            finished a movement, (k,); terms of `info` of the finished movements, arrays over those k.

        Raises:
            ShapeError: If a memory does not generate what it should.
        """
        if self.candidates is not None:
            return self._rehearse(env_ids, pb[:, :-1], np.flatnonzero(pb[:, -1] > 0.0), self.candidates)
        if self.rollout is None:
            reward, finished_terms = self._whole_movements(env_ids, pb)
            done = self.n_done[env_ids]
            self.observations.set_part(env_ids, "step", np.minimum(done / self.n_actions, 1.0))
            terms = {"pb": pb, "step": done, "n_imagined": self.n_imagined_done[env_ids]}
            return reward, terms, np.arange(len(env_ids)), finished_terms
        rollout, n = self.rollout, self.n_decisions
        rollout.advance(env_ids, pb)
        terms = {
            "pb": pb,
            "step": self.n_done[env_ids] * n + rollout.n_decided[env_ids],
            "tick": np.minimum(rollout.n_decided[env_ids] * DECISION_TICKS, self.memories.first.n_steps),
            "posture": rollout.posture[env_ids],
            "n_imagined": self.n_imagined_done[env_ids],
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
        if self.executor is not None or self.recorder.mode is not None:
            generate, order = lambda rows: (self._generate(env_ids[rows], pb[rows]),), self._by_memory(env_ids)
            (generated,) = self.threads.map_rows(generate, len(env_ids), order)
            return self._execute_and_score(env_ids, pb[:, None], generated)
        generated, *distances = self._generate_and_compare(env_ids, pb)
        return self._score(env_ids, pb[:, None], generated, distances)

    def _by_memory(self, env_ids: np.ndarray) -> Callable[[], np.ndarray] | None:
        """Return what sorts rows so that the movements of one memory are generated together, by one thread."""
        if not self.memories.names:
            return None
        return lambda: np.argsort([id(self.specs[env_id]) for env_id in env_ids], kind="stable")

    def _generate_and_compare(self, env_ids: np.ndarray, pb: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the movements of PB points (m, n_pb), or paths (m, n_steps, n_pb), and what `_compare` finds."""

        def work(rows: Any) -> tuple[np.ndarray, ...]:
            generated = self._generate(env_ids[rows], pb[rows])
            return generated, *self._compare(env_ids[rows], generated, generated)

        return self.threads.map_rows(work, len(env_ids), self._by_memory(env_ids))

    def _rehearse(
        self, env_ids: np.ndarray, pb: np.ndarray, finished: np.ndarray, candidates: CandidateBatch
    ) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray, dict[str, np.ndarray]]:
        """Imagine a movement in each environment; in the `finished` ones among the m, (k,), perform the best."""
        rows = self.n_imagined_done[env_ids]
        outcome, imagined = self._imagine(env_ids, pb)
        self.observations.record(env_ids, rows, pb[:, None], outcome, imagined, self.archive.scale[env_ids])
        value = np.where(imagined["appropriate"], imagined["reward_novelty"], -1.0)
        candidates.offer(env_ids, rows, pb, value, imagined["trajectory"])
        self.observations.mark(env_ids, candidates.row[env_ids], "candidate", only=True)
        terms = {f"imagined_{name}": values for name, values in imagined.items()}
        terms |= {"pb": pb, "step": rows + 1, "n_imagined": rows + 1}
        reward, finished_terms = np.zeros(len(env_ids)), {}
        if len(finished):
            who = env_ids[finished]
            best, performed_pb, generated = candidates.take(who)
            reward[finished], finished_terms = self._execute_and_score(who, performed_pb[:, None], generated, best)
            self.observations.mark(who, best, "performed")
            finished_terms["performed_pb"] = performed_pb
        self.observations.set_part(env_ids, "step", np.minimum(self.n_done[env_ids] / self.n_actions, 1.0))
        self.observations.set_part(env_ids, "imagined", (rows + 1) / self.n_imagined)
        return reward, terms, finished, finished_terms

    def imagine(self, env_ids: np.ndarray, pb: np.ndarray) -> dict[str, np.ndarray]:
        """Imagine, in environments (m,), PB points (m, n_pb), (m, k, n_pb) or paths (m, k, n_decisions, n_pb).

        Returns the terms of `info`, arrays (m, ...) or (m, k, ...); only the count changes. What is beyond the budget
        of one of them is a SettingsError, and nothing is imagined.
        """
        k = pb.shape[1] if pb.ndim > 2 else 1
        _, terms = self._imagine(env_ids.repeat(k), pb.reshape(-1, *pb.shape[2 if pb.ndim > 2 else 1 :]))
        if pb.ndim > 2:
            terms = {name: values.reshape(len(env_ids), k, *values.shape[1:]) for name, values in terms.items()}
        return {"pb": pb, **terms}

    def _imagine(self, env_ids: np.ndarray, pb: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        wanted = np.bincount(env_ids, minlength=len(self.n_done))
        left = self.n_imagined - self.n_imagined_done
        if (wanted > left).any():
            env_id = int((wanted > left).argmax())
            raise SettingsError(
                f"`pb` should hold at most {left[env_id]} movements to imagine, what is left of `n_imagined` "
                f"({self.n_imagined}) in this episode, but holds {wanted[env_id]}"
            )
        if pb.ndim == 3:
            pb = pb.repeat(DECISION_TICKS, axis=1)[:, : self.memories.first.n_steps]
        generated, *distances = self._generate_and_compare(env_ids, pb)
        self.n_imagined_done += wanted
        return self._judge(env_ids, generated, distances)

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
        self, env_ids: np.ndarray, pb: np.ndarray, generated: np.ndarray, rows: np.ndarray | None = None
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
        reward, terms = self._score(env_ids, pb, trajectories, distances, executions, rows)
        if executions is not None:
            terms |= {name: np.array([one.figures[name] for one in executions]) for name in executions[0].figures}
            captions = zip(terms["outcome"], terms["nearest_name"], reward, strict=True)
            for env_id, execution, (outcome, nearest, earned) in zip(env_ids, executions, captions, strict=True):
                self.recorder.record(env_id, execution, f"{outcome}, nearest {nearest}, reward {earned:.2f}")
        return reward, terms

    def _judge(
        self,
        env_ids: np.ndarray,
        trajectories: np.ndarray,
        distances: Sequence[np.ndarray],
        executions: Sequence[Execution] | None = None,
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return outcome codes (m,) and terms of `info` of movements (m, n_steps, n_joints); changes nothing."""
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
        names = [self.specs[env_id].demonstrations.names[k] for env_id, k in zip(env_ids, nearest, strict=True)]
        return outcome, {
            "outcome": _OUTCOME_NAMES[outcome],
            "appropriate": appropriate,
            "nearest": nearest,
            "nearest_name": np.array(names, object),
            "distance": distance,
            "basic_distances": to_basic.copy(),
            "known_distance": known_distance,
            "reward_novelty": np.where(appropriate, known_distance / archive.scale[env_ids], 0.0),
            "trajectory": trajectories,
        }

    def _score(
        self,
        env_ids: np.ndarray,
        pb: np.ndarray,
        trajectories: np.ndarray,
        distances: Sequence[np.ndarray],
        executions: Sequence[Execution] | None = None,
        rows: np.ndarray | None = None,
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Score movements (m, n_steps, n_joints) of PB vectors (m, n, n_pb); update repertoires and observations.

        `rows` are their rows among the tries observed, (m,). Returns the rewards, (m,), and the terms of `info`, arrays
        over the movements by name.
        """
        outcome, terms = self._judge(env_ids, trajectories, distances, executions)
        self.archive.accept(env_ids, terms["appropriate"], trajectories, distances[0])
        rows = self.n_done[env_ids] if rows is None else rows
        self.observations.record(env_ids, rows, pb, outcome, terms, self.archive.scale[env_ids])
        self.n_done[env_ids] += 1
        terms["repertoire_size"] = self.archive.sizes[env_ids] - self.archive.n_basic
        return terms["reward_novelty"].copy(), terms

    def measures(self, env_id: int) -> dict[str, float]:
        """Return the paper's three measures of an episode so far, NaN for None; see `RepertoireArchive.measures`."""
        found = self.archive.measures(env_id, int(self.n_done[env_id]))
        return {name: np.nan if value is None else value for name, value in found.items()}

    def blank_terms(self, env_ids: np.ndarray) -> dict[str, np.ndarray]:
        """Return the terms of `info` before a first movement, zeros and empty texts; {} if steps may be without one."""
        if self.rollout is not None or self.candidates is not None:
            return {}
        m, movement = len(env_ids), (len(env_ids), self.memories.first.n_steps, self.archive.n_joints)
        distances = np.zeros((m, self.archive.n_basic)), np.zeros(m, bool), np.zeros(m)
        _, terms = self._judge(env_ids, np.zeros(movement), distances)
        counts = dict.fromkeys(("step", "n_imagined", "repertoire_size"), np.zeros(m, np.int64))
        terms |= {"pb": np.zeros((m, self.n_action)), **counts}
        if self.executor is not None:
            terms |= {"commanded": np.zeros(movement), **{k: np.array([v] * m) for k, v in NO_FIGURES.items()}}
        return {k: np.full(v.shape, "", object) if v.dtype == object else np.zeros_like(v) for k, v in terms.items()}

    def get_state(self, env_id: int) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Return the state of one episode as JSON-able values and arrays, for `set_state`."""
        values: dict[str, Any] = {"memory": self.specs[env_id].name, "n_actions": int(self.n_done[env_id])}
        values["n_imagined"] = int(self.n_imagined_done[env_id])
        arrays = {"observation": self.observations.vector(env_id), **self.archive.get_state(env_id)}
        if self.executor is not None:
            arrays |= self.executor.get_state(env_id)
        for part in (self.rollout, self.candidates):
            if part is not None:
                more_values, more_arrays = part.get_state(env_id)
                values, arrays = values | more_values, arrays | more_arrays
        return values, arrays

    def set_state(self, env_id: int, values: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        """Restore what `get_state` returned; the errors are those of `MemorySet.named` and `RolloutBatch.set_state`."""
        for name, most in (("n_imagined", self.n_imagined), ("n_actions", self.n_actions)):
            if values[name] > most:
                raise SettingsError(
                    f"`state`: its `{name}` should be at most {most}, the budget here, but is {values[name]}"
                )
        self._use(env_id, self.memories.named(values["memory"], "`state`"))
        self.n_done[env_id], self.n_imagined_done[env_id] = values["n_actions"], values["n_imagined"]
        self.observations.set_vector(env_id, arrays["observation"])
        self.archive.set_state(env_id, arrays)
        self.recorder.clear(env_id)
        if self.executor is not None:
            self.executor.set_state(env_id, arrays)
        for part in (self.rollout, self.candidates):
            if part is not None:
                part.set_state(env_id, values, arrays)

    def close(self) -> None:
        """End the threads and free what drawing took; may be called again."""
        self.threads.close()
        self.recorder.close()
