"""`creative-nao map --physical`: what the robot's body makes of a memory's PB space."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from creative_nao.cli.progress import Display
from creative_nao.envs.observation import OUTCOMES
from creative_nao.envs.physical_map import physical_map
from creative_nao.errors import SettingsError
from creative_nao.model import load_memory


def run_physical(
    name: str, out: Path, resolution: int, *, n_threads: int | None, resume: bool, as_json: bool, colour: str
) -> int:
    """Perform the whole grid, write the map and its picture, print its figures; a killed run goes on with `resume`."""
    memory = load_memory(name)
    checkpoint = out.with_suffix(".part.npz")
    if checkpoint.exists() and not resume:
        raise SettingsError(f"{checkpoint} holds an unfinished map; go on with --resume, or delete it to begin again")
    if resume and not checkpoint.exists():
        raise SettingsError(f"--resume: there is no {checkpoint} to go on with")
    with Display({f"performing {name}": resolution**2}) as display:
        chart = physical_map(
            memory,
            resolution,
            n_threads=n_threads,
            progress=lambda done, _: display.show(f"performing {name}", done),
            checkpoint=checkpoint,
        )
    chart.save(out)
    picture = out.with_suffix(".png")
    chart.plot(picture, colour=colour)
    checkpoint.unlink(missing_ok=True)  # last: a run killed before goes on from it and only writes again
    found = {**chart.summary(), "out": [str(out), str(picture)]}
    if as_json:
        print(json.dumps(found))  # noqa: T201 - the command's output
    else:
        _print(found)
    return 0


def _print(found: dict[str, Any]) -> None:
    n = found["resolution"]
    lines = [f"memory {found['memory']}, {n} x {n} movements performed in {found['wall_s']:.0f} s"]
    lines.append(f"  appropriate in the mind    {found['mentally_appropriate_pct']:6.2f} %")
    lines.append(f"  appropriate on the robot   {found['physically_appropriate_pct']:6.2f} %")
    share = found["physical_of_mental_pct"]
    lines.append(f"  of the first, the second   {'-' if share is None else f'{share:6.2f} %'}")
    lines += [f"  {outcome.replace('_', '-'):<26} {found[f'{outcome}_pct']:6.2f} %" for outcome in OUTCOMES]
    lines.append(f"written: {', '.join(found['out'])}")
    print("\n".join(lines))  # noqa: T201 - the command's output
