"""Train an agent of Stable-Baselines3 or sb3-contrib: judged on validation memories while it learns, and resumable.

A training goes on from a checkpoint with the same bits as if it had never stopped. The weights kept are those of the
evaluation with the highest mean reward.

Also here:
- The callback that watches a training: it records, judges, writes checkpoints and stops when asked to.
"""

from __future__ import annotations

import csv
import dataclasses
import io
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao import storage
from creative_nao.agents.adapters import PolicyAgent
from creative_nao.agents.algorithms import find_algorithm
from creative_nao.agents.play import check_env, evaluate_agent
from creative_nao.agents.settings import Hyperparameters, resolve_policy_kwargs, schedule
from creative_nao.agents.training_state import (
    TrainingRecord,
    TrainingState,
    capture,
    check_weights,
    restore,
    restore_random,
)
from creative_nao.errors import FileFormatError, MissingDependencyError, SettingsError
from creative_nao.model import SPLITS, split_memories
from creative_nao.storage import read_text


def _rows(path: Path) -> list[dict[str, Any]]:
    text = read_text(path, "log of a training")
    try:
        rows = [dict(row) for row in csv.DictReader(io.StringIO(text, newline=""))]
    except csv.Error as error:
        raise FileFormatError(f"{path}: not a log of a training: {error}") from None
    for row in rows:
        if None in row or not (row.get("n_decisions") or "0").isdecimal():
            raise FileFormatError(f"{path}: not a log of a training: `n_decisions` is {row.get('n_decisions')!r:.40}")
    return rows


def watch(
    plan: TrainingPlan,
    record: TrainingRecord,
    state: TrainingState | None,
    *,
    judge: Callable[[], tuple[float, ...]],
    checkpoint: Path | None,
    tensorboard: Path | None,
    logs: Path | None,
    progress: Callable[[TrainingRecord, int], None] | None,
    stop: threading.Event,
) -> Any:
    """Return the callback; Stable-Baselines3 is loaded here."""
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.logger import KVWriter, Logger, TensorBoardOutputFormat

    on_policy = find_algorithm(plan.hyperparameters.algorithm).on_policy

    class ProgressTable(KVWriter):
        """Keeps what the algorithm logs as the rows of one CSV file."""

        def __init__(self, path: Path, n_decisions: int) -> None:
            self.path = path
            self.rows: list[dict[str, Any]] = []
            if n_decisions and path.is_file():
                # The row of the very decision at which the checkpoint was made was written before it.
                self.rows = [row for row in _rows(path) if int(row.get("n_decisions") or 0) <= n_decisions]

        def write(self, key_values: dict[str, Any], key_excluded: dict[str, Any], step: int = 0) -> None:
            self.rows.append({"n_decisions": step, **_numbers(key_values)})
            heads = list(dict.fromkeys(head for row in self.rows for head in row))
            text = io.StringIO()
            writer = csv.DictWriter(text, heads, lineterminator="\n")
            writer.writeheader()
            writer.writerows(self.rows)
            storage.write_text(self.path, text.getvalue())

        def close(self) -> None:
            """Nothing is kept open."""

    class Watch(BaseCallback):
        def __init__(self) -> None:
            super().__init__()
            self.fresh = state is not None
            self.kept: TrainingState | None = None
            self.saved = -1

        def prepare(self, model: Any) -> int:
            """Put the model into the state of the checkpoint, attach the logs; return the decisions already made."""
            if state is not None:
                restore(model, state)
                check_weights(record.best_weights, model.policy)
            self.saved = model.num_timesteps if state is not None else -1
            writers: list[KVWriter] = []
            if logs is not None:
                logs.parent.mkdir(parents=True, exist_ok=True)
                writers.append(ProgressTable(logs, model.num_timesteps))
            if tensorboard is not None:
                tensorboard.mkdir(parents=True, exist_ok=True)
                writers.append(TensorBoardOutputFormat(str(tensorboard)))
            model.set_logger(Logger(str(logs.parent) if logs else None, writers))
            if state is not None:
                _log_again(model.logger, state)
            return model.num_timesteps

        def finish(self, model: Any) -> None:
            """Judge the last weights, keep the final state, and put the best weights into the policy."""
            self.model = model
            self._judge_if_due(last=True)
            if checkpoint is not None and self.saved < model.num_timesteps:
                record.save(checkpoint, plan.as_json(), _whole_state(model))
            import torch

            model.policy.load_state_dict({k: torch.from_numpy(v.copy()) for k, v in record.best_weights.items()})
            model.policy.set_training_mode(False)
            model.logger.close()

        def _on_rollout_start(self) -> None:
            if self.fresh:
                assert state is not None
                restore_random(self.model, state)
                self.fresh = False
            elif stop.is_set():
                self._leave(_whole_state(self.model))
            self._judge_if_due()
            n_done = self.model.num_timesteps
            if progress is not None:
                progress(record, n_done)
            due = n_done // plan.checkpoint_interval > max(self.saved, 0) // plan.checkpoint_interval
            if checkpoint is not None and (on_policy or due):
                self.kept = _whole_state(self.model)
                if due:
                    record.save(checkpoint, plan.as_json(), self.kept)
                    self.saved = n_done

        def _on_step(self) -> bool:
            if on_policy and stop.is_set():
                kept = self.kept
                if kept is not None:
                    n_done = kept.values["num_timesteps"]
                    while record.episode_ends and record.episode_ends[-1] > n_done:
                        record.episode_ends.pop()
                        record.episode_rewards.pop()
                self._leave(kept)
            for info in self.locals["infos"]:
                if "episode" in info:
                    record.episode_ends.append(self.num_timesteps)
                    record.episode_rewards.append(float(info["episode"]["r"]))
            return True

        def _leave(self, kept: TrainingState | None) -> None:
            if checkpoint is not None and kept is not None:
                record.save(checkpoint, plan.as_json(), kept)
            raise KeyboardInterrupt

        def _judge_if_due(self, last: bool = False) -> None:
            n_done, interval = self.model.num_timesteps, plan.evaluation_interval
            ends = record.evaluation_ends
            if ends and (ends[-1] == n_done or (not last and n_done // interval <= ends[-1] // interval)):
                return
            rewards = judge()
            weights = {k: v.detach().cpu().numpy().copy() for k, v in self.model.policy.state_dict().items()}
            record.evaluated(n_done, rewards, weights)
            self.logger.record("validation/mean_reward", sum(rewards) / len(rewards))

    return Watch()


def _numbers(logged: Mapping[str, Any]) -> dict[str, int | float]:
    """Return the numbers among what was logged, as Python's own."""
    plain = {name: value.item() if hasattr(value, "item") else value for name, value in logged.items()}
    return {name: value for name, value in plain.items() if isinstance(value, int | float)}


def _whole_state(model: Any) -> TrainingState:
    """Return the state with what was logged since the last row: the next row tells it."""
    found, counts = capture(model), model.logger.name_to_count
    # As text, since what is logged may be no number, which JSON does not know.
    found.values["logged"] = {
        name: [repr(value), counts.get(name, 0), list(model.logger.name_to_excluded.get(name, ()))]
        for name, value in _numbers(model.logger.name_to_value).items()
    }
    return found


def _log_again(logger: Any, state: TrainingState) -> None:
    for name, (text, count, excluded) in state.values.get("logged", {}).items():
        logger.name_to_value[name] = int(text) if text.lstrip("-").isdigit() else float(text)
        logger.name_to_excluded[name] = tuple(excluded)
        if count:
            logger.name_to_count[name] = count


@dataclass(frozen=True)
class TrainingPlan:
    """What is trained, and how it is judged meanwhile.

    Raises:
        SettingsError: If an interval is out of range or a test memory would be used.
    """

    hyperparameters: Hyperparameters
    env: str
    """Environment trained in."""
    judged_env: str
    """Environment judged in."""
    seed: int = 0
    """Seed of weights, draws and environments."""
    memory: str = "train"
    """Memory, or part of the bank, trained on."""
    judged_memory: str = "validation"
    """Memory, or part of the bank, judged on while training."""
    judged_seeds: tuple[int, ...] = (0, 1)
    """Episodes of each memory at an evaluation."""
    evaluation_interval: int = 10_000
    """Decisions from one evaluation to the next."""
    checkpoint_interval: int = 10_000
    """Decisions from one checkpoint to the next."""

    def __post_init__(self) -> None:
        for name in ("evaluation_interval", "checkpoint_interval"):
            if getattr(self, name) < 1:
                raise SettingsError(f"`{name}` should be at least 1, but is {getattr(self, name)}")
        if not self.judged_seeds:
            raise SettingsError("`judged_seeds` should name at least one seed")
        tested = set(split_memories("test"))
        for name in ("memory", "judged_memory"):
            if tested & set(memories_of(getattr(self, name))):
                raise SettingsError(
                    f"`{name}` should not be of the test part of the bank, but is `{getattr(self, name)}`: "
                    "agents are judged on those memories, and no training may see them"
                )

    def as_json(self) -> dict[str, Any]:
        """Return it as plain values; two plans with equal ones train equal agents."""
        return dataclasses.asdict(self) | {"judged_seeds": list(self.judged_seeds)}


def memories_of(name: str) -> tuple[str, ...]:
    """Return the names of a part of the bank, or the one name."""
    return split_memories(name) if name in SPLITS else (name,)


def make_model(plan: TrainingPlan) -> Any:
    """Return the untrained model with its environments: the native vector environment where there is one.

    Raises:
        NotFoundError: If there is no such environment or memory.
        MissingDependencyError: If the algorithm's package is not installed.
        SettingsError: If the algorithm refuses a setting.
    """
    import gymnasium as gym
    import torch
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.noise import NormalActionNoise
    from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

    from creative_nao.agents.augmentation import FlippedSwappedAxes
    from creative_nao.envs import SB3VecEnv

    torch.set_num_threads(1)  # networks this small gain nothing from more, and lose much on busy cores
    chosen = plan.hyperparameters
    arguments = {**chosen.env_kwargs, "memory": plan.memory}
    try:
        if check_env(plan.env).vector_entry_point is not None:
            native: Any = SB3VecEnv(plan.env, chosen.n_envs, n_threads=1, **arguments)
            envs: Any = VecMonitor(FlippedSwappedAxes(native) if chosen.augment else native)
        else:
            envs = DummyVecEnv([lambda: Monitor(gym.make(plan.env, **arguments))] * chosen.n_envs)
            envs = FlippedSwappedAxes(envs) if chosen.augment else envs
    except TypeError as error:
        raise SettingsError(f"`env_kwargs`: {plan.env} refuses {', '.join(chosen.env_kwargs)}: {error}") from error
    extra = {name: schedule(value) for name, value in chosen.arguments.items()}
    if isinstance(extra.get("train_freq"), list):
        extra["train_freq"] = tuple(extra["train_freq"])
    if chosen.noise_std is not None:
        shape = envs.action_space.shape
        extra["action_noise"] = NormalActionNoise(np.zeros(shape), np.full(shape, chosen.noise_std))
    policy_kwargs = resolve_policy_kwargs(chosen.policy_kwargs)
    try:
        algorithm = find_algorithm(chosen.algorithm)
        return algorithm.load()(
            algorithm.policy_class(chosen.policy),
            envs,
            seed=plan.seed,
            device="cpu",
            policy_kwargs=policy_kwargs,
            **extra,
        )
    except (ValueError, TypeError, AssertionError) as error:
        envs.close()
        raise SettingsError(f"{chosen.algorithm} refuses its settings: {error}") from error


def train_agent(
    plan: TrainingPlan,
    *,
    checkpoint: Path | None = None,
    resume: bool = False,
    tensorboard: Path | None = None,
    logs: Path | None = None,
    progress: Callable[[TrainingRecord, int], None] | None = None,
    stop: threading.Event | None = None,
) -> tuple[Any, TrainingRecord]:
    """Train an agent.

    Stable-Baselines3 seeds the global generators of Python, NumPy and torch; use a process of its own where that
    matters.

    Args:
        plan: What to train.
        checkpoint: File to keep the exact state in; None keeps none.
        resume: Go on from `checkpoint` if it is there.
        tensorboard: Folder for TensorBoard's files; None writes none.
        logs: CSV file for what the algorithm logs, such as losses; None writes none.
        progress: Called at each rollout with the record so far and the decisions made.
        stop: When set, training ends at once with a checkpoint.

    Returns:
        The policy with the weights of the best evaluation, and the record.

    Raises:
        KeyboardInterrupt: After `stop` was set; the checkpoint is written.
        FileFormatError: If the checkpoint is damaged.
        SettingsError: If the checkpoint is of another plan.
    """
    if tensorboard is not None:
        check_tensorboard()
    record, state = TrainingRecord(), None
    if resume and checkpoint is not None and checkpoint.is_file():
        record, state = TrainingRecord.load(checkpoint, plan.as_json())
    model = make_model(plan)
    memories = memories_of(plan.judged_memory)

    def judge() -> tuple[float, ...]:
        agent = PolicyAgent(model.policy, deterministic=_only_deterministic(plan))
        return tuple(one.reward for one in evaluate_agent(agent, plan.judged_env, memories, plan.judged_seeds))

    callback = watch(
        plan, record, state, judge=judge, checkpoint=checkpoint, tensorboard=tensorboard, logs=logs,
        progress=progress, stop=stop or threading.Event(),
    )  # fmt: skip
    try:
        try:
            n_done = callback.prepare(model)
        except FileFormatError as error:
            raise FileFormatError(f"{checkpoint}: {error}") from error
        left = plan.hyperparameters.n_timesteps - n_done
        if left > 0:
            model.learn(left, callback=callback, reset_num_timesteps=state is None, log_interval=_log_interval(plan))
        callback.finish(model)
    finally:
        model.get_env().close()
    return model.policy, record


def check_tensorboard() -> None:
    """Refuse to go on without TensorBoard.

    Raises:
        MissingDependencyError: If it is not installed.
    """
    try:
        import tensorboard  # noqa: F401
    except ImportError as error:
        raise MissingDependencyError(
            'TensorBoard is not installed; install it with: pip install "creative-nao[agents]"'
        ) from error


def _only_deterministic(plan: TrainingPlan) -> bool:
    """Tell whether the policy draws nothing, so that its most likely action is its only one."""
    return plan.hyperparameters.algorithm == "td3"


def _log_interval(plan: TrainingPlan) -> int:
    return 1 if find_algorithm(plan.hyperparameters.algorithm).on_policy else 20
