"""Train an agent of Stable-Baselines3 or sb3-contrib: evaluated on validation memories while it learns, and resumable.

A training goes on from a checkpoint with the same bits as if it had never stopped. The weights kept are those of the
evaluation with the highest mean reward. `train_ppo` trains PPO on the spot: its last weights, and no evaluation.
"""

from __future__ import annotations

import importlib.util
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from creative_nao import schema
from creative_nao.agents.base import PolicyAgent
from creative_nao.agents.play import check_env, evaluate_agent, told_track
from creative_nao.agents.resume import TrainingRecord, load_checkpoint
from creative_nao.agents.settings import (
    Copies,
    Hyperparameters,
    Timesteps,
    Widths,
    check_policy_settings,
    check_rollout,
    find_algorithm,
    naming,
)
from creative_nao.errors import FileFormatError, SettingsError, missing_extra
from creative_nao.model import SPLITS, shipped_memories, split_memories, split_of
from creative_nao.model.config import check_kind
from creative_nao.schema import Count, Field, Index, LongText, UnitInterval, checked, dump

if TYPE_CHECKING:
    from stable_baselines3.common.policies import BasePolicy


@schema.record
class TrainingPlan:
    """What is trained, and how it is judged meanwhile.

    Raises:
        SettingsError: If an interval is out of range or a test memory would be used.
    """

    hyperparameters: Hyperparameters
    env: LongText
    """Environment trained in."""
    judged_env: LongText
    """Environment evaluated in."""
    seed: Index = 0
    """Seed of weights, draws and environments."""
    memory: LongText = "train"
    """Memory, or part of the bank, trained on."""
    judged_memory: LongText = "validation"
    """Memory, or part of the bank, evaluated on while training."""
    judged_seeds: Annotated[tuple[Index, ...], Field(min_length=1)] = (0, 1)
    """Episodes of each memory at an evaluation."""
    evaluation_interval: Count = 10_000
    """Decisions from one evaluation to the next."""
    checkpoint_interval: Count = 10_000
    """Decisions from one checkpoint to the next."""

    def __post_init__(self) -> None:
        for name in ("memory", "judged_memory"):
            refuse_test_memories(getattr(self, name), f"`{name}`")

    def as_json(self) -> dict[str, Any]:
        """Return it as plain values; two plans with equal ones train equal agents."""
        return dump(self)


@schema.record
class PPOSettings:
    """How PPO is trained on the spot. The defaults learn within half a minute on one core.

    They were chosen on the shipped memory `half/0` in the mental environment, on one or two seeds each: many updates
    of a small network at a high learning rate matter; discounts from 0 to 0.9 make no difference beyond the spread of
    the seeds, for an action is rewarded at once. Drawn actions earn more than the most likely ones (16.4 against 13.9
    over eight policies): repeating an action earns nothing, and a policy without chance is prone to repeat itself.
    """

    n_timesteps: Timesteps = 60_000
    """Actions generated in training; rounded up to whole rollouts of n_envs * n_steps."""
    n_envs: Copies = 16
    """Copies of the environment that are stepped in turn."""
    n_steps: Annotated[int, Field(ge=1, le=10**6)] = 30
    """Steps of each copy between two updates: one episode."""
    batch_size: Annotated[int, Field(ge=1, le=10**7)] = 480
    """Size of a minibatch."""
    n_epochs: Annotated[int, Field(ge=1, le=10**4)] = 12
    """Passes over the data of an update."""
    learning_rate: Annotated[float, Field(gt=0, le=1e6)] = 4e-3
    """Step size of Adam."""
    gamma: UnitInterval = 0.5
    """Discount per action."""
    gae_lambda: UnitInterval = 0.9
    """Weight of longer looks ahead in the advantage."""
    clip_range: Annotated[float, Field(gt=0, le=1e6)] = 0.2
    """Largest change of an action's probability ratio that an update rewards."""
    ent_coef: Annotated[float, Field(ge=-1e6, le=1e6)] = 0.0
    """Weight of the entropy bonus."""
    log_std_init: Annotated[float, Field(ge=-20, le=20)] = -0.5
    """Logarithm of the policy's first standard deviation; the square is 2 wide."""
    hidden: Annotated[Widths, Field(min_length=1)] = (64, 64)
    """Hidden units of the policy and of the value network, layer by layer."""
    deterministic: bool = False
    """Judge the policy's most likely actions instead of drawn ones."""

    def __post_init__(self) -> None:
        with naming("`hidden`"):
            check_policy_settings(self.as_hyperparameters().policy_kwargs)
        check_rollout(self.n_envs, self.n_steps, self.batch_size)

    @property
    def n_generated(self) -> int:
        """Actions generated in training, in whole rollouts."""
        rollout = self.n_envs * self.n_steps
        return -(-self.n_timesteps // rollout) * rollout

    def as_hyperparameters(self) -> Hyperparameters:
        """Return them as those of the algorithm `ppo`."""
        names = ("n_steps", "batch_size", "n_epochs", "learning_rate", "gamma", "gae_lambda", "clip_range", "ent_coef")
        widths = list(self.hidden)
        return Hyperparameters(
            "ppo",
            n_timesteps=self.n_timesteps,
            n_envs=self.n_envs,
            policy_kwargs={"net_arch": {"pi": widths, "vf": widths}, "log_std_init": self.log_std_init},
            arguments={name: getattr(self, name) for name in names},
        )


@dataclass(frozen=True)
class TrainingCurve:
    """Reward of each training episode, in the order in which the episodes ended."""

    n_actions: tuple[int, ...]
    """Actions generated so far, over all copies, when the episode ended."""
    reward: tuple[float, ...]
    """Sum of the rewards of the episode."""


def refuse_test_memories(memory: str, name: str) -> None:
    """Raise a SettingsError if a memory, or part of the bank, given as the argument `name` is one of the test part."""
    tested = {name for name in shipped_memories(None) if split_of(name).startswith("test")}
    if tested & set(memories_of(memory)):
        raise SettingsError(
            f"{name} should not be of the test part of the bank, but is `{memory}`: agents are judged on those "
            "memories, and no training may see them"
        )


def memories_of(name: str) -> tuple[str, ...]:
    """Return the names of a part of the bank, or the one name."""
    return split_memories(name) if name in SPLITS else (name,)


def make_model(chosen: Hyperparameters, env_id: str, *, seed: int, env_kwargs: dict[str, Any]) -> Any:
    """Return the untrained model with its environments: the native vector environment where there is one.

    Raises:
        NotFoundError: If there is no such environment or memory.
        MissingDependencyError: If the algorithm's package is not installed.
        SettingsError: If the algorithm refuses a setting.
    """
    checked(Index, seed, "seed")
    if find_algorithm(chosen.algorithm).supervised:
        raise SettingsError(f"{chosen.algorithm} learns from memories, not in an environment: `learned_map.training`")
    import gymnasium as gym
    import torch
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.noise import NormalActionNoise
    from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

    from creative_nao.agents.augmentation import FlippedSwappedAxes
    from creative_nao.envs import SB3VecEnv

    torch.set_num_threads(1)  # networks this small gain nothing from more, and lose much on busy cores
    try:
        if check_env(env_id).vector_entry_point is not None:
            native: Any = SB3VecEnv(env_id, chosen.n_envs, n_threads=1, **env_kwargs)
            envs: Any = VecMonitor(FlippedSwappedAxes(native) if chosen.augment else native)
        else:
            envs = DummyVecEnv([lambda: Monitor(gym.make(env_id, **env_kwargs))] * chosen.n_envs)
            envs = FlippedSwappedAxes(envs) if chosen.augment else envs
    except TypeError as error:
        raise SettingsError(f"`env_kwargs`: {env_id} refuses {', '.join(env_kwargs)}: {error}") from error
    extra = chosen.sb3_arguments()
    if chosen.noise_std is not None:
        shape = envs.action_space.shape
        extra["action_noise"] = NormalActionNoise(np.zeros(shape), np.full(shape, chosen.noise_std))
    try:
        algorithm = find_algorithm(chosen.algorithm)
        policy = algorithm.policy_class(chosen.policy)
        return algorithm.load()(
            policy, envs, seed=seed, device="cpu", policy_kwargs=chosen.sb3_policy_kwargs(), **extra
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
        logs: Folder for `progress.csv` (what the algorithm logs, such as losses), `episodes.csv` and
            `evaluations.csv`; None writes none.
        progress: Called at each rollout with the record so far and the decisions made.
        stop: When set, training ends at once with a checkpoint.

    Returns:
        The policy with the weights of the best evaluation, and the record.

    Raises:
        KeyboardInterrupt: After `stop` was set; the checkpoint is written.
        FileFormatError: If the checkpoint is damaged.
        SettingsError: If the checkpoint is of another plan.
    """
    if tensorboard is not None and importlib.util.find_spec("tensorboard") is None:
        raise missing_extra("tensorboard", "agents", "--tensorboard", "it is not installed")
    from creative_nao.agents.callbacks import TrainingCallback

    chosen = check_kind(plan, TrainingPlan, "plan").hyperparameters
    on_policy = find_algorithm(chosen.algorithm).on_policy
    record, state = TrainingRecord(), None
    if resume and checkpoint is not None and checkpoint.is_file():
        record, state = load_checkpoint(checkpoint, plan.as_json())
    model = make_model(chosen, plan.env, seed=plan.seed, env_kwargs={**chosen.env_kwargs, "memory": plan.memory})
    memories = memories_of(plan.judged_memory)

    def evaluate() -> tuple[float, ...]:
        # TD3's policy draws nothing: its most likely action is its only one.
        track = told_track(plan.env, chosen.env_kwargs)
        agent = PolicyAgent(model.policy, deterministic=chosen.algorithm == "td3", track=track)
        return tuple(one.reward for one in evaluate_agent(agent, plan.judged_env, memories, plan.judged_seeds))

    callback = TrainingCallback(
        record, state, plan, evaluate, checkpoint=checkpoint, progress=progress, stop=stop or threading.Event()
    )
    try:
        try:
            n_done = callback.prepare(model, logs, tensorboard)
        except FileFormatError as error:
            raise FileFormatError(f"{checkpoint}: {error}") from error
        left = chosen.n_timesteps - n_done
        if left > 0:
            interval = 1 if on_policy else 20
            model.learn(left, callback=callback, reset_num_timesteps=state is None, log_interval=interval)
        callback.finish(model)
    finally:
        model.get_env().close()
    return model.policy, record


def train_ppo(
    env_id: str,
    *,
    settings: PPOSettings,
    seed: int,
    env_kwargs: dict[str, Any] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[BasePolicy, TrainingCurve]:
    """Train PPO on the spot, on the memory on which it is judged.

    Stable-Baselines3 seeds the global generators of Python, NumPy and torch; run it in a process of its own where
    that matters. One torch thread is used.

    Args:
        env_id: Environment to train on.
        settings: How to train.
        seed: Seed of the weights, the draws and the environments; the same seed gives the same policy.
        env_kwargs: Handed to the environment, as `{"memory": "half/0"}`.
        progress: Called with the actions generated so far and the number planned.

    Returns:
        The trained policy and its training curve.
    """
    from creative_nao.agents.callbacks import EpisodeRecorder

    record, n_planned = TrainingRecord(), check_kind(settings, PPOSettings, "settings").n_generated
    report = None if progress is None else lambda n_done: progress(n_done, n_planned)
    model = make_model(settings.as_hyperparameters(), env_id, seed=seed, env_kwargs=env_kwargs or {})
    try:
        model.learn(settings.n_timesteps, callback=EpisodeRecorder(record, report))
    finally:
        model.get_env().close()
    return model.policy, TrainingCurve(tuple(record.episode_ends), tuple(record.episode_rewards))
