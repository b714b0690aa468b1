"""`creative-nao doctor`: what this machine has."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import dataclass

from creative_nao.provenance import versions


@dataclass(frozen=True)
class DoctorSettings:
    """Say which versions are installed, how many cores there are and whether frames can be rendered."""

    json: bool = False
    """Print it as JSON."""


def run(settings: DoctorSettings) -> int:
    """Print the findings; exit code 0 even without rendering, which nothing but pictures needs."""
    from creative_nao.robot.headless import working_backend

    n_cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    found = {"versions": versions(), "cores": n_cores, "platform": sys.platform, "rendering": working_backend()}
    if settings.json:
        print(json.dumps(found))  # noqa: T201 - the command's output
        return 0
    for name, version in found["versions"].items():
        print(f"{name:<20} {version}")  # noqa: T201
    print(f"{'cores':<20} {n_cores}")  # noqa: T201
    print(f"{'rendering':<20} {found['rendering']}")  # noqa: T201
    return 0
