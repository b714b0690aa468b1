"""`creative-nao memories`: the bank that ships with the package."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from creative_nao import storage
from creative_nao.cli.terminal import Display, print_result
from creative_nao.errors import SettingsError
from creative_nao.maps import PAPER_RESOLUTION, pb_map
from creative_nao.measures import Criteria, table
from creative_nao.model import load_memory, reproduction, shipped_memories, shipped_scores, split_of
from creative_nao.runtime import record

COLUMNS = ("appropriate_pct", "learned_pct", "unlearned_pct", "fluctuating_pct", "non_moving_pct")


@dataclass(frozen=True)
class MemoriesSettings:
    """List the shipped memories: how each was trained, how well it gives its basic actions back, what its map holds."""

    rescore: bool = False
    """Work the figures out again instead of reading them from the package; about two seconds a memory."""
    out: Path | None = None
    """With --rescore: JSON file to write the figures to."""
    json: bool = False
    """Print the list as JSON."""


def run(settings: MemoriesSettings) -> int:
    """Print one line a memory and the success rate of each condition."""
    if settings.out is not None and not settings.rescore:
        raise SettingsError("--out goes with --rescore")
    scores = _rescored(settings) if settings.rescore else shipped_scores()
    rows = [{"name": name, "split": split_of(name), **scores.get(name, {})} for name in shipped_memories()]
    print_result(rows, _lines(rows), as_json=settings.json)
    return 0


def _lines(rows: list[dict[str, Any]]) -> Iterator[str]:
    heads = ("name", "split", "loss", "worst DTW", "appropriate", "learned", "novelty", "diversity")
    yield "{:<10} {:<10} {:>8} {:>10} {:>12} {:>9} {:>8} {:>9}".format(*heads)
    yield from map(_line, rows)
    for condition, counts in _success(rows).items():
        yield f"{condition}: {counts[True]} of {counts.total()} networks give every basic action back"
    for n_pb in (4, 8):
        names = shipped_memories(n_pb)
        yield f"with {n_pb} PB units, which have no map to score, {len(names)} more: {names[0]} to {names[-1]}"


def score_memory(name: str) -> dict[str, Any]:
    """Return the figures of one shipped memory over its 200 x 200 map; the draws of the measures have seed 0."""
    memory = load_memory(name)
    chart = pb_map(memory, PAPER_RESOLUTION)
    assert chart.trajectories is not None
    found = table(chart.trajectories, memory.demonstrations, rng=0)
    return {
        "closed_loop_ratio": memory.closed_loop_ratio,
        "n_epochs": memory.training.n_epochs,
        "best_loss": memory.best_loss,
        "worst_reproduction_dtw": max(reproduction(memory)),
        **{column: getattr(found, column) for column in COLUMNS},
        "novelty": None if found.novelty is None else found.novelty.mean,
        "diversity": None if found.diversity is None else found.diversity.mean,
    }


def _rescored(settings: MemoriesSettings) -> dict[str, dict[str, Any]]:
    names = shipped_memories()
    scores = {}
    with Display({"scoring memories": len(names)}) as display:
        for done, name in enumerate(names, start=1):
            scores[name] = score_memory(name)
            display.show("scoring memories", done, name)
    if settings.out is not None:
        made = record(settings={"resolution": PAPER_RESOLUTION}, command="creative-nao memories --rescore")
        storage.write_json(settings.out, {**made, "memories": scores}, 1)
    return scores


def _line(row: dict[str, Any]) -> str:
    if "best_loss" not in row:
        return f"{row['name']:<10} {row['split']:<10} not scored yet; creative-nao memories --rescore"
    drawn = [f"{row[name]:.2f}" if row[name] is not None else "-" for name in ("novelty", "diversity")]
    return (
        f"{row['name']:<10} {row['split']:<10} {row['best_loss']:>8.3f} {row['worst_reproduction_dtw']:>10.2f} "
        f"{row['appropriate_pct']:>10.2f} % {row['learned_pct']:>7.2f} % {drawn[0]:>8} {drawn[1]:>9}"
    )


def _success(rows: list[dict[str, Any]]) -> dict[str, Counter[bool]]:
    """Count, for each condition, the networks that give every basic action back and those that do not."""
    counts: dict[str, Counter[bool]] = defaultdict(Counter)
    for row in rows:
        if (worst := row.get("worst_reproduction_dtw")) is not None:
            counts[row["name"].split("/")[0]][worst <= Criteria().learned_threshold] += 1
    return counts
