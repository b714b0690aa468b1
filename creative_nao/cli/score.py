"""`creative-nao score`: how new is a recorded movement?"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import tyro

from creative_nao.demonstrations import load_demonstrations, load_trajectory
from creative_nao.errors import SettingsError
from creative_nao.measures import score


@dataclass(frozen=True)
class ScoreSettings:
    """Score movements from CSV files, of any source, against the basic actions."""

    files: tyro.conf.Positional[tuple[Path, ...]]
    """CSV files with the header time_s,RShoulderPitch,... in seconds and radians; any rate."""
    demonstrations: Path | None = None
    """Folder of CSV recordings to compare with; default: the six shipped boxing actions."""
    json: bool = False
    """Print the scores as JSON."""


def run(settings: ScoreSettings) -> int:
    """Print outcome, distance and nearest basic action of each file."""
    if not settings.files:
        raise SettingsError("score: name at least one CSV file")
    basic = load_demonstrations(settings.demonstrations)
    trajectories = [load_trajectory(path, dt_s=basic.dt_s, joints=basic.joints) for path in settings.files]
    scores = score(trajectories, basic)
    rows = [
        {"file": str(path), "outcome": str(outcome), "distance": float(distance), "nearest": basic.names[int(nearest)]}
        for path, outcome, distance, nearest in zip(
            settings.files, scores.outcome, scores.novelty, scores.nearest, strict=True
        )
    ]
    if settings.json:
        print(json.dumps(rows))  # noqa: T201 - the command's output
        return 0
    for row in rows:
        print(  # noqa: T201
            f"{row['file']}: {row['outcome'].replace('_', '-')}, DTW {row['distance']:.2f} from {row['nearest']}"
        )
    return 0
