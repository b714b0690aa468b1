"""Search hyperparameters with Optuna: trained on train memories, scored on validation memories, resumable.

The study is a journal file of plain text. The first trial is the starting values themselves, so that the search is
measured against them. Tuning picks the best of many noisy scores: the winner's own score is too good by that choice,
and only the test memories, which play no part here, tell how good it is.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from creative_nao.agents.settings import (
    CELL_POLICY,
    CELL_SAC_POLICY,
    RELEASED_NAMES,
    Hyperparameters,
    find_algorithm,
    read_hyperparameters,
)
from creative_nao.agents.training import TrainingPlan, train_agent
from creative_nao.errors import FileFormatError, SettingsError, load_extra
from creative_nao.schema import Count, Field, Index, LongText, Text, parse, record
from creative_nao.storage import read_bytes, write_bytes, write_text

MAX_JOURNAL_BYTES, MAX_JOURNAL_LINES = 8_000_000, 50_000
"""Of a study: some thousand trials."""


@record(closed=False)
class _Operation:
    """A line of a journal, which Optuna reads."""

    op_code: Annotated[int, Field(ge=0, le=20)]


@record
class TuningPlan:
    """What is searched.

    Attributes:
        algorithm: Name of the algorithm.
        env: Name of the environment.
        n_trials: Trials in the whole study.
        n_timesteps: Decisions in the training of a trial.
        seed: Seed of the search and of each training.
        conf_file: Hyperparameters to start from; None for the shipped ones.
        n_judged_seeds: Episodes of each validation memory that score a trial. Trials differ by less than an episode's
            luck, so that a search with few of them picks the luckiest.
    """

    algorithm: Text
    env: LongText
    n_trials: Count = 20
    n_timesteps: Count = 20_000
    seed: Index = 0
    conf_file: Path | None = None
    n_judged_seeds: Count = 3

    def __post_init__(self) -> None:
        if find_algorithm(self.algorithm).supervised:
            raise SettingsError(f"{self.algorithm} has no search: train it with several files of --conf-file")


@dataclass(frozen=True)
class TuningResult:
    """What was found."""

    path: Path
    """YAML file of the best entry."""
    n_trials: int
    first_reward: float
    """Validation reward of the starting values."""
    best_reward: float
    best: dict[str, Any]
    """The values chosen in the best trial."""


def tune(
    plan: TuningPlan, out: Path, *, resume: bool = False, progress: Callable[[int, float], None] | None = None
) -> TuningResult:
    """Run the trials that are still missing and write the best entry.

    Args:
        plan: What to search.
        out: Folder for `study.journal` and ``ALGORITHM.yml``.
        resume: Go on from the study in `out`.
        progress: Called with the number of trials done and the best reward so far.

    Raises:
        MissingDependencyError: If Optuna is not installed.
        SettingsError: If there is a study already and `resume` is not set, or it is of another plan.
        FileFormatError: If the study is a link, too large, or none of this command.
    """
    import yaml

    optuna: Any = load_extra("optuna", "tune", f"the search for `{plan.algorithm}`")
    known = find_algorithm(plan.algorithm)
    start = read_hyperparameters(known.name, plan.env, plan.conf_file).replace(n_timesteps=plan.n_timesteps)
    journal = out / "study.journal"
    if os.path.lexists(journal) and not resume:
        raise SettingsError(f"{journal} is left from an earlier search; go on from it with --resume, or remove it")
    out.mkdir(parents=True, exist_ok=True)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    about = {"start": start.as_zoo(), "algorithm": known.name}
    about |= {name: getattr(plan, name) for name in ("env", "seed", "n_judged_seeds")}
    study = _open_study(optuna, journal, start)
    try:
        kept = study.user_attrs.get("about", about)
        named = {name: RELEASED_NAMES.get(str(value), value) for name, value in kept["start"].items()}
        is_same = {**kept, "start": named} == about
    except (KeyError, TypeError, AttributeError) as error:
        raise FileFormatError(f"{journal}: not a study of this command: `about` is of another kind") from error
    if not is_same:
        raise SettingsError(f"{journal} is a search with other settings; give the same ones to go on, or another --out")
    study.set_user_attr("about", about)

    def finished() -> list[Any]:
        return study.get_trials(deepcopy=False, states=(optuna.trial.TrialState.COMPLETE,))

    while (n_done := len(finished())) < plan.n_trials:
        # A sampler for each trial, so that a search that was interrupted goes on with the same draws.
        study.sampler = optuna.samplers.TPESampler(seed=plan.seed * 100_003 + n_done, n_startup_trials=5)
        study.optimize(lambda trial, first=n_done == 0: _reward(trial, plan, start, first), n_trials=1)
        if progress is not None:
            progress(len(finished()), study.best_value)
    best = study.best_trial
    entry = suggest(optuna.trial.FixedTrial(best.params), start) if best.params else start
    whole = read_hyperparameters(known.name, plan.env, plan.conf_file).n_timesteps
    path = out / f"{known.name}.yml"
    complete = finished()
    values = {plan.env: entry.replace(n_timesteps=whole).as_zoo()}
    text = yaml.safe_dump(values, sort_keys=False, default_flow_style=None)
    head = (
        f"# Best of {len(complete)} trials of {plan.n_timesteps} decisions, seed {plan.seed}; "
        f"validation reward {study.best_value:.3f} (optimistic: it is the best of many)"
    )
    write_text(path, f"{head}\n{text}")
    return TuningResult(path, len(complete), complete[0].value, study.best_value, dict(best.params))


def _open_study(optuna: Any, journal: Path, start: Hyperparameters) -> Any:
    """Return the study in a journal, or a new one; what Optuna is given is a plain file of bounded JSON lines."""
    if os.path.lexists(journal):
        content = read_bytes(journal, "journal of a study", MAX_JOURNAL_BYTES, follow=False)
        lines = content.splitlines(keepends=True)
        if lines and not lines[-1].endswith(b"\n"):
            lines.pop()  # what a killed search was about to write
        if len(lines) > MAX_JOURNAL_LINES:
            raise FileFormatError(f"{journal}: has {len(lines)} lines, expected at most {MAX_JOURNAL_LINES}")
        for number, line in enumerate(lines, start=1):
            parse(_Operation, line, f"{journal}: line {number}")
        write_bytes(journal, b"".join(lines))  # a file of its own, whoever else had hold of the old one
    try:
        backend = optuna.storages.JournalStorage(optuna.storages.journal.JournalFileBackend(str(journal)))
        study = optuna.create_study(storage=backend, study_name="tuning", direction="maximize", load_if_exists=True)
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # a value out of its range
            for trial in study.get_trials(deepcopy=False, states=(optuna.trial.TrialState.COMPLETE,)):
                if trial.params:
                    suggest(optuna.trial.FixedTrial(trial.params), start)
    except Exception as error:  # whatever Optuna says to a stranger's journal
        raise FileFormatError(f"{journal}: not a study of this command: {type(error).__name__}: {error}") from error
    return study


def suggest(trial: Any, start: Hyperparameters) -> Hyperparameters:
    """Return the starting values with those that are searched replaced by the trial's."""
    on_policy = find_algorithm(start.algorithm).on_policy
    arguments = dict(start.arguments)
    rate = trial.suggest_float("learning_rate", 1e-4, 1e-2, log=True)
    arguments["learning_rate"] = f"lin_{rate!r}" if on_policy else rate
    arguments["gamma"] = trial.suggest_categorical("gamma", [0.0, 0.5, 0.8, 0.95, 0.99])
    noise = start.noise_std
    policy_kwargs = dict(start.policy_kwargs)
    if on_policy:
        arguments["ent_coef"] = trial.suggest_categorical("ent_coef", [0.0, 0.001, 0.01])
        arguments["n_epochs"] = trial.suggest_int("n_epochs", 4, 16)
        arguments["gae_lambda"] = trial.suggest_categorical("gae_lambda", [0.8, 0.9, 0.95, 1.0])
        if start.policy != CELL_POLICY:
            policy_kwargs["log_std_init"] = trial.suggest_float("log_std_init", -1.5, 0.5)
    else:
        arguments["gradient_steps"] = trial.suggest_int("gradient_steps", 1, 8)
        arguments["batch_size"] = trial.suggest_categorical("batch_size", [64, 128, 256])
        if "tau" in find_algorithm(start.algorithm).parameters():
            arguments["tau"] = trial.suggest_categorical("tau", [0.005, 0.01, 0.02, 0.05])
        if noise is not None:
            noise = trial.suggest_float("noise_std", 0.05, 0.8)
    if start.policy in (CELL_POLICY, CELL_SAC_POLICY):
        policy_kwargs["width"] = trial.suggest_categorical("width", [8, 16, 24])
        return start.replace(arguments=arguments, policy_kwargs=policy_kwargs)
    width = trial.suggest_categorical("width", [32, 64, 128])
    layers = policy_kwargs.get("net_arch", [64, 64])
    if isinstance(layers, dict):
        policy_kwargs["net_arch"] = {name: [width] * len(widths) for name, widths in layers.items()}
    else:
        policy_kwargs["net_arch"] = [width] * len(layers)
    return start.replace(arguments=arguments, policy_kwargs=policy_kwargs, noise_std=noise)


def _reward(trial: Any, plan: TuningPlan, start: Hyperparameters, first: bool) -> float:
    """Train once; return the mean of the last evaluation on validation memories (never the best one)."""
    chosen = start if first else suggest(trial, start)
    training = TrainingPlan(
        chosen,
        env=plan.env,
        judged_env=plan.env,
        seed=plan.seed,
        judged_seeds=tuple(range(plan.n_judged_seeds)),
        evaluation_interval=plan.n_timesteps,
    )
    _, record = train_agent(training)
    last = record.evaluations[-1]
    return math.fsum(last) / len(last)
