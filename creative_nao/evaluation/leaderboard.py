"""The leaderboard: everyone's figures side by side, written from result files alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from creative_nao.envs import Track
from creative_nao.evaluation.pages import env_label, render
from creative_nao.evaluation.results import MAX_ROWS, Label, MeanInterval, entries_of, naming, read_results
from creative_nao.evaluation.run import RunRecord, read_record
from creative_nao.schema import Count, Field, Index, PlainName, Text, parse, record

PACKAGES = ("numpy", "torch", "numba", "mujoco")
KEPT = ("command", "settings", "versions", "platform", "created", "memories", "seeds", "seconds")

Results = Mapping[str, Any]


@record(closed=False)
class Versus:
    """How an agent compares with the baseline."""

    probability_of_improvement: MeanInterval | None
    n_memories_ahead: Index


@record(closed=False)
class SummaryEntry:
    """One agent in one environment over all memories."""

    agent: Label
    env: Label
    n_memories: Count
    n_seeds: Count
    n_actions_training: Index
    reward_iqm: MeanInterval
    reward: MeanInterval | None
    oracle_share: MeanInterval | None
    versus: Versus | None
    track: Text | None = None
    n_candidates: Count | None = None
    worth: MeanInterval | None = None
    worth_most: Count | None = None


@record(closed=False)
class PublishedFile:
    """What a published result file has beside its rows."""

    suite: PlainName
    summary: Annotated[tuple[SummaryEntry, ...], Field(max_length=MAX_ROWS)]
    baseline: Text | None
    record: RunRecord


def leaderboard(published: Mapping[str, Results]) -> str:
    """Return the leaderboard as Markdown.

    Args:
        published: Content of each result file, by its path as seen from the page.

    Raises:
        FileFormatError: If a part of a file is missing.
    """
    suites = []
    with naming(f"results in {', '.join(published)}"):
        for path, results in published.items():
            envs = dict.fromkeys(entry["env"] for entry in results["summary"])
            groups = [(env_label(env).capitalize(), entries_of(results, env, by="reward_iqm")) for env in envs]
            versions = results["record"]["versions"]
            packages = ", ".join(f"{name} {versions[name]}" for name in PACKAGES if name in versions)
            suites.append((path, results, groups, packages))
        return render("leaderboard.md.jinja", suites=suites, by_budget=by_budget)


def by_budget(entries: Sequence[Mapping[str, Any]]) -> list[tuple[int | None, str | None, list[Mapping[str, Any]]]]:
    """Return entries by movements looked at for each performed, and by track; together where a file tells neither."""
    if any(entry.get("track") is None for entry in entries):
        return [(None, None, [*entries])]
    tracks = list(Track)
    keys = sorted({(entry["n_candidates"], tracks.index(Track(entry["track"]))) for entry in entries})
    return [
        (number, str(tracks[place]), [e for e in entries if (e["n_candidates"], e["track"]) == (number, tracks[place])])
        for number, place in keys
    ]


def check_published(results: dict[str, Any], path: Path) -> None:
    """Check summary, record and baseline of a result file that is published.

    Raises:
        FileFormatError: Naming the entry and the field.
    """
    parse(PublishedFile, results, f"results {path}")


def with_record(folder: Path) -> dict[str, Any]:
    """Return the results of a finished run folder together with what made them.

    Raises:
        NotFoundError: If the folder holds no results.
        FileFormatError: If results or record are damaged, or were made by an old version.
    """
    results = read_results(folder / "results.json")
    made = read_record(folder)
    found = {**results, "record": {key: made[key] for key in KEPT if key in made}}
    check_published(found, folder / "results.json")
    return found
