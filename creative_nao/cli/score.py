"""`creative-nao score`: how new are recorded movements, and how different from each other?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from creative_nao import exchange
from creative_nao.cli.terminal import print_result
from creative_nao.demonstrations import load_demonstrations
from creative_nao.errors import SettingsError
from creative_nao.exchange import NOTHING_SAID, Reading
from creative_nao.measures import Scores, dtw_similarity, mean_pairwise_distance, score, vendi_score, warping_diversity


@dataclass(frozen=True)
class ScoreSettings:
    """Score movements of any source against the basic actions: each by itself, and several as a set."""

    files: tyro.conf.Positional[tuple[Path, ...]]
    """Recordings in any known format, of any rate: CSV, robot programs, Choregraphe, ROS, Webots, JSON, NPZ."""
    demonstrations: Path | None = None
    """Folder of recordings to compare with; default: the six shipped boxing actions."""
    json: bool = False
    """Print the scores as JSON: `files`, a row each, and `set`, null for fewer than two appropriate movements."""
    reading: Annotated[Reading, tyro.conf.OmitArgPrefixes] = NOTHING_SAID
    """What the recordings do not say about themselves."""


def run(settings: ScoreSettings) -> int:
    """Print outcome, distance and nearest basic action of each file, and the measures of the whole set."""
    if not settings.files:
        raise SettingsError("score: name at least one file")
    basic = load_demonstrations(settings.demonstrations)
    read = [
        (f"{path}, {one.place}" if len(found) > 1 else str(path), one)
        for path in settings.files
        for found in [exchange.read_all(path, basic.dt_s, basic.joints, reading=settings.reading, beyond="refuse")]
        for one in found
    ]
    trajectories = [one.motion.angles for _, one in read]
    scores = score(trajectories, basic)
    rows = [
        {
            "file": name,
            "outcome": str(outcome),
            "distance": float(distance),
            "nearest": basic.names[int(nearest)],
            "notes": list(one.notes),
        }
        for (name, one), outcome, distance, nearest in zip(
            read, scores.outcome, scores.novelty, scores.nearest, strict=True
        )
    ]
    found = _set(trajectories, scores)
    lines = []
    for row in rows:
        told = f"{row['outcome'].replace('_', '-')}, DTW {row['distance']:.2f} from {row['nearest']}"
        lines += [f"{row['file']}: {told}", *(f"  {'; '.join(row['notes'])}" for _ in row["notes"][:1])]
    if found is not None:
        lines.append(
            f"{found['n_appropriate']} of {len(rows)} appropriate: novelty {found['novelty']:.2f}, "
            f"diversity {found['diversity']:.2f}, Vendi score {found['vendi_score']:.2f}, "
            f"diversity in timing {found['warping_diversity']:.3f}"
        )
    print_result({"files": rows, "set": found}, lines, as_json=settings.json)
    return 0


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
