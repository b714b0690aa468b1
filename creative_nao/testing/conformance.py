"""Conformance checks of memories, robots, dm_control tasks and environments.

Each check states in its docstring what it requires, and raises a `ConformanceError` that names the first requirement
that is not met.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

from creative_nao.demonstrations import Demonstrations, load_demonstrations
from creative_nao.errors import CreativeNaoError
from creative_nao.measures.outcome import ALL_OUTCOMES, APPROPRIATE
from creative_nao.robot import PhysicalLimits, failures


class ConformanceError(CreativeNaoError, AssertionError):
    """A requirement is not met; the message says which, what was expected and what came."""


def require(met: Any, requirement: str, found: object) -> None:
    """Raise a ConformanceError with the requirement and what was found unless it is met."""
    if not met:
        raise ConformanceError(f"{requirement}, but found {found}")


def same(one: Any, other: Any) -> bool:
    """Tell whether two nested results are equal bit for bit; values that are not numbers equal themselves."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(same(*pair) for pair in zip(one, other, strict=True))
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        left, right = np.asarray(one), np.asarray(other)
        return left.shape == right.shape and left.dtype == right.dtype and left.tobytes() == right.tobytes()
    return bool(one == other) or (one != one and other != other)


def check_memory(memory: Any, *, seed: int = 0) -> None:
    """Check whatever generates trajectories from PB points.

    Required: `demonstrations` are the basic actions, `pb` (n_actions, n_pb) in [-1, 1] where they lie, `joints`
    and `dt_s` those of the demonstrations. `generate(pb, n_steps=None)` takes (n, n_pb) and returns finite float64
    angles [rad], (n, n_steps, n_joints), as long as the longest basic action unless told; it leaves its argument
    alone, gives the same bits again, for a point alone and in any order, and begins everywhere with the same posture.

    Args:
        memory: The memory.
        seed: Seed of the points tried.

    Raises:
        ConformanceError: If a requirement is not met.
    """
    basic: Any = getattr(memory, "demonstrations", None)
    require(isinstance(basic, Demonstrations), "`demonstrations` should be a Demonstrations", type(basic).__name__)
    known = np.asarray(getattr(memory, "pb", None))
    shaped = known.ndim == 2 and len(known) == basic.n_actions and known.shape[1] > 0
    require(shaped, f"`pb` should have shape ({basic.n_actions}, n_pb), a row for each basic action", known.shape)
    require(np.isfinite(known).all() and (np.abs(known) <= 1).all(), "`pb` should lie in [-1, 1]", known.tolist())
    for name in ("joints", "dt_s"):
        expected, found = getattr(basic, name), getattr(memory, name, None)
        require(found == expected, f"`{name}` should be that of the demonstrations, {expected}", found)
    pb = np.random.default_rng(seed).uniform(-1, 1, (7, known.shape[1]))  # a batch that no block size divides
    n_steps = max(len(trajectory) for trajectory in basic.trajectories)
    generated = _check_form(memory, pb, n_steps, len(basic.joints))
    _check_repeatable(memory, pb, generated)
    shorter = memory.generate(pb, n_steps=n_steps - 1)
    require(np.shape(shorter)[1:2] == (n_steps - 1,), f"n_steps={n_steps - 1} should be obeyed", np.shape(shorter))
    start = generated[:, 0]
    require((start == start[0]).all(), "row 0 should be one initial posture, whatever the PB", "several")


def _check_form(memory: Any, pb: np.ndarray, n_steps: int, n_joints: int) -> np.ndarray:
    given = pb.copy()
    generated = memory.generate(given)
    expected = (len(pb), n_steps, n_joints)
    require(isinstance(generated, np.ndarray), "`generate` should return an array", type(generated).__name__)
    require(generated.shape == expected, f"`generate` should return shape {expected}", generated.shape)
    require(generated.dtype == np.float64, "`generate` should return float64", generated.dtype)
    require(np.isfinite(generated).all(), "`generate` should return finite angles", "angles that are not")
    require(same(given, pb), "`generate` should leave its argument alone", "it changed")
    return generated


def _check_repeatable(memory: Any, pb: np.ndarray, generated: np.ndarray) -> None:
    require(same(memory.generate(pb), generated), "the same points should give the same bits again", "others")
    for place in (0, len(pb) - 1):
        alone = memory.generate(pb[place : place + 1])[0]
        require(same(alone, generated[place]), "a point alone should give the bits it has in a batch", "others")
    backwards = memory.generate(pb[::-1].copy())[::-1]
    require(same(backwards.copy(), generated), "the order of the points should change no bit", "it does")


_MEASURED = ("measured", "commanded")
_PER_JOINT = ("mean_error_rad", "max_error_rad", "saturated_share")


def check_performer(
    performer: Any, demonstrations: Demonstrations | None = None, limits: PhysicalLimits | None = None
) -> None:
    """Check a robot that performs trajectories.

    Required: `perform(trajectory, dt_s)` returns a `robot.Performance` whose `measured` is finite and of the shape
    of the trajectory, whose shares lie in [0, 1] and whose errors are not negative. It leaves the trajectory alone and
    gives the same bits again, also after another movement: every performance starts from the same state. Standing
    still in the first posture is no failure, and neither is any basic action.

    Args:
        performer: The robot.
        demonstrations: Its basic actions; default: the six shipped ones.
        limits: From where on a performance counts as failed; default: the project's.

    Raises:
        ConformanceError: If a requirement is not met.
    """
    basic = demonstrations or load_demonstrations()
    first, *_, last = basic.trajectories
    still = np.repeat(first[:1], len(first), axis=0)
    _check_performance(performer, still, basic.dt_s)
    _check_passes("standing still in the first posture", performer.perform(still, basic.dt_s), limits)
    kept = performer.perform(first, basic.dt_s)
    performer.perform(last, basic.dt_s)
    again = performer.perform(first, basic.dt_s)
    for name in (*_MEASURED, *_PER_JOINT):
        equal = same(getattr(kept, name), getattr(again, name))
        require(equal, f"the same movement should give the same bits of `{name}` again, whatever came before", "others")
    for name, trajectory in zip(basic.names, basic.trajectories, strict=True):
        _check_passes(f"basic action {name}", performer.perform(trajectory, basic.dt_s), limits)


def _check_performance(performer: Any, trajectory: np.ndarray, dt_s: float) -> None:
    given = trajectory.copy()
    done = performer.perform(given, dt_s)
    require(same(given, trajectory), "`perform` should leave the trajectory alone", "it changed")
    for name in _MEASURED:
        found = np.asarray(getattr(done, name, None))
        require(found.shape == trajectory.shape, f"`{name}` should have shape {trajectory.shape}", found.shape)
        require(np.isfinite(found).all(), f"`{name}` should be finite", "angles that are not")
    for name in _PER_JOINT:
        found = np.asarray(getattr(done, name, None))
        require(found.shape == trajectory.shape[1:], f"`{name}` should have shape {trajectory.shape[1:]}", found.shape)
        require((found >= 0).all(), f"`{name}` should not be negative", found.tolist())
    shares = [*np.asarray(done.saturated_share).tolist(), done.self_collision_share]
    require(all(0 <= share <= 1 for share in shares), "shares of the time should lie in [0, 1]", shares)


def _check_passes(what: str, done: Any, limits: PhysicalLimits | None) -> None:
    tripped = failures(done, limits)
    require(not tripped, f"{what} should be performable", ", ".join(tripped))


def check_task(load: Callable[..., Any], *, n_steps: int = 30) -> None:
    """Check a dm_control environment.

    Required: the action spec is bounded and finite; observations are those of the observation spec, by name, shape
    and type, and finite; a first step has neither reward nor discount; rewards are finite and discounts in [0, 1],
    whether actions are drawn or at the ends of the range; equal seeds and actions give equal bits; an episode that has
    begun goes on after `reset`.

    Args:
        load: Makes the environment from a `seed`, as `creative_nao.envs.load` does.
        n_steps: Steps tried of each kind.

    Raises:
        ConformanceError: If a requirement is not met.
    """
    env = load(seed=1)
    spec = env.action_spec()
    low, high = np.asarray(spec.minimum), np.asarray(spec.maximum)
    bounded = np.isfinite(low).all() and np.isfinite(high).all() and (low < high).all()
    require(bounded, "the action spec should have finite bounds, low below high", (low.tolist(), high.tolist()))
    rng = np.random.default_rng(0)
    drawn = [rng.uniform(low, high, spec.shape).astype(spec.dtype) for _ in range(n_steps)]
    ends = [(low if step % 2 else high).astype(spec.dtype) * np.ones(spec.shape, spec.dtype) for step in range(n_steps)]
    for actions in (drawn, ends):
        for step in _play_task(env, actions):
            _check_step(env, step)
    one, other = ([list(step) for step in _play_task(load(seed=7), drawn)] for _ in range(2))
    require(same(one, other), "equal seeds should give equal bits", "others")


def _play_task(env: Any, actions: list[np.ndarray]) -> list[Any]:
    steps = [env.reset()]
    first = steps[0]
    require(first.first(), "`reset` should return a first step", first.step_type)
    require(first.reward is None and first.discount is None, "a first step should have no reward", first.reward)
    for action in actions:
        steps.append(env.step(action))
        if steps[-1].last():
            break
    return steps


def _check_step(env: Any, step: Any) -> None:
    expected = env.observation_spec()
    names, found = ", ".join(expected), ", ".join(step.observation)
    require(step.observation.keys() == expected.keys(), f"observations should be those of the spec, {names}", found)
    for name, spec in expected.items():
        found = np.asarray(step.observation[name])
        require(found.shape == spec.shape, f"observation `{name}` should have shape {spec.shape}", found.shape)
        require(found.dtype == spec.dtype, f"observation `{name}` should be {spec.dtype}", found.dtype)
        require(np.isfinite(found).all(), f"observation `{name}` should be finite", found.tolist())
    if not step.first():
        require(np.isfinite(step.reward), "rewards should be finite", step.reward)
        require(0.0 <= step.discount <= 1.0, "discounts should lie in [0, 1]", step.discount)


TERMS = ("outcome", "appropriate", "distance", "known_distance", "nearest_name", "repertoire_size", "reward_novelty")
"""What `info` tells when a movement has been scored."""


def check_environment(make: str | Callable[[], gym.Env], *, n_actions: int = 3) -> None:
    """Check an environment.

    Required: the checkers of Gymnasium and Stable-Baselines3 find nothing, not even a warning. Equal seeds and actions
    give equal bits, in two environments and in one that is played again. When a movement has been scored, `info` has
    all of `TERMS`; the outcome is a known one; what is not appropriate earns 0 and leaves the repertoire as it is, what
    is joins it and earns what `reward_novelty` says; the same movement at once again earns nothing.

    Args:
        make: Makes the environment, or the name it is registered under.
        n_actions: Movements played of each kind.

    Raises:
        ConformanceError: If a requirement is not met.
    """
    build: Callable[[], gym.Env] = (lambda: gym.make(make)) if isinstance(make, str) else make
    _check_with_the_checkers(build)
    one, other = build(), build()
    try:
        first = _play_environment(one, n_actions)
        for env, what in ((other, "two environments with equal seeds"), (one, "an episode played again")):
            require(same(first, _play_environment(env, n_actions)), f"{what} should give equal bits", "others")
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


def _play_environment(env: gym.Env, n_actions: int) -> list[Any]:
    rng = np.random.default_rng(3)
    n_steps = n_actions * getattr(env.unwrapped, "n_decisions", 1)
    return [env.reset(seed=3), *(env.step(_draw(env, rng)) for _ in range(n_steps))]


def check_scores(env: gym.Env, n_actions: int) -> None:
    """Check rewards and `info` of an environment alone, which takes a fraction of the time."""
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    size = 0
    for _ in range(n_actions):
        pb = _draw(env, rng)
        size = _check_score(*_hold(env, pb), size)
        reward, info = _hold(env, pb)
        size = _check_score(reward, info, size)
        require(reward == 0.0, "the same movement at once again should earn nothing", reward)


def _check_score(reward: float, info: dict[str, Any], size: int) -> int:
    """Check what was told of one movement; return the size of the repertoire after it."""
    missing = [term for term in TERMS if term not in info]
    require(not missing, f"`info` should tell {', '.join(TERMS)}", f"no {', '.join(missing)}")
    require(info["outcome"] in ALL_OUTCOMES, f"the outcome should be one of {', '.join(ALL_OUTCOMES)}", info["outcome"])
    usable = info["outcome"] in APPROPRIATE
    matches = bool(info["appropriate"]) == usable
    require(matches, "learned and unlearned movements alone should be appropriate", info["outcome"])
    require(np.isfinite(reward) and reward >= 0, "rewards should be finite and not negative", reward)
    require(usable or reward == 0.0, "what is not appropriate should earn 0", reward)
    told, held = info["reward_novelty"], info["repertoire_size"]
    require(np.isclose(reward, told), "the reward should be what `info` says", (reward, told))
    expected = size + usable
    require(held == expected, f"the repertoire should hold {expected}: what is appropriate joins it, else not", held)
    return expected


def _hold(env: gym.Env, pb: np.ndarray) -> tuple[float, dict[str, Any]]:
    """Hold a PB point for a whole movement; return what it earned and what was told at its end."""
    total, info = 0.0, {}
    for _ in range(getattr(env.unwrapped, "n_decisions", 1)):
        _, reward, _, _, info = env.step(pb)
        total += float(reward)
    return total, info


def _draw(env: gym.Env, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-1, 1, env.action_space.shape).astype(np.float32)
