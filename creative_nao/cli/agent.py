"""`creative-nao agent train | run | tune`: train an agent, let one play, search hyperparameters with Optuna."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from creative_nao import storage
from creative_nao.agents.bundle import BundleHeader, TrainedPolicy, machine, replay, save_bundle
from creative_nao.agents.play import PlayedEpisode, Score, check_env, evaluate_agent, evaluate_policy
from creative_nao.agents.record import FOLDER, record_dataset
from creative_nao.agents.registry import make_agent
from creative_nao.agents.resume import TrainingRecord
from creative_nao.agents.settings import find_algorithm, read_hyperparameters
from creative_nao.agents.training import TrainingPlan, memories_of, train_agent
from creative_nao.agents.tuning import TuningPlan, tune
from creative_nao.cli.terminal import Display, changed_flags, print_result, refuse_leftovers, stopped_by_signals
from creative_nao.errors import SettingsError
from creative_nao.runtime import record as provenance
from creative_nao.schema import Count, checked

FIRST_SCORE_SEED = 100
"""The recorded score is played with other seeds than those that chose the weights."""


@dataclasses.dataclass(frozen=True)
class TrainAgentSettings:
    """Train an agent on the bank's train memories, judged on its validation memories, and write a bundle.

    The folder --out gets agent.safetensors (the bundle), checkpoint.safetensors, episodes.csv, evaluations.csv,
    progress.csv and run.json. After Ctrl-C or a crash, the same command with --resume goes on from the checkpoint and
    ends with the same bits as an uninterrupted run.
    """

    algorithm: tyro.conf.Positional[str]
    """ppo, sac, td3, learned_map; with the extra `agents`: recurrent_ppo, tqc, crossq."""
    out: Path
    """Folder to write."""
    env: str | None = None
    """Environment the agent is for: its hyperparameters, and where its recorded score is played; default:
    CreativeNao/BoxingMental-v0, of learned_map CreativeNao/BoxingMental-v1."""
    train_env: str | None = None
    """Environment to train in: the mental twin of a physical one is hundreds of times faster; default: --env."""
    seed: int = 0
    """Seed of weights, draws and environments; one seed, one agent."""
    timesteps: int | None = None
    """Decisions in training, of learned_map simulated episodes; default: those of the hyperparameter file."""
    conf_file: Path | None = None
    """Hyperparameters as YAML in RL Zoo's format; default: the shipped ones."""
    augment: bool | None = None
    """Flip and swap the axes of the PB space anew in each training episode; default: as the hyperparameters say."""
    memory: str = "train"
    """Memory, or part of the bank, to train on; never a test memory."""
    validation_memory: str = "validation"
    """Memory, or part of the bank, to be judged on."""
    memories: Path | None = None
    """Of learned_map: folder of `creative-nao agent memories`, to train on beside --memory."""
    validation_memories: Path | None = None
    """Of learned_map: another such folder, to be judged on beside --validation-memory."""
    evaluation_interval: int = 20_000
    """Decisions from one evaluation to the next; the best weights are kept."""
    judged_seeds: int = 2
    """Episodes of each validation memory at an evaluation; with few of them the luckiest weights are kept."""
    checkpoint_interval: int = 20_000
    """Decisions from one checkpoint to the next."""
    score_seeds: int = 5
    """Episodes of each validation memory in the recorded score."""
    resume: bool = False
    """Go on from the checkpoint in --out, if there is one."""
    tensorboard: bool = False
    """Write TensorBoard files into --out as well."""
    json: bool = False
    """Print the figures as JSON."""


def run_train(settings: TrainAgentSettings) -> int:
    """Train, write bundle and logs, print the recorded score; after Ctrl-C only the checkpoint is written."""
    settings = dataclasses.replace(settings, env=settings.env or _env_of(settings.algorithm))
    plan = _plan(settings)
    supervised = find_algorithm(settings.algorithm).supervised
    checkpoint = settings.out / "checkpoint.safetensors"
    if settings.judged_seeds > FIRST_SCORE_SEED:
        raise SettingsError(
            f"--judged-seeds should be at most {FIRST_SCORE_SEED}, but is {settings.judged_seeds}: "
            "the recorded score is played with the seeds after them"
        )
    checked(Count, settings.score_seeds, "--score-seeds")
    if settings.out.is_file():
        raise SettingsError(f"--out should name a folder, but {settings.out} is a file")
    refuse_leftovers([] if settings.resume else [checkpoint])
    n_decisions = plan.hyperparameters.n_timesteps
    with Display({"training": n_decisions}) as display, stopped_by_signals() as stop:

        def show(record: TrainingRecord, done: int) -> None:
            note = f"validation {np.mean(record.evaluations[-1]):.2f}, best {record.best_mean:.2f}"
            display.show("training", min(done, n_decisions), note)

        options: dict[str, Any] = {
            "checkpoint": checkpoint, "resume": settings.resume, "logs": settings.out, "progress": show, "stop": stop,
        }  # fmt: skip
        if supervised:
            policy, record, n_actions_training = _train_map(plan, settings, options)
        else:
            tensorboard = settings.out / "tensorboard" if settings.tensorboard else None
            policy, record = train_agent(plan, tensorboard=tensorboard, **options)
            n_actions_training = n_decisions
    header = BundleHeader(
        agent=plan.hyperparameters.algorithm,
        settings=plan.hyperparameters,
        env=plan.env,
        memory=plan.memory,
        seed=plan.seed,
        n_actions_training=n_actions_training,
        observation_space=policy.observation_space,
        action_space=policy.action_space,
        command=_command(settings, plan),
        machine=machine(),
    )
    score = _score(TrainedPolicy(header, policy), settings, plan)
    header = dataclasses.replace(header, score=score)
    bundle = save_bundle(settings.out / "agent.safetensors", header, policy)
    low, high = score.interval
    figures = {
        "bundle": str(bundle),
        "agent": header.agent,
        "env": score.env,
        "seed": header.seed,
        "n_decisions": n_decisions,
        "n_actions_training": n_actions_training,
        "deterministic": score.deterministic,
        "validation_reward": {"mean": score.mean, "low": low, "high": high},
        "untrained_reward": float(np.mean(record.evaluations[0])),
        "n_episodes": len(score.episodes),
    }
    whole = {**provenance(settings=plan.as_json(), command=header.command), **figures}
    storage.write_text(settings.out / "run.json", json.dumps(whole, indent=2) + "\n")
    print_result(figures, _training_lines(figures), as_json=settings.json)
    return 0


def _env_of(algorithm: str) -> str:
    return f"CreativeNao/BoxingMental-v{int(find_algorithm(algorithm).supervised)}"


def _train_map(
    plan: TrainingPlan, settings: TrainAgentSettings, options: dict[str, Any]
) -> tuple[Any, TrainingRecord, int]:
    """Train a learned map; return it, the record, and how many movements of train memories were generated for it."""
    from creative_nao.agents.learned_map.training import train_map
    from creative_nao.agents.learned_map.truth import bank_truths, read_truths

    cache, n_segments = settings.out / "truths", int(plan.hyperparameters.policy_kwargs.get("n_segments", 1))
    parts = plan.memory, plan.judged_memory
    truths, judged = (bank_truths(memories_of(name), cache, n_segments) for name in parts)
    truths += [] if settings.memories is None else read_truths(settings.memories)
    judged += [] if settings.validation_memories is None else read_truths(settings.validation_memories)
    policy, record = train_map(plan, truths, judged, **options)
    return policy, record, sum(len(truth.pb) for truth in truths)


def _plan(settings: TrainAgentSettings) -> TrainingPlan:
    known, env = find_algorithm(settings.algorithm), str(settings.env)
    trained_in = env if settings.train_env is None else settings.train_env
    for env_id in (env, trained_in):
        check_env(env_id)
    of_maps = [name for name in ("memories", "validation_memories") if getattr(settings, name) is not None]
    of_envs = [name for name in ("train_env", "augment") if getattr(settings, name) is not None]
    if wrong := of_envs + ["tensorboard"] * settings.tensorboard if known.supervised else of_maps:
        raise SettingsError(f"--{wrong[0].replace('_', '-')} means nothing to {known.name}")
    chosen = read_hyperparameters(settings.algorithm, env, settings.conf_file)
    if settings.timesteps is not None:
        chosen = chosen.replace(n_timesteps=settings.timesteps)
    if settings.augment is not None:
        chosen = chosen.replace(augment=settings.augment)
    known.load()
    return TrainingPlan(
        chosen,
        env=trained_in,
        judged_env=trained_in,
        seed=settings.seed,
        memory=settings.memory,
        judged_memory=settings.validation_memory,
        judged_seeds=tuple(range(settings.judged_seeds)),
        evaluation_interval=settings.evaluation_interval,
        checkpoint_interval=settings.checkpoint_interval,
    )


def _score(trained: TrainedPolicy, settings: TrainAgentSettings, plan: TrainingPlan) -> Score:
    """Play the recorded score; whether actions are drawn or the likeliest taken is decided where it was trained."""
    memories = memories_of(plan.judged_memory)
    seeds = tuple(range(FIRST_SCORE_SEED, FIRST_SCORE_SEED + settings.score_seeds))
    n_episodes, env = len(memories) * len(seeds), str(settings.env)
    with Display({"scoring": n_episodes * (2 + (env != plan.env))}) as display:

        def play(env_id: str, deterministic: bool, n_before: int) -> Score:
            return evaluate_policy(
                trained, env_id, memories, seeds, deterministic, lambda done: display.show("scoring", n_before + done)
            )

        best = max(play(plan.env, True, 0), play(plan.env, False, n_episodes), key=lambda score: score.mean)
        return best if env == plan.env else play(env, best.deterministic, 2 * n_episodes)


def _command(settings: TrainAgentSettings, plan: TrainingPlan) -> str:
    """Return the command that trains this agent again, without the places of this machine."""
    words = [f"creative-nao agent train {plan.hyperparameters.algorithm} --env {settings.env}"]
    if plan.env != settings.env:
        words.append(f"--train-env {plan.env}")
    words.append(f"--seed {settings.seed} --timesteps {plan.hyperparameters.n_timesteps}")
    if settings.conf_file is not None:
        words.append(f"--conf-file {settings.conf_file.name}")
    if settings.augment is not None:
        words.append(f"--augment {settings.augment}")
    words += changed_flags(
        settings, ("memory", "validation_memory", "evaluation_interval", "judged_seeds", "score_seeds")
    )
    for name in ("memories", "validation_memories"):
        if (folder := getattr(settings, name)) is not None:
            words.append(f"--{name.replace('_', '-')} {folder.name}")
    return " ".join([*words, f"--out {settings.out.name}"])


def _training_lines(figures: dict[str, Any]) -> Iterator[str]:
    reward = figures["validation_reward"]
    how = "likeliest actions" if figures["deterministic"] else "drawn actions"
    counted = "simulated episodes" if find_algorithm(figures["agent"]).supervised else "decisions"
    yield f"{figures['bundle']}: {figures['agent']}, {figures['n_decisions']} {counted}, {how}"
    yield (
        f"reward on validation memories in {figures['env']}: {reward['mean']:.2f} "
        f"({reward['low']:.2f} to {reward['high']:.2f}), {figures['n_episodes']} episodes; "
        f"untrained {figures['untrained_reward']:.2f}"
    )


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
    policy = getattr(agent, "trained", getattr(agent, "policy", None))
    trained = policy if isinstance(policy, TrainedPolicy) else None
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
    deterministic = getattr(agent, "deterministic", True)
    score = Score(env_id, deterministic, episodes)
    low, high = score.interval
    mean = (
        f"{agent.name} in {env_id}: mean reward {score.mean:.2f} ({low:.2f} to {high:.2f}, "
        f"95 % over {len(memories)} memories), {len(episodes)} episodes"
    )
    print_result({"agent": agent.name, **score.as_json()}, [*map(_line, episodes), mean], as_json=settings.json)
    return 0


@dataclasses.dataclass(frozen=True)
class RecordAgentSettings:
    """Write episodes of an agent as a Minari dataset, for offline reinforcement learning (extra `minari`).

    With MINARI_DATASETS_PATH set to --out, Minari's own tools read it: `minari list local`, `minari.load_dataset`.
    """

    agent: tyro.conf.Positional[str]
    """Shipped name, path of a bundle, name of an untrained agent such as random, or module:factory of your own; with @8
    it looks at eight movements, by imagining them, for each one it performs."""
    out: Path
    """Folder of datasets."""
    env: str = "CreativeNao/BoxingMental-v0"
    """Environment."""
    memory: str = "train"
    """Memory by name or file, or a part of the bank: train, validation, test."""
    seed: int = 0
    """Seed of the first episode of each memory; every further episode has the next one."""
    episodes: int = 1
    """Episodes of each memory."""
    dataset: str | None = None
    """Name of the dataset, as Minari has them; default: creative_nao/ENVIRONMENT/AGENT-v0."""
    json: bool = False
    """Print the figures as JSON."""


def run_record(settings: RecordAgentSettings) -> int:
    """Play, write the dataset and print where it is."""
    seeds = range(settings.seed, settings.seed + checked(Count, settings.episodes, "--episodes"))
    agent, env_name = make_agent(settings.agent), settings.env.rpartition("/")[2].rpartition("-v")[0]
    plain = "".join(letter if letter.isalnum() else "_" for letter in settings.agent)
    name = settings.dataset or f"creative_nao/{env_name}/{plain}-v0"
    n_episodes = len(memories_of(settings.memory)) * len(seeds)
    with Display({"recording": n_episodes}) as display:
        path = record_dataset(
            agent, settings.env, settings.memory, seeds, settings.out, name,
            progress=lambda done: display.show("recording", done),
        )  # fmt: skip
    figures = {"dataset": name, "path": str(path), "agent": settings.agent, "n_episodes": n_episodes}
    line = f"{path}: {n_episodes} episodes; read by minari.load_dataset({name!r}) with {FOLDER}={settings.out}"
    print_result(figures, [line], as_json=settings.json)
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


def run(settings: TrainAgentSettings | RunAgentSettings | RecordAgentSettings | TuneAgentSettings) -> int:
    """Run the command chosen."""
    if isinstance(settings, RecordAgentSettings):
        return run_record(settings)
    if isinstance(settings, TrainAgentSettings):
        return run_train(settings)
    return run_episodes(settings) if isinstance(settings, RunAgentSettings) else run_tune(settings)
