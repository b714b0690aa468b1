"""Publish results: copy result files into the documentation, and write the pages that stand on them alone.

`docs/results.md` (`result_page`) says what was found, `docs/leaderboard.md` (`leaderboard`) lists everyone's figures;
their sentences are in `templates/results.md.jinja` and `templates/leaderboard.md.jinja`.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from creative_nao import storage
from creative_nao.errors import SettingsError
from creative_nao.evaluation.pages import env_label, render
from creative_nao.evaluation.results import MAX_ROWS, Entry, Label, MeanInterval, naming, read_results, verdict
from creative_nao.evaluation.run import RunRecord, read_record
from creative_nao.schema import Count, Field, Index, PlainName, Text, parse, record

MENTAL, PHYSICAL = "CreativeNao/BoxingMental-v0", "CreativeNao/Boxing-v0"
MODULATION = "CreativeNao/BoxingModulation-v0"
REFUSALS = ("joint_limit", "torque_saturated", "tracking_error", "self_collision", "fell")
"""Outcomes by which physics refuses an action that was usable as imagined."""
N_SHOWN = 3
"""Agents whose figures are told memory by memory."""
PACKAGES = ("numpy", "torch", "numba", "mujoco")
RESULTS_AT = "results"
"""Where the documentation keeps the result files, seen from its pages."""
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
            groups = [(env_label(env).capitalize(), _entries(results, env, by="reward_iqm")) for env in envs]
            versions = results["record"]["versions"]
            packages = ", ".join(f"{name} {versions[name]}" for name in PACKAGES if name in versions)
            suites.append((path, results, groups, packages))
        return render("leaderboard.md.jinja", suites=suites)


def result_page(published: Mapping[str, Results]) -> str:
    """Return the page of results as Markdown.

    Args:
        published: Content of each result file, by its path as seen from the page. Suites `search`, `physical`,
            `performed`, `modulation` and `transfer` have a section each; others stand on the leaderboard alone.

    Raises:
        FileFormatError: If a part of a file is missing.
    """
    with naming(f"results in {', '.join(published)}"):
        sections = [
            {"suite": suite, "path": path, "command": results["record"]["command"], **figures(results)}
            for suite, figures in SECTIONS.items()
            for path, results in published.items()
            if results["suite"] == suite
        ]
        has_physical = any(section["suite"] == "physical" for section in sections)
        return render("results.md.jinja", sections=sections, has_physical=has_physical)


def _search(results: Results) -> dict[str, Any]:
    entries = _entries(results, MENTAL)
    base = _baseline(results, entries)
    others = [entry for entry in entries if entry["versus"] is not None]
    rows = {(row["memory"], row["agent"]): row for row in results["rows"] if row["env"] == MENTAL}
    best = [entry["agent"] for entry in entries if entry["agent"] not in (base["agent"], "oracle")]
    shown = [base["agent"], *best[:N_SHOWN]]
    searching = [entry for entry in entries if entry["oracle_share"] is not None and entry["agent"] != "oracle"]
    return {
        "n_actions": results["rows"][0]["n_actions"],
        "entries": entries,
        "base": base,
        "n_others": len(others),
        **{word: [entry for entry in others if verdict(entry) == word] for word in ("ahead", "open", "behind")},
        "best_share": searching[0] if searching else None,
        "shown": shown,
        "per_memory": [
            (memory, [rows[memory, name]["reward"] for name in shown], rows[memory, shown[0]]["oracle_reward"])
            for memory in dict.fromkeys(memory for memory, _ in rows)
        ],
    }


def _performed(results: Results) -> dict[str, Any]:
    """Return what physical execution changes, agent by agent, and why actions were refused."""
    imagined, performed = _entries(results, MENTAL), {entry["agent"]: entry for entry in _entries(results, PHYSICAL)}
    outcomes: dict[str, Counter[str]] = {entry["agent"]: Counter() for entry in imagined}
    for row in results["rows"]:
        if row["env"] == PHYSICAL:
            outcomes[row["agent"]].update(row["outcomes"])
    rows = [
        {
            "agent": entry["agent"],
            "imagined": entry,
            "performed": performed[entry["agent"]],
            "change_pct": 100.0 * (performed[entry["agent"]]["reward"]["mean"] / entry["reward"]["mean"] - 1.0),
            "refused_pct": _refused_pct(outcomes[entry["agent"]]),
        }
        for entry in imagined
    ]
    refused = {name: sum(counts[name] for counts in outcomes.values()) for name in REFUSALS}
    reasons = [(name.replace("_", " "), count) for name, count in refused.items() if count]
    changes = [row["change_pct"] for row in rows]
    return {
        "n_actions": results["rows"][0]["n_actions"],
        "base": _baseline(results, imagined),
        "least_change": min(changes),
        "largest_change": max(changes),
        "ahead": [name for name, entry in performed.items() if entry["versus"] and verdict(entry) == "ahead"],
        "rows": rows,
        "reasons": sorted(reasons, key=lambda item: -item[1]),
    }


def _refused_pct(counts: Counter[str]) -> float:
    return 100.0 * sum(counts[name] for name in REFUSALS) / counts.total()


def _modulation(results: Results) -> dict[str, Any]:
    modulated = {entry["agent"]: entry["reward"] for entry in _entries(results, MODULATION)}
    return {
        "rows": [
            {
                "agent": entry["agent"],
                "held": entry["reward"],
                "modulated": modulated[entry["agent"]],
                "usable_held_pct": _usable_pct(results, MENTAL, entry["agent"]),
                "usable_modulated_pct": _usable_pct(results, MODULATION, entry["agent"]),
            }
            for entry in _entries(results, MENTAL)
        ]
    }


def _usable_pct(results: Results, env: str, agent: str) -> float:
    found = [r["appropriateness_pct"]["mean"] for r in results["rows"] if (r["env"], r["agent"]) == (env, agent)]
    return sum(found) / len(found)


def _transfer(results: Results) -> dict[str, Any]:
    return {"taught": results["record"]["settings"]["suite"]["taught"], "entries": _entries(results, MENTAL)}


SECTIONS = {
    "search": _search,
    "physical": _performed,
    "performed": _performed,
    "modulation": _modulation,
    "transfer": _transfer,
}
"""Figures of a suite's section on the page of results, in the order of the page."""


def _entries(results: Results, env: str, by: str = "reward") -> list[Entry]:
    return sorted((e for e in results["summary"] if e["env"] == env), key=lambda entry: -entry[by]["mean"])


def _baseline(results: Results, entries: Sequence[Entry]) -> Entry:
    return next(entry for entry in entries if entry["agent"] == results["baseline"])


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


def publish(folders: Sequence[Path], docs: Path) -> list[Path]:
    """Copy the results of run folders to `docs` and write `leaderboard.md` and `results.md` of all that are there.

    A run replaces the published one of its suite. Returns what was written.

    Raises:
        SettingsError: If `docs` is no folder, or two runs are of one suite.
    """
    if not docs.is_dir():
        raise SettingsError(f"--docs should name the folder of the documentation, but {docs} is none")
    found = [with_record(folder) for folder in folders]
    names = [results["suite"] for results in found]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise SettingsError(f"the runs should be of different suites, but two are of `{twice[0]}`; give one of them")
    written = [
        storage.write_text(docs / RESULTS_AT / f"{results['suite']}.json", json.dumps(results, allow_nan=False) + "\n")
        for results in found
    ]
    published = read_published(docs)
    written.append(storage.write_text(docs / "leaderboard.md", leaderboard(published)))
    if "search" in {results["suite"] for results in published.values()}:
        written.append(storage.write_text(docs / "results.md", result_page(published)))
    return written


def read_published(docs: Path) -> dict[str, dict[str, Any]]:
    """Return every published result file by its path as seen from the pages, in the order in which they are told."""
    found = {path: read_results(path) for path in sorted((docs / RESULTS_AT).glob("*.json"))}
    for path, results in found.items():
        check_published(results, path)
    order = list(SECTIONS)
    ranked = sorted(found, key=lambda path: (order.index(path.stem) if path.stem in order else len(order), path.stem))
    return {f"{RESULTS_AT}/{path.name}": found[path] for path in ranked}
