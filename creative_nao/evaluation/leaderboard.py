"""`docs/leaderboard.md`: everyone's figures side by side, written from result files alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from creative_nao.evaluation.markdown import DASH, interval, paragraph, table
from creative_nao.evaluation.tables import env_label

Results = Mapping[str, Any]
COLUMNS = (
    "agent",
    "reward (IQM)",
    "reward (mean)",
    "of oracle [%]",
    "beats the baseline [%]",
    "ahead on",
    "actions in training",
)
PACKAGES = ("numpy", "torch", "numba", "mujoco")

PREFACE = (
    "# Leaderboard",
    paragraph(
        "Who finds the most new, usable actions for the least trying? Everybody has the same budget of generated",
        "actions in an episode. Figures are over all memories and seeds of a suite; in brackets stands the 95 %",
        "stratified bootstrap interval (seeds drawn anew within each memory, widened for few seeds).",
    ),
    paragraph(
        "Sorted by the interquartile mean (IQM: the mean of the middle half), which a few lucky episodes do not move.",
        "*Of oracle*: share of what a greedy search earns that knows the whole map beforehand. *Beats the baseline*:",
        "how probable it is that an episode of the agent earns more than one of the baseline on the same memory; 50 is",
        "no difference. *Ahead on*: memories on which its mean is higher.",
    ),
    paragraph(
        "This page is written by `creative-nao evaluate leaderboard` from the files named below;",
        "`creative-nao evaluate verify FILE` plays a sample of their episodes again and says whether they hold.",
    ),
)
ENTERING = (
    "## Enter your own",
    "Name your agent's bundle file and run the suite; everything else stays as it is:",
    "```sh\n"
    "creative-nao evaluate search --agents supervised,my_agent.safetensors --out runs/mine\n"
    "creative-nao evaluate verify runs/mine/results.json\n"
    "creative-nao evaluate leaderboard runs/mine\n"
    "```",
    paragraph(
        "A suite is a TOML file, so a comparison of your own is one too: `creative-nao evaluate my_suite.toml`. The",
        "shipped ones are in `creative_nao/evaluation/suites/`. Agents must not be trained or tuned on the bank's test",
        "memories.",
    ),
)


def leaderboard(published: Mapping[str, Results]) -> str:
    """Return the page as Markdown.

    Args:
        published: Content of each result file, by its path as seen from the page.
    """
    suites = [block for path, results in published.items() for block in _suite(path, results)]
    return "\n\n".join([*PREFACE, *suites, *ENTERING]) + "\n"


def _suite(path: str, results: Results) -> list[str]:
    record = results["record"]
    suite = record["settings"]["suite"]
    blocks = [f"## Suite `{results['suite']}`"]
    if suite.get("about"):
        blocks.append(paragraph(suite["about"]))
    for env in dict.fromkeys(entry["env"] for entry in results["summary"]):
        entries = [entry for entry in results["summary"] if entry["env"] == env]
        entries.sort(key=lambda entry: -entry["reward_iqm"]["mean"])
        memories = f"{entries[0]['n_memories']} {'memory' if entries[0]['n_memories'] == 1 else 'memories'}"
        blocks += [
            f"### {env_label(env).capitalize()}: {memories}, {entries[0]['n_seeds']} seeds, "
            f"{suite['n_actions']} actions an episode",
            table(COLUMNS, [_line(entry, results["baseline"]) for entry in entries]),
        ]
    versions = record["versions"]
    made_with = ", ".join(f"{name} {versions[name]}" for name in PACKAGES if name in versions)
    blocks.append(
        paragraph(
            f"From [{path}]({path}), made by `{record['command']}`",
            f"with creative-nao {versions['creative-nao']} ({made_with}).",
        )
    )
    return blocks


def _line(entry: Mapping[str, Any], baseline: str | None) -> list[str]:
    versus = entry["versus"]
    return [
        entry["agent"] + (" (baseline)" if entry["agent"] == baseline else ""),
        interval(entry["reward_iqm"], 2),
        interval(entry["reward"], 2),
        interval(entry["oracle_share"], 1, scale=100.0),
        interval(versus and versus["probability_of_improvement"], 0, scale=100.0),
        f"{versus['n_memories_ahead']} of {entry['n_memories']}" if versus else DASH,
        f"{entry['n_actions_training']:,}",
    ]
