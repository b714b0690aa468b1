"""`creative-nao agent tune`: search hyperparameters on validation memories with Optuna."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import tyro

from creative_nao.agents.tuning import TuningPlan, tune
from creative_nao.cli.terminal import Display, print_result
from creative_nao.errors import SettingsError


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


def run(settings: TuneAgentSettings) -> int:
    """Search, write the best entry, print it.

    Raises:
        SettingsError: If the folder holds a study and --resume is not given.
    """
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
    figures = {
        "path": str(result.path),
        "n_trials": result.n_trials,
        "first_reward": result.first_reward,
        "best_reward": result.best_reward,
        "best": result.best,
    }
    lines = [
        f"{result.path}: best of {result.n_trials} trials, validation reward {result.best_reward:.2f} "
        f"(starting values {result.first_reward:.2f})",
        *(f"  {name}: {value}" for name, value in result.best.items()),
    ]
    print_result(figures, lines, as_json=settings.json)
    return 0
