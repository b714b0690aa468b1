"""`docs/results.md`: what was found, in sentences and tables, written from result files alone.

Also here:
- Bring result files into the documentation, and write the pages that stand on them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from creative_nao import storage
from creative_nao.errors import FileFormatError, SettingsError
from creative_nao.evaluation.results import check_summary, naming, read_results
from creative_nao.evaluation.run import read_record
from creative_nao.evaluation.tables import bullet, interval, leaderboard, paragraph, span, table
from creative_nao.fields import Fields, is_plain_name, shown

MENTAL, PHYSICAL = "CreativeNao/BoxingMental-v0", "CreativeNao/Boxing-v0"
MODULATION = "CreativeNao/BoxingModulation-v0"
REFUSALS = ("joint_limit", "torque_saturated", "tracking_error", "self_collision", "fell")
"""Outcomes by which the robot's body refuses an action that was usable in the mind."""

N_SHOWN = 3
"""Agents whose figures are told memory by memory."""

Results = Mapping[str, Any]
Entry = Mapping[str, Any]

PREFACE = (
    "# Results",
    paragraph(
        "Does anything find more new, usable actions in a robot's memory than the paper's way, drawing points",
        "uniformly from the 200 x 200 grid? This page is written by `creative-nao evaluate leaderboard` from the",
        "result files it names: it says what came out, also where that is nothing.",
    ),
)
NOT_PHYSICAL = paragraph(
    "No run of suite `physical` is published yet; `creative-nao evaluate physical --docs docs` plays the same choices",
    "imagined and performed, and writes this section.",
)
LIMITS = (
    "## What this does not show",
    bullet(
        "All memories are networks trained on six boxing actions. Another robot or other actions may order the agents",
        "otherwise.",
    )
    + "\n"
    + bullet(
        "Trained agents generated many actions before; the table of the [leaderboard](leaderboard.md) tells how many.",
        "The others had only their budget.",
    )
    + "\n"
    + bullet(
        "The oracle is greedy and knows the points of a grid: a ceiling for comparison, not the best that is possible."
    )
    + "\n"
    + bullet("New and usable is not good boxing: nobody has judged whether the actions would hit or please."),
)


def result_page(published: Mapping[str, Results]) -> str:
    """Return the page as Markdown.

    Args:
        published: Content of each result file, by its path as seen from the page. Suites `search`, `physical`,
            `performed`, `modulation` and `transfer` have a section each; others stand on the leaderboard alone.
    """
    blocks = [*PREFACE]
    for suite, section in SECTIONS.items():
        for path, results in published.items():
            if results["suite"] == suite:
                blocks += section(results)
                blocks.append(paragraph(f"Figures: [{path}]({path}), made by `{results['record']['command']}`."))
    if "physical" not in {results["suite"] for results in published.values()}:
        blocks += ["## What physical execution changes", NOT_PHYSICAL]
    return "\n\n".join([*blocks, *LIMITS]) + "\n"


def verdict(entry: Entry) -> str:
    """Return `ahead`, `behind` or `open`: whether the difference from the baseline would hold on other memories too.

    The interval that decides is the wider one, for which memories are drawn anew as well as seeds.
    """
    found = entry["versus"]["difference_other_memories"]
    if found["low"] is None or found["low"] <= 0.0 <= found["high"]:
        return "open"
    return "ahead" if found["low"] > 0.0 else "behind"


def _search(results: Results) -> list[str]:
    entries = _entries(results, MENTAL)
    base = _baseline(results, entries)
    others = [entry for entry in entries if entry["versus"] is not None]
    n_actions = results["rows"][0]["n_actions"]
    told = {word: [entry for entry in others if verdict(entry) == word] for word in ("ahead", "open", "behind")}
    reach = f"{n_actions} actions on {base['n_memories']} memories that no training has seen"
    blocks = [f"## Who beats uniform sampling at {n_actions} actions?"]
    if told["ahead"]:
        earn = "earns" if len(told["ahead"]) == 1 else "earn"
        blocks += [
            paragraph(
                f"{len(told['ahead'])} of the {len(others)} other agents {earn} more than uniform sampling of the",
                f"grid, `{base['agent']}`, with {reach}:",
            ),
            "\n".join(_sentence(entry, base) for entry in told["ahead"]),
        ]
    else:
        blocks.append(
            paragraph(
                f"None of the {len(others)} other agents demonstrably earns more than `{base['agent']}` with {reach}."
            )
        )
    if told["open"]:
        names = ", ".join(f"`{entry['agent']}`" for entry in told["open"])
        blocks.append(paragraph(f"Not distinguishable from it: {names}; the interval of the difference holds 0."))
    if told["behind"]:
        blocks += ["Behind it:", "\n".join(_sentence(entry, base) for entry in told["behind"])]
    searching = [entry for entry in entries if entry["oracle_share"] is not None and entry["agent"] != "oracle"]
    if searching:
        blocks.append(
            paragraph(
                f"How much is left: `{searching[0]['agent']}`, the highest, gets",
                f"{interval(searching[0]['oracle_share'], 1, scale=100.0)} % of what the greedy oracle earns that",
                f"knows the whole map; `{base['agent']}` gets {interval(base['oracle_share'], 1, scale=100.0)} %.",
            )
        )
    return [*blocks, *_compared(entries), *_per_memory(results, entries, base)]


def _sentence(entry: Entry, base: Entry) -> str:
    versus, relative = entry["versus"], 100.0 / base["reward"]["mean"]
    trained = f", after {entry['n_actions_training']:,} actions in training" if entry["n_actions_training"] else ""
    return bullet(
        f"`{entry['agent']}`: {interval(versus['difference'], 2, sign='+')} in reward,",
        f"{interval(versus['difference'], 0, scale=relative, sign='+')} %;",
        f"with the memories drawn anew too {span(versus['difference_other_memories'], 2, sign='+')}.",
        f"An episode of it earns more than one of the baseline in "
        f"{interval(versus['probability_of_improvement'], 0, scale=100.0)} of 100 cases{trained}.",
    )


def _compared(entries: Sequence[Entry]) -> list[str]:
    titles = ("agent", "reward", "of oracle [%]", "difference", "on other memories", "ahead on")
    rows = []
    for entry in entries:
        versus = entry["versus"]
        compared = ["baseline", "", ""]
        if versus is not None:
            ahead = f"{versus['n_memories_ahead']} of {entry['n_memories']}"
            other = span(versus["difference_other_memories"], 2, sign="+")
            compared = [interval(versus["difference"], 2, sign="+"), other, ahead]
        shares = interval(entry["oracle_share"], 1, scale=100.0)
        rows.append([entry["agent"], interval(entry["reward"], 2), shares, *compared])
    return [
        table(titles, rows),
        paragraph(
            f"Mean reward of an episode over {entries[0]['n_memories']} memories and {entries[0]['n_seeds']} seeds; in",
            "brackets the 95 % stratified bootstrap interval, which speaks of other seeds on these memories. *On other",
            "memories*: the interval of the difference when the memories are drawn anew too; it decides what is called",
            "ahead. One in twenty such intervals misses the truth by chance.",
        ),
    ]


def _per_memory(results: Results, entries: Sequence[Entry], base: Entry) -> list[str]:
    found = {(row["memory"], row["agent"]): row for row in results["rows"] if row["env"] == MENTAL}
    shown = [entry["agent"] for entry in entries if entry["agent"] not in (base["agent"], "oracle")][:N_SHOWN]
    names = [base["agent"], *shown]
    rows = []
    for memory in dict.fromkeys(memory for memory, _ in found):
        best = found[memory, names[0]]["oracle_reward"]
        rewards = [interval(found[memory, name]["reward"], 2) for name in names]
        rows.append([memory, *rewards, f"{best:.2f}" if best is not None else ""])
    return [
        "### Memory by memory",
        paragraph("The baseline and the agents with the highest means, beside the oracle:"),
        table(["memory", *names, "oracle"], rows),
    ]


def _physical(results: Results) -> list[str]:
    return [
        "## What physical execution changes",
        *_body(
            results,
            "With so few memories, the interval for other memories, which decides this, is wide.",
        ),
    ]


def _performed(results: Results) -> list[str]:
    return ["### What was learned in the mind, performed", *_body(results, "Other memories may order them otherwise.")]


def _body(results: Results, caution: str) -> list[str]:
    """Return what the body changes, with the table; `caution` is said where nobody is ahead."""
    mind, body = _entries(results, MENTAL), {entry["agent"]: entry for entry in _entries(results, PHYSICAL)}
    base = _baseline(results, mind)
    changes = [100.0 * (body[e["agent"]]["reward"]["mean"] / e["reward"]["mean"] - 1.0) for e in mind]
    ahead = [f"`{name}`" for name, entry in body.items() if entry["versus"] is not None and verdict(entry) == "ahead"]
    rows = []
    for entry, change in zip(mind, changes, strict=True):
        found = body[entry["agent"]]
        against, others = "baseline", ""
        if found["versus"]:
            against = interval(found["versus"]["difference"], 2, sign="+")
            others = span(found["versus"]["difference_other_memories"], 2, sign="+")
        refused = f"{_refused_pct(results, entry['agent']):.1f}"
        figures = [interval(entry["reward"], 2), interval(found["reward"], 2), f"{change:+.1f}", refused]
        rows.append([entry["agent"], *figures, against, others])
    reasons = _reasons(results)
    titles = ("agent", "imagined", "performed", "change [%]", "refused by the body [%]", "performed, over baseline")
    return [
        paragraph(
            f"The same agents with the same seeds on {base['n_memories']} memories, imagined and performed by the",
            f"standing robot ({base['n_seeds']} seeds, {results['rows'][0]['n_actions']} actions an episode).",
            f"Performed, an episode earns {min(changes):+.0f} to {max(changes):+.0f} % compared with imagined,",
            "depending on the agent. Ahead of uniform sampling when performed:",
            f"{', '.join(ahead)}." if ahead else f"nobody demonstrably. {caution}",
        ),
        table((*titles, "on other memories"), rows),
        f"Why the body refused, over all agents: {reasons}." if reasons else "The body refused nothing.",
    ]


def _refused_pct(results: Results, agent: str) -> float:
    counts = [row["outcomes"] for row in results["rows"] if (row["env"], row["agent"]) == (PHYSICAL, agent)]
    refused = sum(count.get(name, 0) for count in counts for name in REFUSALS)
    return 100.0 * refused / sum(sum(count.values()) for count in counts)


def _reasons(results: Results) -> str:
    outcomes = [row["outcomes"] for row in results["rows"] if row["env"] == PHYSICAL]
    counts = {name: sum(count.get(name, 0) for count in outcomes) for name in REFUSALS}
    ranked = sorted((item for item in counts.items() if item[1]), key=lambda item: -item[1])
    return ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in ranked)


def _modulation(results: Results) -> list[str]:
    turned = {entry["agent"]: entry for entry in _entries(results, MODULATION)}
    rows = [
        [
            entry["agent"],
            interval(entry["reward"], 2),
            interval(turned[entry["agent"]]["reward"], 2),
            *(f"{_usable(results, env, entry['agent']):.1f}" for env in (MENTAL, MODULATION)),
        ]
        for entry in _entries(results, MENTAL)
    ]
    return [
        "## What modulating a movement changes",
        paragraph(
            "The same agents with the PB held through each movement, and choosing a new PB every five ticks of it. The",
            "budget is the same number of movements.",
        ),
        table(("agent", "held", "modulated", "appropriate, held [%]", "appropriate, modulated [%]"), rows),
    ]


def _usable(results: Results, env: str, agent: str) -> float:
    found = [r["appropriateness_pct"]["mean"] for r in results["rows"] if (r["env"], r["agent"]) == (env, agent)]
    return sum(found) / len(found)


def _transfer(results: Results) -> list[str]:
    taught = results["record"]["settings"]["suite"]["taught"]
    whose = "a user's recordings" if taught["demonstrations"] else "the six actions taught again by another hand"
    how = f"{taught['n_epochs']:,} epochs, closed-loop ratio {taught['closed_loop_ratio']}"
    return [
        "## Memories of other demonstrations",
        paragraph(f"Memories trained on {whose} ({how})."),
        *_compared(_entries(results, MENTAL)),
    ]


SECTIONS = {
    "search": _search,
    "physical": _physical,
    "performed": _performed,
    "modulation": _modulation,
    "transfer": _transfer,
}


def _entries(results: Results, env: str) -> list[Entry]:
    found = [entry for entry in results["summary"] if entry["env"] == env]
    return sorted(found, key=lambda entry: -entry["reward"]["mean"])


def _baseline(results: Results, entries: Sequence[Entry]) -> Entry:
    return next(entry for entry in entries if entry["agent"] == results["baseline"])


RESULTS_AT = "results"
"""Where the documentation keeps the result files, seen from its pages."""

ORDER = ("search", "physical", "performed", "modulation", "transfer")
NEEDED = ("summary", "record", "baseline")
KEPT = ("command", "settings", "versions", "platform", "created", "memories", "seeds", "seconds")


def with_record(folder: Path) -> dict[str, Any]:
    """Return the results of a finished run folder together with what made them.

    Raises:
        NotFoundError: If the folder holds no results.
        FileFormatError: If results or record are damaged, or were made by an old version.
    """
    results = read_results(folder / "results.json")
    record = read_record(folder)
    found = {**results, "record": {key: record[key] for key in KEPT if key in record}}
    _check(found, folder / "results.json")
    return found


def publish(folders: Sequence[Path], docs: Path) -> list[Path]:
    """Copy the results of run folders to `docs` and write `leaderboard.md` and `results.md` of all that are there.

    Args:
        folders: Finished run folders of different suites; one of a suite replaces the published one.
        docs: Folder of the documentation.

    Returns:
        What was written.

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
        with naming(f"results in {docs / RESULTS_AT}"):
            page = result_page(published)
        written.append(storage.write_text(docs / "results.md", page))
    return written


def read_published(docs: Path) -> dict[str, dict[str, Any]]:
    """Return every published result file by its path as seen from the pages, in the order in which they are told."""
    found = {path: read_results(path) for path in sorted((docs / RESULTS_AT).glob("*.json"))}
    for path, results in found.items():
        _check(results, path)
    ranked = sorted(found, key=lambda path: (ORDER.index(path.stem) if path.stem in ORDER else len(ORDER), path.stem))
    return {f"{RESULTS_AT}/{path.name}": found[path] for path in ranked}


def _check(results: dict[str, Any], path: Path) -> None:
    for part in NEEDED:
        if part not in results:
            raise FileFormatError(f"results {path}: `{part}` is missing; it was made by an old version or by hand")
    check_summary(Fields(results, f"results {path}"))
    if not is_plain_name(results["suite"]):
        raise FileFormatError(f"results {path}: `suite` should be a plain name, but is {shown(results['suite'])}")
