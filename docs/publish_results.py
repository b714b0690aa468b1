"""Bring finished runs into the documentation: `python docs/publish_results.py RUN_FOLDER ...`.

The result files of suites go to `docs/results`; `results.md` (templates/results.md.jinja) and `leaderboard.md` are
written from all that are there. A run of `creative-nao evaluate paper` goes to `docs/results/paper`, its pictures to
`docs/images`, its page is `reproduction.md`.
"""

import argparse
import math
import shutil
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao import storage
from creative_nao.agents.registry import split_name
from creative_nao.envs import Track
from creative_nao.errors import SettingsError
from creative_nao.evaluation import plots
from creative_nao.evaluation.leaderboard import Results, check_published, leaderboard, with_record
from creative_nao.evaluation.pages import FIGURE_TITLES, render
from creative_nao.evaluation.paper.page import PAGE, RESULT_FILES, make_page, read_content
from creative_nao.evaluation.results import (
    CURVE,
    Entry,
    compare_conditions,
    entries_of,
    naming,
    read_results,
    summarise,
    verdict,
)
from creative_nao.evaluation.run import read_record
from creative_nao.evaluation.statistics import estimate, estimate_over_tasks, seed_sequence
from creative_nao.maps.figure_style import save, styled
from creative_nao.model.controls import CONTROLS

DOCS = Path(__file__).parent
PAPER_AT = "results/paper"
MENTAL, PHYSICAL = "CreativeNao/BoxingMental-v0", "CreativeNao/Boxing-v0"
MODULATION = "CreativeNao/BoxingModulation-v0"
REFUSALS = ("joint_limit", "torque_saturated", "tracking_error", "self_collision", "fell")
"""Outcomes by which physics refuses an action that was usable as imagined."""
LEARNED = "learned_map/BoxingMental-v1"
FRONTIER_PICTURE = "images/frontier.png"
N_SHOWN = 3
"""Agents whose figures are told memory by memory."""
RESULTS_AT = "results"
"""Where the documentation keeps the result files, seen from its pages."""


def result_page(published: Mapping[str, Results]) -> str:
    """Return the page of results as Markdown.

    Args:
        published: Content of each result file, by its path as seen from the page. Suites `search`, `physical`,
            `performed`, `modulation`, `transfer` and `gestures` have a section each; others stand on the leaderboard
            alone.

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
        return render("results.md.jinja", DOCS / "templates", sections=sections, has_physical=has_physical)


def _search(results: Results) -> dict[str, Any]:
    entries = entries_of(results, MENTAL)
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
    imagined = entries_of(results, MENTAL)
    oracle = [row["oracle_reward"] for row in results["rows"] if row["oracle_reward"] is not None]
    best = float(np.mean(oracle)) if oracle else math.nan
    performed = {entry["agent"]: entry for entry in entries_of(results, PHYSICAL)}
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
            "share_pct": 100.0 * performed[entry["agent"]]["reward"]["mean"] / best,
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
        "of": {row["agent"]: row for row in rows},
        "reasons": sorted(reasons, key=lambda item: -item[1]),
    }


def _refused_pct(counts: Counter[str]) -> float:
    return 100.0 * sum(counts[name] for name in REFUSALS) / counts.total()


def _modulation(results: Results) -> dict[str, Any]:
    modulated = {entry["agent"]: entry["reward"] for entry in entries_of(results, MODULATION)}
    return {
        "rows": [
            {
                "agent": entry["agent"],
                "held": entry["reward"],
                "modulated": modulated[entry["agent"]],
                "usable_held_pct": _usable_pct(results, MENTAL, entry["agent"]),
                "usable_modulated_pct": _usable_pct(results, MODULATION, entry["agent"]),
            }
            for entry in entries_of(results, MENTAL)
        ]
    }


def _usable_pct(results: Results, env: str, agent: str) -> float:
    found = [r["appropriateness_pct"]["mean"] for r in results["rows"] if (r["env"], r["agent"]) == (env, agent)]
    return sum(found) / len(found)


def _transfer(results: Results) -> dict[str, Any]:
    return {"taught": results["record"]["settings"]["suite"]["taught"], "entries": entries_of(results, MENTAL)}


def _gestures(results: Results) -> dict[str, Any]:
    """Return figures and agents on recordings beside boxing, and what networks add to controls."""
    seed, baseline = results["record"]["settings"]["seed"], results["baseline"]
    memories = results["memories"]
    sets = list(dict.fromkeys(one["set"] for one in memories))
    groups = {"recordings": [name for name in sets if name != "boxing"], "boxing": ["boxing"]}
    compared = {
        group: {
            entry["condition"]: entry
            for entry in compare_conditions([one for one in memories if one["set"] in names], base_seed=seed)
        }
        for group, names in groups.items()
    }
    conditions = list(compared["boxing"])
    of = {one["memory"]: one for one in memories}
    standing = {}
    for group, names in groups.items():
        for kind, chosen in _kinds(conditions).items():
            rows = [
                row
                for row in results["rows"]
                if of[row["memory"]]["set"] in names and of[row["memory"]]["condition"] in chosen
            ]
            standing[group, kind] = {
                entry["agent"]: entry for entry in summarise(rows, baseline=baseline, base_seed=seed)
            }
    ranked = sorted(standing["recordings", "networks"].values(), key=lambda entry: -entry["reward"]["mean"])
    return {
        "n_epochs": results["record"]["settings"]["suite"]["taught"]["n_epochs"],
        "resolution": results["record"]["settings"]["suite"]["resolution"],
        "n_actions": results["rows"][0]["n_actions"],
        "n_seeds": len({one["seed"] for one in memories}),
        "sets": sets,
        "compared": compared,
        "kinds": _kinds(conditions),
        "worst": {
            (name, condition): [
                max(one["reproduction_dtw"].values())
                for one in memories
                if (one["set"], one["condition"]) == (name, condition)
            ]
            for name in sets
            for condition in conditions
        },
        "titles": FIGURE_TITLES,
        "groups": groups,
        "standing": standing,
        "rewards": {
            (group, agent, condition): _reward(results, of, names, agent, condition)
            for group, names in groups.items()
            for agent in (baseline, ranked[0]["agent"])
            for condition in ("auto", *_kinds(conditions)["controls"])
        },
        "ranked": ranked,
        "base": baseline,
        "claims": _claims(compared),
        "added": {
            name: {key: negative(entry["versus"][key]) for key in FIGURE_TITLES}
            for name, entry in compared["recordings"].items()
        },
    }


def _reward(
    results: Results, of: Mapping[str, Mapping[str, Any]], sets: Sequence[str], agent: str, condition: str
) -> dict[str, Any]:
    """Return an agent's reward on the memories of a condition, and its difference from that on those of `auto`."""

    def rewards(kind: str) -> np.ndarray:
        rows = [row for row in results["rows"] if row["agent"] == agent and of[row["memory"]]["set"] in sets]
        return np.array(
            [[*row["reward_per_seed"].values()] for row in rows if of[row["memory"]]["condition"] == kind]
        ).T

    rng = np.random.default_rng(seed_sequence(0, agent, condition))
    gap = rewards(condition) - rewards("auto")
    found = {"mean": estimate(rewards(condition), rng=rng), "gap": estimate(gap, rng=rng)}
    anew = estimate_over_tasks(gap, rng=rng)
    return {**found, "word": "less" if anew["high"] < 0.0 else "more" if anew["low"] > 0.0 else "undecided"}


def negative(found: Mapping[str, float]) -> dict[str, float]:
    """Return the difference the other way round."""
    return {"mean": -found["mean"], "low": -found["high"], "high": -found["low"]}


def _kinds(conditions: Sequence[str]) -> dict[str, list[str]]:
    return {
        "networks": [name for name in conditions if name not in CONTROLS],
        "controls": [name for name in conditions if name in CONTROLS],
    }


def _claims(compared: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, dict[str, tuple[Any, Any, str]]]]:
    """Return what boxing and recordings say of closed minus half: interval, interval with other sets, verdict."""
    found = []
    for text, figure, sign in CLAIMS:
        told = {}
        for group, entries in compared.items():
            kept, anew = entries["closed"]["versus"][figure], entries["closed"]["versus_other_sets"][figure]
            decides = kept if group == "boxing" else anew
            if decides["low"] <= 0.0 <= decides["high"]:
                verdict_of = "undecided"
            else:
                verdict_of = "holds" if decides["low"] * sign > 0.0 else "does not hold"
            told[group] = kept, anew, verdict_of
        found.append((text, told))
    return found


CLAIMS = (
    ("Closed-loop training makes less novel actions than half closed.", "novelty", -1),
    ("Closed-loop training makes less diverse actions than half closed.", "diversity", -1),
    ("Closed-loop training makes actions more like the taught ones.", "learned_pct", 1),
    ("Closed-loop training makes more appropriate actions than half closed.", "appropriate_pct", 1),
)
"""What the paper says of closed and half closed training, the figure that decides it, and its sign."""


STEPS = (
    ("lattice", "spread"), ("spread", "spread_points"), ("spread_points", "surrogate"), ("surrogate", LEARNED),
    ("random", "plan"), ("plan", LEARNED), ("random", LEARNED),
)  # fmt: skip
"""Pairs of agents of which the second is expected to earn more, with each number of movements looked at."""
TOLD_APART = 3.0
"""Standard errors of a difference from which on two agents are called told apart."""


def _frontier(results: Results) -> dict[str, Any]:
    """Return the rewards by agent and movements looked at, and the steps between the simple agents."""
    entries = {entry["agent"]: entry for entry in entries_of(results, MENTAL)}
    names = {name: split_name(name) for name in entries}
    numbers = sorted({entry["n_candidates"] for entry in entries.values()})
    bases = list(dict.fromkeys(base for base, _ in names.values()))
    by_base = {base: {e["n_candidates"]: e for name, e in entries.items() if names[name][0] == base} for base in bases}
    lines = [
        {"agent": base, "track": next(iter(found.values()))["track"], "found": [found.get(k) for k in numbers]}
        for base, found in by_base.items()
        if base != CURVE
    ]
    tracks = [str(track) for track in Track]
    lines.sort(key=lambda line: (tracks.index(line["track"]), -max(e["reward"]["mean"] for e in line["found"] if e)))
    curve = by_base[CURVE]
    return {
        "n_actions": results["rows"][0]["n_actions"],
        "n_memories": curve[1]["n_memories"],
        "n_seeds": curve[1]["n_seeds"],
        "numbers": numbers,
        "curve": curve,
        "lines": lines,
        "oracle": curve[1]["regret"] + curve[1]["reward"]["mean"],
        "steps": _steps(results, numbers),
        "best": {k: max((e for line in lines for e in line["found"] if e and e["n_candidates"] == k),
                        key=lambda entry: entry["reward"]["mean"], default=None) for k in numbers},
    }  # fmt: skip


def _steps(results: Results, numbers: Sequence[int]) -> list[dict[str, Any]]:
    """Return the differences in mean reward between the pairs of `STEPS` at each number, in standard errors too."""
    rewards: dict[str, list[list[float]]] = {}
    for row in results["rows"]:
        rewards.setdefault(row["agent"], []).append([*row["reward_per_seed"].values()])
    steps = []
    for before, after in STEPS:
        found = [_difference(rewards.get(f"{before}@{k}"), rewards.get(f"{after}@{k}")) for k in numbers]
        if any(found):
            names = before.partition("/")[0], after.partition("/")[0]
            close = [k for k, one in zip(numbers, found, strict=True) if one and one["n_errors"] < TOLD_APART]
            steps.append({"before": names[0], "after": names[1], "found": found, "close": close})
    return steps


def _difference(before: Any, after: Any) -> dict[str, float] | None:
    """Return by how much the second agent earns more, and how many standard errors that is; None where one is missing.

    The rewards have shape (memories, seeds). Of a difference without any error, the number of errors is infinite.
    """
    if before is None or after is None:
        return None
    (low, error), (high, other) = (_mean_and_error(np.array(values)) for values in (before, after))
    both = math.hypot(error, other)
    return {"gap": high - low, "n_errors": (high - low) / both if both else math.copysign(math.inf, high - low)}


def _mean_and_error(values: np.ndarray) -> tuple[float, float]:
    """Return the mean of rewards (memories, seeds) and its standard error over seeds, memory by memory."""
    variances = values.var(axis=1, ddof=1) / values.shape[1]
    return float(values.mean()), float(np.sqrt(variances.sum()) / len(values))


def _harder(results: Results) -> dict[str, Any]:
    entries = entries_of(results, results["rows"][0]["env"])
    return {
        "n_actions": results["rows"][0]["n_actions"],
        "entries": entries,
        "about": results["record"]["settings"]["suite"]["about"],
    }


SECTIONS = {
    "frontier": _frontier,
    "performed": _performed,
    "search": _search,
    "physical": _performed,
    "long": _harder,
    "units4": _harder,
    "units8": _harder,
    "modulation": _modulation,
    "modulated": _harder,
    "transfer": _transfer,
    "gestures": _gestures,
}
"""Figures of a suite's section on the page of results, in the order of the page."""


def _baseline(results: Results, entries: Sequence[Entry]) -> Entry:
    return next(entry for entry in entries if entry["agent"] == results["baseline"])


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
    written = [storage.write_json(docs / RESULTS_AT / f"{results['suite']}.json", results, None) for results in found]
    published = read_published(docs)
    if (frontier := published.get(f"{RESULTS_AT}/frontier.json")) is not None:
        (docs / "images").mkdir(exist_ok=True)
        with styled():
            written.append(save(plots.frontier(frontier), docs / FRONTIER_PICTURE))
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


def publish_paper(folder: Path, docs: Path) -> list[Path]:
    """Copy the page of a run folder, its pictures and its result files into a documentation folder.

    Args:
        folder: Finished run folder.
        docs: Folder of the documentation; `reproduction.md`, `images/paper_*.png` and `results/paper/` are replaced.

    Returns:
        What was written.

    Raises:
        SettingsError: If `docs` is no folder.
    """
    if not docs.is_dir():
        raise SettingsError(f"--docs should name the folder of the documentation, but {docs} is none")
    results = docs / PAPER_AT
    results.mkdir(parents=True, exist_ok=True)
    written = []
    for name in (*RESULT_FILES, "networks.csv"):
        source, target = folder / name, results / name
        if name == "run.json":
            kept = {key: value for key, value in read_record(folder).items() if key != "hashes"}
            written.append(storage.write_json(target, kept))
        elif source.is_file():
            written.append(storage.write_bytes(target, source.read_bytes()))
        else:
            target.unlink(missing_ok=True)
    (docs / "images").mkdir(exist_ok=True)
    for picture in sorted((folder / "images").glob("paper_*.png")):
        written.append(Path(shutil.copyfile(picture, docs / "images" / picture.name)))
    page = make_page(read_content(results), results_at=PAPER_AT)
    return [*written, storage.write_text(docs / PAGE, page)]


def main() -> None:
    """Publish the run folders named on the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="*", type=Path, metavar="RUN_FOLDER", help="finished runs; none: only the pages")
    runs = parser.parse_args().runs
    papers = [run for run in runs if read_record(run).get("suite") == "paper"]
    suites = [run for run in runs if run not in papers]
    written = [*publish(suites, DOCS), *(path for run in papers for path in publish_paper(run, DOCS))]
    print("\n".join(f"written: {path}" for path in written))


if __name__ == "__main__":
    main()
