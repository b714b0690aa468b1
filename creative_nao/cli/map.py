"""`creative-nao map`: generate, or perform in physics, and score a grid over the PB space of a memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from creative_nao.cli.terminal import Display, print_result
from creative_nao.envs.physical_map import PhysicalMap, physical_map
from creative_nao.errors import SettingsError
from creative_nao.maps import COLOURINGS, PAPER_RESOLUTION, PBMap, check_colour, pb_map
from creative_nao.measures import OUTCOMES, score, table
from creative_nao.measures.outcome import ALL_OUTCOMES
from creative_nao.model import Memory, load_memory

ENDINGS = (".npz", ".safetensors")


@dataclass(frozen=True)
class MapSettings:
    """Generate and score a whole grid of PB points; write the map and its picture, print its figures."""

    memory: tyro.conf.Positional[str] = "half/0"
    """Shipped name, such as half/0, or a memory file."""
    out: Path = Path("map.npz")
    """File to write, ending in .npz or, without --physical, .safetensors; the picture beside it ends in .png."""
    resolution: int = PAPER_RESOLUTION
    """Points along each axis of the PB space."""
    colour: str = "nearest"
    """What the picture's colours tell: nearest (basic action), novelty, unexpectedness, speed, excursion or ruggedness;
    with --physical one of the first three."""
    physical: bool = False
    """Let the simulated robot perform every movement and score what its encoders measure; 200 x 200 take about 25
    minutes of one core."""
    resume: bool = False
    """With --physical: go on where a killed run ended."""
    n_threads: int | None = None
    """With --physical: movements performed at the same time; default: one a core."""
    seed: int = 0
    """Seed of the draws of novelty and diversity."""
    json: bool = False
    """Print the figures as JSON."""


def run(settings: MapSettings) -> int:
    """Make the map, write both files, print its figures; a killed physical map goes on with --resume."""
    endings = ENDINGS[:1] if settings.physical else ENDINGS
    if settings.out.suffix not in endings:
        raise SettingsError(f"--out should end in {' or '.join(endings)}, but is {settings.out}")
    if not settings.physical and (settings.resume or settings.n_threads is not None):
        raise SettingsError("--resume and --n-threads go with --physical")
    colour = check_colour(settings.colour)
    if settings.physical and colour in COLOURINGS and COLOURINGS[colour].needs_trajectories:
        raise SettingsError(f"--colour {colour} needs the movements, which a --physical map does not hold")
    memory = load_memory(settings.memory)
    checkpoint, picture = settings.out.with_suffix(".part.npz"), settings.out.with_suffix(".png")
    pb_space = _performed(memory, settings, checkpoint) if settings.physical else pb_map(memory, settings.resolution)
    pb_space.save(settings.out)
    pb_space.plot(picture, colour=colour)
    checkpoint.unlink(missing_ok=True)  # last: a run killed before goes on from it and only writes again
    out = [str(settings.out), str(picture)]
    if isinstance(pb_space, PhysicalMap):
        figures = {**pb_space.summary(), "out": out}
        print_result(figures, _physical_lines(figures), as_json=settings.json)
    else:
        figures = {**_figures(pb_space, memory, settings), "out": out}
        print_result(figures, _lines(figures), as_json=settings.json)
    return 0


def _performed(memory: Memory, settings: MapSettings, checkpoint: Path) -> PhysicalMap:
    if checkpoint.exists() and not settings.resume:
        raise SettingsError(f"{checkpoint} holds an unfinished map; go on with --resume, or delete it to begin again")
    if settings.resume and not checkpoint.exists():
        raise SettingsError(f"--resume: there is no {checkpoint} to go on with")
    work = f"performing {settings.memory}"
    with Display({work: settings.resolution**2}) as display:
        return physical_map(
            memory, settings.resolution, n_threads=settings.n_threads, checkpoint=checkpoint,
            progress=lambda done, _: display.show(work, done),
        )  # fmt: skip


def _figures(pb_space: PBMap, memory: Memory, settings: MapSettings) -> dict[str, Any]:
    """Return the figures of the paper's Table I and the share of the map that gives each basic action back."""
    assert pb_space.trajectories is not None
    scores = score(pb_space.trajectories, memory.demonstrations)
    figures = table(pb_space.trajectories, memory.demonstrations, rng=settings.seed, scores=scores)
    return {
        "memory": settings.memory,
        "resolution": settings.resolution,
        "appropriate_pct": figures.appropriate_pct,
        **{f"{outcome}_pct": pb_space.share_pct(outcome) for outcome in OUTCOMES},
        "novelty": figures.novelty.mean if figures.novelty else None,
        "diversity": figures.diversity.mean if figures.diversity else None,
        "learned_region_pct": dict(zip(pb_space.names, pb_space.learned_region_pct().round(3).tolist(), strict=True)),
    }


def _lines(figures: dict[str, Any]) -> Iterator[str]:
    yield f"memory {figures['memory']}, {figures['resolution']} x {figures['resolution']} points"
    for name in ("appropriate", *OUTCOMES):
        yield f"  {name.replace('_', '-'):<14} {figures[f'{name}_pct']:6.2f} %"
    for name in ("novelty", "diversity"):
        yield f"  {name:<14} {_number(figures[name])}"
    for name, share in figures["learned_region_pct"].items():
        yield f"  region of {name:<16} {share:6.2f} %"
    yield f"written: {', '.join(figures['out'])}"


def _physical_lines(figures: dict[str, Any]) -> Iterator[str]:
    n = figures["resolution"]
    yield f"memory {figures['memory']}, {n} x {n} movements performed in {figures['wall_s']:.0f} s"
    yield f"  appropriate as generated   {figures['mentally_appropriate_pct']:6.2f} %"
    yield f"  appropriate as performed   {figures['physically_appropriate_pct']:6.2f} %"
    yield f"  of the first, the second   {_number(figures['physical_of_mental_pct'], ' %')}"
    for outcome in ALL_OUTCOMES:
        yield f"  {outcome.replace('_', '-'):<26} {figures[f'{outcome}_pct']:6.2f} %"
    yield f"written: {', '.join(figures['out'])}"


def _number(value: float | None, unit: str = "") -> str:
    return "-" if value is None else f"{value:6.2f}{unit}"
