"""`creative-nao teach`: lead the arms of the simulated robot through the basic actions and keep the recording."""

from __future__ import annotations

import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from creative_nao import runtime
from creative_nao.cli.terminal import changed_flags, print_result
from creative_nao.demonstrations import GuidanceVariation, save_demonstrations
from creative_nao.errors import SettingsError
from creative_nao.measures import dtw_matrix

if TYPE_CHECKING:
    from creative_nao.demonstrations.teaching import Lesson


@dataclass(frozen=True)
class TeachSettings:
    """Teach the simulated robot the six basic boxing actions by leading its limp arms, and record them."""

    out: Path
    """Folder for the six CSV files and record.json; files of these names are replaced."""
    seed: int = 0
    """Seed of everything in which the person varies; the same seed gives the same files."""
    timing: float = GuidanceVariation.timing
    """How much the duration of each part of a movement varies, as a share of it (standard deviation)."""
    reach: float = GuidanceVariation.reach
    """How much each key posture falls short or goes far, as a share of its way from the guard (standard deviation)."""
    drift_rad: float = GuidanceVariation.drift_rad
    """Slow wander of each joint, standard deviation [rad]."""
    tremor_rad: float = GuidanceVariation.tremor_rad
    """Tremor of the hand in each joint, 8 to 12 Hz, standard deviation [rad]."""
    json: bool = False
    """Print the figures as JSON instead of a table."""


def run(settings: TeachSettings) -> int:
    """Teach, check, write the files, print the figures; the exit code is 1 when what was taught has shortcomings.

    The files are written all the same; the shortcomings stand in the record and on the error stream.
    """
    from creative_nao.demonstrations.teaching import MIN_DISTANCE_RAD, as_demonstrations, shortcomings, teach

    if settings.seed < 0:
        raise SettingsError(f"`seed` should be 0 or larger, but is {settings.seed}.")
    if settings.out.exists() and not settings.out.is_dir():
        raise SettingsError(f"`out` should be a folder, but {settings.out} is a file.")
    variation = GuidanceVariation(settings.timing, settings.reach, settings.drift_rad, settings.tremor_rad)
    lessons = teach(np.random.default_rng(settings.seed), variation=variation)
    demos = as_demonstrations(lessons)
    distances = dtw_matrix(demos.trajectories)
    apart = distances[np.triu_indices(len(distances), 1)]
    too_close = [
        f"{demos.names[i]} and {demos.names[j]} are {distances[i, j]:.1f} apart, expected {MIN_DISTANCE_RAD} or more."
        for i, j in np.argwhere(np.triu(distances < MIN_DISTANCE_RAD, 1))
    ]
    figures = {
        "actions": {lesson.name: _figures(lesson, demos.dt_s) for lesson in lessons},
        "max_speed_rad_s": demos.max_speed,
        "distances": distances.round(3).tolist(),
        "smallest_distance": float(apart.min()),
        "mean_distance": float(apart.mean()),
        "shortcomings": [*shortcomings(lessons, demos), *too_close],
    }
    record = runtime.record(
        settings={k: v for k, v in dataclasses.asdict(settings).items() if k not in ("out", "json")},
        command=_command(settings),
    )
    record |= {"method": "kinesthetic teaching in simulation", "dt_s": demos.dt_s, "names": demos.names} | figures
    save_demonstrations(settings.out, dataclasses.replace(demos, record=record))
    print_result(figures, _lines(figures, settings.out), as_json=settings.json)
    for sentence in figures["shortcomings"]:
        sys.stderr.write(f"creative-nao: {sentence}\n")
    return 1 if figures["shortcomings"] else 0


def _command(settings: TeachSettings) -> str:
    """Return the command that gives the same files again; a folder outside the working directory is not named."""
    words = ["creative-nao", "teach", "--out", "DIR" if settings.out.is_absolute() else settings.out.as_posix()]
    names = ("timing", "reach", "drift_rad", "tremor_rad")
    return " ".join([*words, f"--seed {settings.seed}", *changed_flags(settings, names)])


def _figures(lesson: Lesson, dt_s: float) -> dict[str, Any]:
    lag, whole = np.abs(lesson.recorded - lesson.led), np.abs(lesson.recorded - lesson.meant)
    return {
        "max_speed_rad_s": float(np.abs(np.diff(lesson.recorded, axis=0)).max() / dt_s),
        "from_hand_mean_rad": float(lag.mean()),
        "from_hand_max_rad": float(lag.max()),
        "from_keyframes_mean_rad": float(whole.mean()),
        "from_keyframes_max_rad": float(whole.max()),
        "pull_mean_n": lesson.mean_pull_n,
        "pull_max_n": lesson.max_pull_n,
        "self_contact_share": lesson.self_contact_share,
    }


def _lines(figures: dict[str, Any], out: Path) -> list[str]:
    lines = [f"{'':16}{'speed':>8}{'from the hand':>18}{'from the key postures':>24}{'pull':>14}"]
    lines += [f"{'':16}{'rad/s':>8}{'mean, max rad':>18}{'mean, max rad':>24}{'mean, max N':>14}"]
    for name, one in figures["actions"].items():
        lines.append(
            f"{name:16}{one['max_speed_rad_s']:8.2f}"
            f"{one['from_hand_mean_rad']:12.3f}{one['from_hand_max_rad']:6.2f}"
            f"{one['from_keyframes_mean_rad']:18.3f}{one['from_keyframes_max_rad']:6.2f}"
            f"{one['pull_mean_n']:8.1f}{one['pull_max_n']:6.1f}"
        )
    lines.append(
        f"Largest speed {figures['max_speed_rad_s']:.2f} rad/s. Distance between two actions: "
        f"at least {figures['smallest_distance']:.1f}, {figures['mean_distance']:.1f} on average."
    )
    lines.append(f"Six actions of 50 postures written to {out}.")
    return lines
