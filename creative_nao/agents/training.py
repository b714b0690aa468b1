"""Train an agent of Stable-Baselines3 or sb3-contrib: judged on validation memories while it learns, and resumable.

A training goes on from a checkpoint with the same bits as if it had never stopped. The weights kept are those of the
evaluation with the highest mean reward.
"""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao.agents.adapters import PolicyAgent
from creative_nao.agents.algorithms import find_algorithm
from creative_nao.agents.hyperparameters import Hyperparameters, resolve_policy_kwargs, schedule
from creative_nao.agents.judging import check_env, play_episodes
from creative_nao.agents.training_record import TrainingRecord
from creative_nao.agents.training_watch import watch
from creative_nao.errors import FileFormatError, MissingDependencyError, SettingsError
from creative_nao.model import SPLITS, split_memories


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
        return tuple(one.reward for one in play_episodes(agent, plan.judged_env, memories, plan.judged_seeds))

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
