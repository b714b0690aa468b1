"""`creative-nao agent run` and `agent tune`: let an agent play, and search hyperparameters with Optuna."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import tyro

from creative_nao.agents.base import PolicyAgent
from creative_nao.agents.bundle import TrainedPolicy, replay
from creative_nao.agents.play import PlayedEpisode, Score, evaluate_agent
from creative_nao.agents.registry import make_agent
from creative_nao.agents.training import memories_of
from creative_nao.agents.tuning import TuningPlan, tune
from creative_nao.cli.terminal import Display, print_result
from creative_nao.errors import SettingsError
from creative_nao.schema import Count, checked


@dataclasses.dataclass(frozen=True)
class RunAgentSettings:
    """Let an agent play episodes: a bundle, a shipped agent such as ppo/BoxingMental-v0, or an untrained one."""

    agent: tyro.conf.Positional[str]
    """Shipped name, path of a bundle, name of an untrained agent such as random, or module:factory of your own."""
    env: str | None = None
    """Environment; default: the one a trained agent is for, else CreativeNao/BoxingMental-v0."""
    memory: str = "validation"
    """Memory by name or file, or a part of the bank: train, validation, test."""
    seed: int = 0
    """Seed of the first episode of each memory; every further episode has the next one."""
    episodes: int = 1
    """Episodes of each memory."""
    replay: bool = False
    """Play the score that the bundle records again, and say whether it is reproduced; sets memories and seeds."""
    json: bool = False
    """Print the episodes as JSON."""


def run_episodes(settings: RunAgentSettings) -> int:
    """Play, print one line an episode and the mean with its interval."""
    checked(Count, settings.episodes, "--episodes")
    agent = make_agent(settings.agent)
    trained = agent.policy if isinstance(agent, PolicyAgent) and isinstance(agent.policy, TrainedPolicy) else None
    if settings.replay:
        if trained is None:
            raise SettingsError(f"--replay needs a trained agent with a recorded score, but got `{settings.agent}`")
        return _replay(trained, settings)
    env_id = settings.env or (trained.header.env if trained is not None else "CreativeNao/BoxingMental-v0")
    if settings.env is None and trained is not None:
        env_id = _of_the_bundle(trained.header.env if trained.header.score is None else trained.header.score.env)
    memories = memories_of(settings.memory)
    seeds = range(settings.seed, settings.seed + settings.episodes)
    with Display({"playing": len(memories) * len(seeds)}) as display:
        episodes = evaluate_agent(agent, env_id, memories, seeds, progress=lambda done: display.show("playing", done))
    deterministic = agent.deterministic if isinstance(agent, PolicyAgent) else True
    score = Score(env_id, deterministic, episodes)
    low, high = score.interval
    mean = (
        f"{agent.name} in {env_id}: mean reward {score.mean:.2f} ({low:.2f} to {high:.2f}, "
        f"95 % over {len(memories)} memories), {len(episodes)} episodes"
    )
    print_result({"agent": agent.name, **score.as_json()}, [*map(_line, episodes), mean], as_json=settings.json)
    return 0


def _replay(trained: TrainedPolicy, settings: RunAgentSettings) -> int:
    recorded = trained.header.score
    if recorded is not None and recorded.env != settings.env:
        _of_the_bundle(recorded.env)
    n_episodes = 1 if recorded is None else len(recorded.episodes)
    with Display({"replaying": n_episodes}) as display:
        score = replay(trained, progress=lambda done: display.show("replaying", done))
    assert recorded is not None  # else `replay` has refused
    same, made_with = score == recorded, f"{trained.header.machine}, {trained.header.versions}"
    verdict = "reproduced exactly" if same else f"not reproduced, now {score.mean!r}; recorded with {made_with}"
    line = f"{settings.agent}: recorded {recorded.mean!r} over {n_episodes} episodes in {recorded.env}: {verdict}"
    figures = {"agent": trained.header.agent, "reproduced": same, **score.as_json()}
    print_result(figures, [line], as_json=settings.json)
    return 0 if same else 1


def _of_the_bundle(env_id: str) -> str:
    """Return the environment that a bundle names; a module is only imported where the user has typed its name."""
    if ":" in env_id:
        raise SettingsError(
            f"the bundle names the environment {env_id}, whose module would be imported and run; if you trust it, "
            f"add --env {env_id}"
        )
    return env_id


def _line(episode: PlayedEpisode) -> str:
    parts = [f"{episode.memory:<10} seed {episode.seed}: reward {episode.reward:6.2f}"]
    if episode.appropriateness_pct is not None:
        parts.append(f"appropriate {episode.appropriateness_pct:5.1f} %")
    for name in ("novelty", "diversity"):
        if (value := getattr(episode, name)) is not None:
            parts.append(f"{name} {value:5.2f}")
    return ", ".join(parts)


@dataclasses.dataclass(frozen=True)
class TuneAgentSettings:
    """Search better hyperparameters: every trial trains on the train memories and is scored on the validation ones.

    The folder --out gets study.journal, which a later call with --resume goes on from, and ALGORITHM.yml with the best
    entry, for `creative-nao agent train --conf-file`. Test memories play no part.
    """

    algorithm: tyro.conf.Positional[str]
    """ppo, sac, td3; with the extra `agents`: recurrent_ppo, tqc, crossq."""
    out: Path
    """Folder to write."""
    env: str = "CreativeNao/BoxingMental-v0"
    """Environment."""
    trials: int = 20
    """Trials in the whole study; with --resume, those already done count."""
    timesteps: int = 20_000
    """Decisions in the training of a trial."""
    judged_seeds: int = 3
    """Episodes of each validation memory that score a trial; more of them tell closer trials apart."""
    seed: int = 0
    """Seed of the search and of each training."""
    conf_file: Path | None = None
    """Hyperparameters to start from; default: the shipped ones, which are the first trial."""
    resume: bool = False
    """Go on from the study in --out."""
    json: bool = False
    """Print the figures as JSON."""


def run_tune(settings: TuneAgentSettings) -> int:
    """Search, write the best entry, print it."""
    if settings.out.is_file():
        raise SettingsError(f"--out should name a folder, but {settings.out} is a file")
    plan = TuningPlan(
        settings.algorithm,
        settings.env,
        n_trials=settings.trials,
        n_timesteps=settings.timesteps,
        seed=settings.seed,
        conf_file=settings.conf_file,
        n_judged_seeds=settings.judged_seeds,
    )
    with Display({"tuning": settings.trials}) as display:
        result = tune(
            plan,
            settings.out,
            resume=settings.resume,
            progress=lambda done, best: display.show("tuning", done, f"best {best:.2f}"),
        )
    figures = {**vars(result), "path": str(result.path)}
    lines = [
        f"{result.path}: best of {result.n_trials} trials, validation reward {result.best_reward:.2f} "
        f"(starting values {result.first_reward:.2f})",
        *(f"  {name}: {value}" for name, value in result.best.items()),
    ]
    print_result(figures, lines, as_json=settings.json)
    return 0


def run(settings: RunAgentSettings | TuneAgentSettings) -> int:
    """Run the command chosen."""
    return run_episodes(settings) if isinstance(settings, RunAgentSettings) else run_tune(settings)
