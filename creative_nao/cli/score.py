"""`creative-nao score`: how new are recorded movements, and how different from each other?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from creative_nao import exchange
from creative_nao.cli.terminal import print_result
from creative_nao.demonstrations import Demonstrations, load_demonstrations, load_trajectory
from creative_nao.errors import SettingsError
from creative_nao.measures import Scores, dtw_similarity, mean_pairwise_distance, score, vendi_score, warping_diversity


@dataclass(frozen=True)
class ScoreSettings:
    """Score movements of any source against the basic actions: each by itself, and several as a set."""

    files: tyro.conf.Positional[tuple[Path, ...]]
    """Recordings in any format that `creative-nao export` writes; CSV: header time_s,RShoulderPitch,... in seconds
    and radians; any rate."""
    demonstrations: Path | None = None
    """Folder of CSV recordings to compare with; default: the six shipped boxing actions."""
    json: bool = False
    """Print the scores as JSON: `files`, a row each, and `set`, null for fewer than two appropriate movements."""


def run(settings: ScoreSettings) -> int:
    """Print outcome, distance and nearest basic action of each file, and the measures of the whole set."""
    if not settings.files:
        raise SettingsError("score: name at least one file")
    basic = load_demonstrations(settings.demonstrations)
    trajectories = [_read(path, basic) for path in settings.files]
    scores = score(trajectories, basic)
    rows = [
        {"file": str(path), "outcome": str(outcome), "distance": float(distance), "nearest": basic.names[int(nearest)]}
        for path, outcome, distance, nearest in zip(
            settings.files, scores.outcome, scores.novelty, scores.nearest, strict=True
        )
    ]
    found = _set(trajectories, scores)
    lines = [
        f"{row['file']}: {row['outcome'].replace('_', '-')}, DTW {row['distance']:.2f} from {row['nearest']}"
        for row in rows
    ]
    if found is not None:
        lines.append(
            f"{found['n_appropriate']} of {len(rows)} appropriate: novelty {found['novelty']:.2f}, "
            f"diversity {found['diversity']:.2f}, Vendi score {found['vendi_score']:.2f}, "
            f"diversity in timing {found['warping_diversity']:.3f}"
        )
    print_result({"files": rows, "set": found}, lines, as_json=settings.json)
    return 0


def _read(path: Path, basic: Demonstrations) -> np.ndarray:
    """Return a recording at the tick of the basic actions; a CSV file has to be in radians, as everywhere."""
    if path.suffix.lower() == ".csv":
        return load_trajectory(path, dt_s=basic.dt_s, joints=basic.joints)
    return exchange.read(path, basic.dt_s, basic.joints).motion.angles


def _set(trajectories: list[np.ndarray], scores: Scores) -> dict[str, Any] | None:
    """Return the measures of the appropriate movements together; None for fewer than two."""
    usable = [trajectories[place] for place in np.flatnonzero(scores.appropriate)]
    if len(usable) < 2:
        return None
    return {
        "n_appropriate": len(usable),
        "novelty": float(scores.novelty[scores.appropriate].mean()),
        "diversity": mean_pairwise_distance(usable),
        "vendi_score": vendi_score(dtw_similarity(usable)),
        "warping_diversity": warping_diversity(usable),
    }
