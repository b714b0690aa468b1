"""`creative-nao memories`: what ships with the package."""

from __future__ import annotations

import json
from dataclasses import dataclass

from creative_nao.measures import Criteria, dtw
from creative_nao.model import load_memory, shipped_memories


@dataclass(frozen=True)
class MemoriesSettings:
    """List the shipped memories: how they were trained and how well each gives its basic actions back."""

    json: bool = False
    """Print the list as JSON."""


def run(settings: MemoriesSettings) -> int:
    """Print one line a memory."""
    rows = []
    for name in shipped_memories():
        memory = load_memory(name)
        pairs = zip(memory.generate(memory.pb), memory.demonstrations.trajectories, strict=True)
        worst = max(dtw(mine, taught) for mine, taught in pairs)
        rows.append(
            {
                "name": name,
                "closed_loop_ratio": memory.closed_loop_ratio,
                "n_epochs": memory.training.n_epochs,
                "best_loss": memory.best_loss,
                "worst_reproduction_dtw": worst,
                "all_come_back": worst <= Criteria().learned_threshold,
                "command": memory.record["command"],
            }
        )
    if settings.json:
        print(json.dumps(rows))  # noqa: T201 - the command's output
        return 0
    print(f"{'name':<10} {'ratio':>5} {'epochs':>8} {'loss':>8} {'worst DTW':>10}  all six come back")  # noqa: T201
    for row in rows:
        print(  # noqa: T201
            f"{row['name']:<10} {row['closed_loop_ratio']:>5g} {row['n_epochs']:>8} {row['best_loss']:>8.3f} "
            f"{row['worst_reproduction_dtw']:>10.2f}  {'yes' if row['all_come_back'] else 'no'}"
        )
    return 0
