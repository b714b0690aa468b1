"""The promises of an environment of this project: Gymnasium's, Stable-Baselines3's, and those of its own pages."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

from creative_nao.envs.observation import OUTCOMES
from creative_nao.testing.conformance import ConformanceError, demand, same

TERMS = ("outcome", "appropriate", "distance", "known_distance", "nearest_name", "repertoire_size", "reward_novelty")
"""What `info` tells when a movement has been scored."""


def check_environment(make: str | Callable[[], gym.Env], *, n_actions: int = 3) -> None:
    """Check an environment.

    The promises: the checkers of Gymnasium and Stable-Baselines3 find nothing, not even a warning. Equal seeds and
    actions give equal bits, in two copies and in one that is played again. When a movement has been scored, `info` has
    all of `TERMS`; the outcome is a known one; what is not appropriate earns 0 and leaves the repertoire as it is, what
    is joins it and earns what `reward_novelty` says; the same movement at once again earns nothing.

    Args:
        make: Makes the environment, or the name it is registered under.
        n_actions: Movements played of each kind.

    Raises:
        ConformanceError: If a promise is broken.
    """
    build: Callable[[], gym.Env] = (lambda: gym.make(make)) if isinstance(make, str) else make
    _check_with_the_checkers(build)
    one, other = build(), build()
    try:
        first = _play(one, n_actions)
        demand(same(first, _play(other, n_actions)), "two copies with equal seeds should give equal bits", "others")
        demand(same(first, _play(one, n_actions)), "an episode played again should give the same bits", "others")
        check_scores(one, n_actions)
    finally:
        one.close()
        other.close()


def _check_with_the_checkers(build: Callable[[], gym.Env]) -> None:
    from gymnasium.utils.env_checker import check_env
    from stable_baselines3.common.env_checker import check_env as check_env_of_sb3

    for name, check in (("Gymnasium", check_env), ("Stable-Baselines3", check_env_of_sb3)):
        env = build()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                check(env.unwrapped)
        except Exception as error:
            raise ConformanceError(f"{name}'s checker should find nothing, but found: {error}") from error
        finally:
            env.close()


def _play(env: gym.Env, n_actions: int, seed: int = 3) -> list[Any]:
    rng = np.random.default_rng(seed)
    found: list[Any] = [env.reset(seed=seed)]
    for _ in range(n_actions * _n_decisions(env)):
        found.append(env.step(_draw(env, rng)))
    return found


def check_scores(env: gym.Env, n_actions: int) -> None:
    """Check rewards and `info` of an environment alone, which takes a fraction of the time.

    Raises:
        ConformanceError: If a promise of `check_environment` about scores is broken.
    """
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    size = 0
    for _ in range(n_actions):
        pb = _draw(env, rng)
        size = _check_score(_hold(env, pb), size)
        again = _hold(env, pb)
        reward = again[0]
        size = _check_score(again, size)
        demand(reward == 0.0, "the same movement at once again should earn nothing", reward)


def _check_score(scored: tuple[float, dict[str, Any]], size: int) -> int:
    """Check what was told of one movement; return the size of the repertoire after it."""
    reward, info = scored
    missing = [term for term in TERMS if term not in info]
    demand(not missing, f"`info` should tell {', '.join(TERMS)}", f"no {', '.join(missing)}")
    demand(info["outcome"] in OUTCOMES, f"the outcome should be one of {', '.join(OUTCOMES)}", info["outcome"])
    usable = info["outcome"] in ("learned", "unlearned")
    demand(
        bool(info["appropriate"]) == usable, "learned and unlearned movements alone are appropriate", info["outcome"]
    )
    demand(np.isfinite(reward) and reward >= 0, "rewards should be finite and not negative", reward)
    demand(usable or reward == 0.0, "what is not appropriate should earn 0", reward)
    demand(
        np.isclose(reward, info["reward_novelty"]),
        "the reward should be what `info` says",
        (reward, info["reward_novelty"]),
    )
    expected = size + usable
    demand(
        info["repertoire_size"] == expected,
        f"the repertoire should hold {expected}: appropriate movements join it, others do not",
        info["repertoire_size"],
    )
    return expected


def _hold(env: gym.Env, pb: np.ndarray) -> tuple[float, dict[str, Any]]:
    """Hold a PB point for a whole movement; return what it earned and what was told at its end."""
    total, info = 0.0, {}
    for _ in range(_n_decisions(env)):
        _, reward, _, _, info = env.step(pb)
        total += float(reward)
    return total, info


def _n_decisions(env: gym.Env) -> int:
    return getattr(env.unwrapped, "n_decisions", 1)


def _draw(env: gym.Env, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-1, 1, env.action_space.shape).astype(np.float32)
