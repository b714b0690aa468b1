"""PPO of Stable-Baselines3, trained on the spot on one core."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

from creative_nao.agents.settings import check_policy_settings, check_widths
from creative_nao.errors import SettingsError
from creative_nao.fields import shown

if TYPE_CHECKING:
    from gymnasium.spaces import Box
    from stable_baselines3.common.policies import ActorCriticPolicy


_LARGEST = {"n_timesteps": 10**10, "n_envs": 4_096, "n_steps": 10**6, "batch_size": 10**7, "n_epochs": 10**4}


@dataclass(frozen=True)
class PPOSettings:
    """How PPO is trained. The defaults learn within half a minute on one core.

    They were chosen on the shipped memory `half/0` in the mental environment, on one or two seeds each: many updates
    of a small network at a high learning rate matter; discounts from 0 to 0.9 make no difference beyond the spread of
    the seeds, for an action is rewarded at once. Drawn actions earn more than the most likely ones (16.4 against 13.9
    over eight policies): repeating an action earns nothing, and a policy without chance is prone to repeat itself.

    Raises:
        SettingsError: If a value is out of range; the message names the field.
    """

    n_timesteps: int = 60_000
    """Actions generated in training; rounded up to whole rollouts of n_envs * n_steps."""
    n_envs: int = 16
    """Copies of the environment that are stepped in turn."""
    n_steps: int = 30
    """Steps of each copy between two updates: one episode."""
    batch_size: int = 480
    """Size of a minibatch."""
    n_epochs: int = 12
    """Passes over the data of an update."""
    learning_rate: float = 4e-3
    """Step size of Adam."""
    gamma: float = 0.5
    """Discount per action."""
    gae_lambda: float = 0.9
    """Weight of longer looks ahead in the advantage."""
    clip_range: float = 0.2
    """Largest change of an action's probability ratio that an update rewards."""
    ent_coef: float = 0.0
    """Weight of the entropy bonus."""
    log_std_init: float = -0.5
    """Logarithm of the policy's first standard deviation; the square is 2 wide."""
    hidden: tuple[int, ...] = (64, 64)
    """Hidden units of the policy and of the value network, layer by layer."""
    deterministic: bool = False
    """Judge the policy's most likely actions instead of drawn ones."""

    def __post_init__(self) -> None:
        for name, most in _LARGEST.items():
            value: Any = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | np.integer):
                raise SettingsError(f"`{name}` should be a whole number, but is {shown(value)}")
            if not 1 <= value <= most:
                bound = "at least 1" if value < 1 else f"at most {most}"
                raise SettingsError(f"`{name}` should be {bound}, but is {shown(value)}")
        for name in ("learning_rate", "gamma", "gae_lambda", "clip_range", "ent_coef", "log_std_init"):
            value: Any = getattr(self, name)
            if (
                isinstance(value, bool)
                or not isinstance(value, int | float | np.integer | np.floating)
                or not abs(value) <= 1e6
            ):
                raise SettingsError(f"`{name}` should be a number, but is {shown(value)}")
        for name in ("gamma", "gae_lambda"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise SettingsError(f"`{name}` should be between 0 and 1, but is {getattr(self, name)}")
        for name in ("learning_rate", "clip_range"):
            if not getattr(self, name) > 0.0:
                raise SettingsError(f"`{name}` should be above 0, but is {getattr(self, name)}")
        if (self.n_envs * self.n_steps) % self.batch_size:
            raise SettingsError(
                f"`batch_size` should divide n_envs * n_steps = {self.n_envs * self.n_steps}, but is {self.batch_size}"
            )
        check_widths(self.hidden, "`hidden`")
        if not self.hidden:
            raise SettingsError(f"`hidden` should list at least one width, each at least 1, but is {self.hidden}")
        check_policy_settings({"net_arch": self.hidden}, "`hidden`")
        if not isinstance(self.deterministic, bool):
            raise SettingsError(f"`deterministic` should be true or false, but is {shown(self.deterministic)}")

    @property
    def n_generated(self) -> int:
        """Actions generated in training, in whole rollouts."""
        rollout = self.n_envs * self.n_steps
        return -(-self.n_timesteps // rollout) * rollout


@dataclass(frozen=True)
class TrainingCurve:
    """Reward of each training episode, in the order in which the episodes ended."""

    n_actions: tuple[int, ...]
    """Actions generated so far, over all copies, when the episode ended."""
    reward: tuple[float, ...]
    """Sum of the rewards of the episode."""


def build_policy(observation_space: Box, action_space: Box, settings: PPOSettings) -> ActorCriticPolicy:
    """Make the untrained policy network that `settings` describe."""
    from stable_baselines3.common.policies import ActorCriticPolicy

    return ActorCriticPolicy(
        observation_space, action_space, lr_schedule=lambda _: settings.learning_rate, **_policy_kwargs(settings)
    )


def train_ppo(
    env_id: str,
    *,
    settings: PPOSettings,
    seed: int,
    env_kwargs: dict[str, Any] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[ActorCriticPolicy, TrainingCurve]:
    """Train a policy.

    Stable-Baselines3 seeds the global generators of Python, NumPy and torch; run it in a process of its own where
    that matters. One torch thread is used: networks this small gain nothing from two, and lose much when the other
    core is busy.

    Args:
        env_id: Environment to train on.
        settings: How to train.
        seed: Seed of the weights, the draws and the environments; the same seed gives the same policy.
        env_kwargs: Handed to the environment, as `{"memory": "half/0"}`.
        progress: Called with the actions generated so far and the number planned.

    Returns:
        The trained policy and its training curve.
    """
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import DummyVecEnv

    torch.set_num_threads(1)
    # make_vec_env of Stable-Baselines3 would ask every copy for frames.
    envs = DummyVecEnv([lambda: Monitor(gym.make(env_id, **(env_kwargs or {})))] * settings.n_envs)
    envs.seed(seed)
    try:
        model = PPO(
            "MlpPolicy",
            envs,
            seed=seed,
            device="cpu",
            n_steps=settings.n_steps,
            batch_size=settings.batch_size,
            n_epochs=settings.n_epochs,
            learning_rate=settings.learning_rate,
            gamma=settings.gamma,
            gae_lambda=settings.gae_lambda,
            clip_range=settings.clip_range,
            ent_coef=settings.ent_coef,
            policy_kwargs=_policy_kwargs(settings),
        )
        recorder = _recorder(settings.n_generated, progress)
        model.learn(settings.n_timesteps, callback=recorder)
    finally:
        envs.close()
    return model.policy, TrainingCurve(tuple(recorder.n_actions), tuple(recorder.rewards))  # pyright: ignore[reportReturnType]


def settings_from(values: dict[str, Any]) -> PPOSettings:
    """Make settings out of a dictionary read from JSON.

    Raises:
        SettingsError: If a name is unknown or a value out of range.
    """
    known = {field.name for field in dataclasses.fields(PPOSettings)}
    if not isinstance(values, dict):
        raise SettingsError(f"settings of PPO should be a mapping of names to values, but are {shown(values)}")
    if unknown := sorted(set(map(str, values)) - known):
        raise SettingsError(f"`{unknown[0]}` is no setting of PPO; there are: {', '.join(sorted(known))}")
    try:
        return PPOSettings(**{**values, "hidden": tuple(values.get("hidden", PPOSettings.hidden))})
    except TypeError as error:
        raise SettingsError(f"a setting of PPO has the wrong type: {error}") from error


def _policy_kwargs(settings: PPOSettings) -> dict[str, Any]:
    widths = list(settings.hidden)
    return {"net_arch": {"pi": widths, "vf": widths}, "log_std_init": settings.log_std_init}


def _recorder(n_planned: int, progress: Callable[[int, int], None] | None) -> Any:
    from stable_baselines3.common.callbacks import BaseCallback

    class Recorder(BaseCallback):
        """Collects the reward of each episode that ends."""

        def __init__(self) -> None:
            super().__init__()
            self.n_actions: list[int] = []
            self.rewards: list[float] = []

        def _on_step(self) -> bool:
            for info in self.locals["infos"]:
                if "episode" in info:
                    self.n_actions.append(self.num_timesteps)
                    self.rewards.append(float(info["episode"]["r"]))
            return True

        def _on_rollout_end(self) -> None:
            if progress is not None:
                progress(self.num_timesteps, n_planned)

    return Recorder()
