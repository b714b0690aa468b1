"""`creative-nao map`: what lies where in a memory's PB space.

Also here:
- `creative-nao map --physical`: what the robot's body makes of a memory's PB space.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from creative_nao.cli.terminal import Display, print_result
from creative_nao.envs.physical_map import physical_map
from creative_nao.errors import SettingsError
from creative_nao.maps import COLOURINGS, PAPER_RESOLUTION, check_colour, pb_map
from creative_nao.measures import OUTCOMES, score, table
from creative_nao.measures.outcome import ALL_OUTCOMES
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
    print_result(found, _lines_of_physical(found), as_json=as_json)
    return 0


def _lines_of_physical(found: dict[str, Any]) -> list[str]:
    n = found["resolution"]
    lines = [f"memory {found['memory']}, {n} x {n} movements performed in {found['wall_s']:.0f} s"]
    lines.append(f"  appropriate in the mind    {found['mentally_appropriate_pct']:6.2f} %")
    lines.append(f"  appropriate on the robot   {found['physically_appropriate_pct']:6.2f} %")
    share = found["physical_of_mental_pct"]
    lines.append(f"  of the first, the second   {'-' if share is None else f'{share:6.2f} %'}")
    lines += [f"  {outcome.replace('_', '-'):<26} {found[f'{outcome}_pct']:6.2f} %" for outcome in ALL_OUTCOMES]
    lines.append(f"written: {', '.join(found['out'])}")
    return lines


@dataclass(frozen=True)
class MapSettings:
    """Generate and score a whole grid of PB points; write the map as NPZ and as a picture, print its figures."""

    memory: tyro.conf.Positional[str] = "half/0"
    """Shipped name, such as half/0, or a memory file."""
    out: Path = Path("map.npz")
    """NPZ file to write; the picture stands beside it, ending in .png."""
    resolution: int = PAPER_RESOLUTION
    """Points along each axis of the PB space."""
    colour: str = "nearest"
    """What the picture's colours tell: nearest (basic action), novelty, unexpectedness, speed, excursion or ruggedness;
    with --physical one of the first three."""
    physical: bool = False
    """Let the simulated robot perform every movement and map what its body makes of it; 200 x 200 take about 25 minutes
    of one core."""
    resume: bool = False
    """With --physical: go on where a killed run ended."""
    n_threads: int | None = None
    """With --physical: movements performed at the same time; default: one a core."""
    seed: int = 0
    """Seed of the draws of novelty and diversity."""
    json: bool = False
    """Print the figures as JSON."""


def run(settings: MapSettings) -> int:
    """Make the map, write both files, print the figures of the paper's Table I."""
    if settings.out.suffix != ".npz":
        raise SettingsError(f"--out should end in .npz, but is {settings.out}")
    if not settings.physical and (settings.resume or settings.n_threads is not None):
        raise SettingsError("--resume and --n-threads go with --physical")
    colour = check_colour(settings.colour)
    if settings.physical:
        if colour in COLOURINGS and COLOURINGS[colour].needs_trajectories:
            raise SettingsError(f"--colour {colour} needs the movements, which a --physical map does not hold")
        return run_physical(
            settings.memory, settings.out, settings.resolution,
            n_threads=settings.n_threads, resume=settings.resume, as_json=settings.json, colour=colour,
        )  # fmt: skip
    memory = load_memory(settings.memory)
    chart = pb_map(memory, settings.resolution)
    trajectories = chart.trajectories
    assert trajectories is not None
    figures = table(
        trajectories, memory.demonstrations, rng=settings.seed, scores=score(trajectories, memory.demonstrations)
    )
    picture = settings.out.with_suffix(".png")
    chart.save(settings.out)
    chart.plot(picture, colour=colour)
    regions = dict(zip(chart.names, chart.learned_region_pct().round(3).tolist(), strict=True))
    found = {
        "memory": settings.memory,
        "resolution": settings.resolution,
        "appropriate_pct": figures.appropriate_pct,
        **{f"{outcome}_pct": chart.share_pct(outcome) for outcome in OUTCOMES},
        "novelty": figures.novelty.mean if figures.novelty else None,
        "diversity": figures.diversity.mean if figures.diversity else None,
        "learned_region_pct": regions,
        "out": [str(settings.out), str(picture)],
    }
    print_result(found, _lines(found), as_json=settings.json)
    return 0


def _lines(found: dict[str, Any]) -> Iterator[str]:
    yield f"memory {found['memory']}, {found['resolution']} x {found['resolution']} points"
    for name in ("appropriate_pct", *(f"{outcome}_pct" for outcome in OUTCOMES)):
        yield f"  {name.removesuffix('_pct').replace('_', '-'):<14} {found[name]:6.2f} %"
    for name in ("novelty", "diversity"):
        value = found[name]
        yield f"  {name:<14} {'-' if value is None else f'{value:6.2f}'}"
    for name, share in found["learned_region_pct"].items():
        yield f"  region of {name:<16} {share:6.2f} %"
    yield f"written: {', '.join(found['out'])}"
