"""Play episodes: one step by step, or one for each memory and seed as a score.

The same agent, memories and seeds give the same rewards, bit for bit on one machine; a bundle's recorded score is
checked that way.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.spaces import Box
from pydantic import Field

from creative_nao.agents.base import Agent, Context, Imagination, Policy, PolicyAgent
from creative_nao.envs import Track
from creative_nao.envs.observation import CELLS
from creative_nao.errors import NotFoundError, SettingsError, nearest_name
from creative_nao.model.config import check_kind
from creative_nao.runtime import search_current_folder
from creative_nao.schema import Index, LongText, checked, dump, record

MEASURES = ("appropriateness_pct", "novelty", "diversity")
"""What `info["episode_measures"]` tells at the end of an episode."""
_USUAL_BUDGET = 30


class Step(NamedTuple):
    """One step of an episode.

    Attributes:
        pb: The PB vector that the agent chose, shape (n_pb,).
        reward: Its reward.
        info: What the environment tells; it has an `outcome` when the movement has ended.
        n_imagined: Movements that the agent has imagined in the episode so far.
    """

    pb: np.ndarray
    reward: float
    info: dict[str, Any]
    n_imagined: int = 0


@record
class PlayedEpisode:
    """What one episode came to.

    Attributes:
        memory: Name of the memory.
        seed: Seed of the environment and of the agent's draws.
        reward: Sum of the rewards.
        appropriateness_pct: Share of appropriate actions.
        novelty: Mean distance of the appropriate ones to the basic actions [rad], None without any.
        diversity: Mean distance between them [rad], None with fewer than two.
        n_imagined: Movements imagined.
    """

    memory: LongText
    seed: Index
    reward: float
    appropriateness_pct: float | None = None
    novelty: float | None = None
    diversity: float | None = None
    n_imagined: Index = 0


@record(closed=False)
class Score:
    """A recorded score.

    Attributes:
        env: Environment it was played in.
        deterministic: Whether the most likely actions were played, or drawn ones.
        episodes: Every episode.
    """

    env: LongText
    deterministic: bool
    episodes: Annotated[tuple[PlayedEpisode, ...], Field(min_length=1, max_length=100_000)]

    def __repr__(self) -> str:
        how = "most likely actions" if self.deterministic else "drawn actions"
        return f"<score in {self.env}: mean reward {self.mean:.2f} of {len(self.episodes)} episodes, {how}>"

    @property
    def mean(self) -> float:
        """Mean reward of an episode."""
        return math.fsum(one.reward for one in self.episodes) / len(self.episodes)

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the mean, bootstrapped over memories (each one's seeds stay together)."""
        by_memory = [[one.reward for one in self.episodes if one.memory == name] for name in self.memories]
        means = np.array([math.fsum(rewards) / len(rewards) for rewards in by_memory])
        drawn = np.random.default_rng(0).integers(len(means), size=(10_000, len(means)))
        low, high = np.quantile(means[drawn].mean(axis=1), [0.025, 0.975])
        return float(low), float(high)

    @property
    def memories(self) -> tuple[str, ...]:
        """The memories, in the order of play."""
        return tuple(dict.fromkeys(one.memory for one in self.episodes))

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seeds of each memory."""
        return tuple(dict.fromkeys(one.seed for one in self.episodes))

    def as_json(self) -> dict[str, Any]:
        """Return it as plain values, with mean and interval; `schema.parse` reads them."""
        values = dump(self)
        episodes = values.pop("episodes")
        return {**values, "mean": self.mean, "interval_95": list(self.interval), "episodes": episodes}


def play_episode(
    agent: Agent, env: gym.Env, *, seed: int, rng: np.random.Generator, n_actions: int | None = None,
    options: dict[str, Any] | None = None,
) -> Iterator[Step]:  # fmt: skip
    """Let an agent play one episode and yield every step as it is made.

    Args:
        agent: The agent; it is begun anew.
        env: The environment; it is reset.
        seed: Seed of the environment.
        rng: The agent's only source of randomness.
        n_actions: The budget in movements, which has to be the length of the environment's episode; None takes over
            what the environment says, and plays to its end. Where a movement takes several decisions, the agent is
            asked for each. How many movements may be imagined is what the environment was made with, `n_imagined`.
        options: Those of the environment's `reset`.

    Raises:
        SettingsError: If the spaces are no boxes, the episode is shorter or longer than `n_actions`, or the
            observations tell more than the track of the agent.
    """
    check_kind(agent, Agent, "agent")
    check_kind(env, gym.Env, "env")
    if not isinstance(env.action_space, Box) or not isinstance(env.observation_space, Box):
        raise SettingsError(f"environment {env} should have Box spaces, but has {env.action_space}")
    observation, _ = env.reset(seed=seed, options=options)
    inner: Any = env.unwrapped
    n_decisions = int(getattr(inner, "n_decisions", 1))
    usual = (getattr(inner, "n_actions", _USUAL_BUDGET) if n_actions is None else n_actions) * n_decisions
    n_steps = int(getattr(inner, "max_episode_steps", usual))  # in rehearsal more than are performed
    if (seen := observed_track(env)) > agent.track:
        raise SettingsError(
            f"agent `{agent.name}` is of the track `{agent.track}`, but these observations tell `{seen}`: make the "
            f'environment with observation="{agent.track}", or declare the agent\'s `track`'
        )
    shape = env.observation_space.shape
    trained = getattr(getattr(getattr(agent, "policy", None), "observation_space", None), "shape", shape)
    if trained != shape:
        raise SettingsError(
            f"agent `{agent.name}` was trained with observations of shape {trained}, but these have {shape}: it plays "
            "memories with as many PB units and episodes of the same length"
        )
    imagination = Imagination(_imaginer(env), int(getattr(inner, "n_imagined", 0)))
    spaces = env.action_space, env.observation_space
    memory = getattr(inner, "memory", None)
    physics = bool(getattr(inner, "physics", False))
    agent.begin(Context(*spaces, n_steps, rng, memory, imagination, n_decisions=n_decisions, physics=physics))
    n_movements, ended = 0, False
    while not ended and n_movements != n_actions:
        pb = agent.ask(observation)
        observation, reward, terminated, truncated, info = env.step(pb)
        agent.tell(pb, observation, float(reward), info)
        n_movements += "outcome" in info
        ended = terminated or truncated
        yield Step(pb, float(reward), info, max(imagination.n_used, int(info.get("n_imagined", 0))))
    if n_actions is not None and (not ended or n_movements < n_actions):
        found = "goes on" if not ended else f"ends after {n_movements}"
        raise SettingsError(f"`n_actions` should be the environment's episode length, but is {n_actions}; it {found}")


def observed_track(env: gym.Env) -> Track:
    """Return what the observations of an environment tell; those of other projects count as outcomes."""
    inner: Any = env.unwrapped
    parts = {part.name for part in getattr(inner, "observation_parts", ())}
    if any(column.name == "distances" for column in getattr(inner, "try_columns", ())):
        return Track.TRAJECTORIES
    return Track.POINTS if "points" in parts else Track.OUTCOMES


def told_track(env_id: str, env_kwargs: Mapping[str, Any]) -> Track:
    """Return what the observations of an environment tell, by its name and settings; nothing is imported by them."""
    registered = gym.registry.get(env_id)
    told = {**({} if registered is None else registered.kwargs), **env_kwargs}.get("observation", CELLS)
    return Track.OUTCOMES if told == CELLS else Track(told)


def _imaginer(env: gym.Env) -> Callable[[np.ndarray, bool], list[dict[str, Any]]] | None:
    """Return what imagines movements in the episode that an environment is in; None if it cannot."""
    inner: Any = env.unwrapped
    if not hasattr(inner, "imagine"):
        return None
    twins: list[Any] = []

    def imagine(pb: np.ndarray, with_body: bool) -> list[dict[str, Any]]:
        if with_body and getattr(inner, "physics", False):
            if not twins:
                twins.append(gym.make(inner.spec).unwrapped)  # pyright: ignore[reportArgumentType]
            state, found = inner.get_state(), []
            for point in pb:
                twins[0].set_state(state)
                info: dict[str, Any] = {}
                reward: Any = 0.0
                for one in np.broadcast_to(point, (getattr(inner, "n_decisions", 1), pb.shape[-1])):
                    _, reward, _, _, info = twins[0].step(one)
                found.append({**info, "reward": float(reward)})
            return found
        terms = inner.imagine(pb)
        rows = [{name: _plain(values[row]) for name, values in terms.items()} for row in range(len(pb))]
        return [{**row, "reward": row["reward_novelty"]} for row in rows]

    return imagine


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def make_env(env_id: str, memory: Any, agent: Agent, n_actions: int | None = None) -> gym.Env:
    """Make an environment of the project in which an agent sees what its track is told and has its two budgets.

    An environment of another project is made with `memory` alone.
    """
    from creative_nao.envs import ENVIRONMENTS

    if env_id not in ENVIRONMENTS:
        return gym.make(env_id, memory=memory)
    given: dict[str, Any] = {} if n_actions is None else {"n_actions": n_actions}
    if "observation" in gym.spec(env_id).kwargs:
        given["observation"] = str(min(Track(agent.track), Track.TRAJECTORIES))
    if agent.n_candidates > 1:
        given["n_imagined"] = agent.n_candidates * (n_actions or _USUAL_BUDGET)
    return gym.make(env_id, memory=memory, **given)


def evaluate_agent(
    agent: Agent,
    env_id: str,
    memories: Iterable[str],
    seeds: Sequence[int],
    *,
    progress: Callable[[int], None] | None = None,
) -> tuple[PlayedEpisode, ...]:
    """Let an agent play one episode for each memory and seed.

    Args:
        agent: The agent.
        env_id: Name of the environment.
        memories: Names or files of memories.
        seeds: Each decides the environment's and the agent's draws of an episode.
        progress: Called with the number of episodes played.

    Raises:
        NotFoundError: If there is no such environment or memory.
        SettingsError: If its spaces are no boxes.
    """
    episodes: list[PlayedEpisode] = []
    seeds = checked(tuple[Index, ...], tuple(seeds) if isinstance(seeds, Iterable) else seeds, "seeds")
    named = tuple(memories) if isinstance(memories, Iterable) and not isinstance(memories, str) else memories
    for memory in checked(tuple[LongText, ...], named, "memories"):
        check_env(env_id)
        env = make_env(env_id, memory, agent)
        try:
            for seed in seeds:
                steps = [*play_episode(agent, env, seed=seed, rng=np.random.default_rng(seed))]
                reward, last = math.fsum(step.reward for step in steps), steps[-1]
                measures = told_measures(last.info)
                episodes.append(PlayedEpisode(memory, seed, reward, **measures, n_imagined=last.n_imagined))
                if progress is not None:
                    progress(len(episodes))
        finally:
            env.close()
    return tuple(episodes)


def told_measures(info: Mapping[str, Any]) -> dict[str, Any]:
    """Return the `MEASURES` that the last `info` of an episode tells; None for what is missing or NaN."""
    found = {name: info.get("episode_measures", {}).get(name) for name in MEASURES}
    return {name: None if value is None or math.isnan(value) else float(value) for name, value in found.items()}


def evaluate_policy(
    policy: Policy,
    env_id: str,
    memories: Iterable[str],
    seeds: Sequence[int],
    deterministic: bool,
    progress: Callable[[int], None] | None = None,
) -> Score:
    """Return the score of a policy over memories and seeds on one thread of torch; see `evaluate_agent`."""
    import torch

    torch.set_num_threads(1)  # so that sums are made in the same order everywhere
    agent = PolicyAgent(policy, deterministic=deterministic)
    return Score(env_id, deterministic, evaluate_agent(agent, env_id, memories, seeds, progress=progress))


def check_env(env_id: str) -> EnvSpec:
    """Return the entry of an environment's name; a `NotFoundError` offers the nearest.

    The module of ``module:Name-v0`` is imported; the current folder is searched for it last.
    """
    module, colon, name = checked(str, env_id, "env_id").rpartition(":")
    try:
        if colon:
            search_current_folder()
            importlib.import_module(module)
        return gym.spec(name)
    except (gym.error.Error, ImportError, ValueError) as error:
        from creative_nao.envs import ENVIRONMENTS

        raise NotFoundError(
            f"no environment `{env_id}`{nearest_name(env_id, ENVIRONMENTS)}; there are {', '.join(ENVIRONMENTS)}"
        ) from error
