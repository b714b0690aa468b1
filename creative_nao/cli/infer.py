"""`creative-nao infer`: what does a memory make of a recorded movement?"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from creative_nao.demonstrations import load_trajectory
from creative_nao.errors import SettingsError
from creative_nao.measures import score
from creative_nao.model import load_memory

PICTURES = (".png", ".svg", ".pdf")


@dataclass(frozen=True)
class InferSettings:
    """Find the PB value from which a memory generates a recorded movement, or the most similar one it has."""

    file: tyro.conf.Positional[Path]
    """CSV file with the header time_s,RShoulderPitch,... in seconds and radians; any rate."""
    memory: str = "half/0"
    """Shipped name, such as half/0, or a memory file."""
    out: Path | None = None
    """Picture to write, PNG, SVG or PDF by its ending: every joint, recorded and regenerated."""
    initial_state: bool = False
    """Start in the recording's own first posture and seek the initial state of the slowest layer too."""
    n_restarts: int = 48
    """Starting points of the search, worked on side by side; the best end is taken."""
    seed: int = 0
    """Seed of the search; one seed, one answer."""
    json: bool = False
    """Print the figures as JSON, the regenerated movement [rad] among them."""


def run(settings: InferSettings) -> int:
    """Print PB value, error and nearest basic action; draw recording and regenerated movement."""
    if settings.out is not None and settings.out.suffix not in PICTURES:
        raise SettingsError(f"--out should end in {', '.join(PICTURES)}, but is {settings.out}")
    memory = load_memory(settings.memory)
    recorded = load_trajectory(settings.file, dt_s=memory.dt_s, joints=memory.joints)
    found = memory.infer_pb(
        recorded, infer_initial_state=settings.initial_state, n_restarts=settings.n_restarts, seed=settings.seed
    )
    scores = score([recorded, found.trajectory], memory.demonstrations)
    names = memory.demonstrations.names
    figures: dict[str, Any] = {
        "file": str(settings.file),
        "memory": settings.memory,
        "pb": found.pb.tolist(),
        "error": found.error,
        "rms_error_rad": found.squared_error**0.5,
        "recorded": _told(scores, 0, names),
        "regenerated": _told(scores, 1, names),
        "initial_state": None if found.initial_state is None else found.initial_state.tolist(),
        "dt_s": memory.dt_s,
        "joints": list(memory.joints),
        "trajectory": found.trajectory.tolist(),
        "out": None if settings.out is None else str(settings.out),
    }
    if settings.out is not None:
        from creative_nao.cli.infer_picture import draw_recognition

        draw_recognition(memory, recorded, found, settings.out, title=_title(figures))
    if settings.json:
        print(json.dumps(figures))  # noqa: T201 - the command's output
        return 0
    print(_title(figures))  # noqa: T201
    for what in ("recorded", "regenerated"):
        told = figures[what]
        print(f"  {what:<12} nearest to {told['nearest']}, DTW {told['distance']:.2f}, {told['outcome']}")  # noqa: T201
    if settings.out is not None:
        print(f"written: {settings.out}")  # noqa: T201
    return 0


def _title(figures: dict[str, Any]) -> str:
    pb = ", ".join(f"{value:+.4f}" for value in figures["pb"])
    return (
        f"{Path(figures['file']).name} in memory {figures['memory']}: PB ({pb}), DTW {figures['error']:.2f}, "
        f"{figures['rms_error_rad']:.3f} rad rms"
    )


def _told(scores: Any, row: int, names: tuple[str, ...]) -> dict[str, Any]:
    return {
        "nearest": names[int(scores.nearest[row])],
        "distance": float(scores.novelty[row]),
        "outcome": str(scores.outcome[row]).replace("_", "-"),
    }
