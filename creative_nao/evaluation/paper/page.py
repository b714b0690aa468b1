"""The page about the reproduction, made from the result files alone: the same files give the same page.

Also here:
- Write the page of a run folder, and bring page, pictures and results into the documentation.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from creative_nao import storage
from creative_nao.errors import NotFoundError, SettingsError
from creative_nao.evaluation.paper import sensitivity
from creative_nao.evaluation.paper.blocks import (
    SIGN,
    Block,
    Bullets,
    Code,
    Heading,
    Picture,
    Table,
    Text,
    by_condition,
    evidence,
    listed,
    mean_cell,
    number,
    plural,
    range_cell,
    to_html,
    to_markdown,
)
from creative_nao.evaluation.paper.comparisons import (
    CONDITION_NAMES,
    CONDITION_TITLES,
    FAILS,
    FURTHER,
    HOLDS,
    TABLE_I,
    UNDECIDED,
)
from creative_nao.evaluation.results import naming
from creative_nao.evaluation.run import read_record
from creative_nao.storage import as_json, read_text

FILES = ("run", "results", "claims", "figures", "sensitivity")
PAPER = "[arXiv:1805.05537](https://arxiv.org/abs/1805.05537)"


@dataclass(frozen=True)
class Content:
    """What the page is made from: the content of the JSON files of these names.

    Attributes:
        run: Settings, versions, command.
        results: Means with intervals, a row per condition.
        claims: Verdicts with their evidence.
        figures: What the captions say of what is shown.
        sensitivity: The study of the open choices, or None.
    """

    run: Mapping[str, Any]
    results: Mapping[str, Any]
    claims: list[Mapping[str, Any]]
    figures: Mapping[str, Any]
    sensitivity: Mapping[str, Any] | None

    @property
    def n_seeds(self) -> dict[str, int]:
        """Number of networks per condition."""
        return {row["memory"]: row["n_seeds"] for row in self.results["rows"]}


def read_content(folder: Path) -> Content:
    """Read the result files in `folder`.

    Raises:
        NotFoundError: If one is missing that has to be there.
    """
    found = {}
    for name in FILES:
        path = folder / f"{name}.json"
        if not path.is_file() and name != "sensitivity":
            raise NotFoundError(f"no {path}; make it with `creative-nao evaluate paper`")
        found[name] = as_json(read_text(path, "results"), f"results {path}") if path.is_file() else None
    return Content(**found)


def make_page(content: Content, *, results_at: str) -> list[Block]:
    """Return the page.

    Args:
        content: The result files.
        results_at: Folder of the result files, seen from the page, for its links; empty for the same folder.
    """
    prefix = f"{results_at}/" if results_at else ""
    return [
        Heading("Reproduction of the paper", 1),
        *_introduction(content, prefix),
        *_in_short(content),
        *_table(content),
        *_claims(content),
        *_figures(content),
        *(sensitivity.blocks(content.sensitivity) if content.sensitivity else []),
        *_limits(content),
        *_repeat(content, prefix),
    ]


def _introduction(content: Content, prefix: str) -> list[Block]:
    settings = content.run["settings"]
    counts = content.n_seeds
    same = len(set(counts.values())) == 1
    told = f"{counts['open']} networks" if same and counts["open"] > 1 else "one network" if same else "networks"
    number_told = told if same else f"{by_condition(counts, 0)} networks ({' / '.join(CONDITION_NAMES)})"
    origin = {
        "shipped": "They are the bank that ships with the package.",
        "retrain": "They were trained for this run.",
        "quick": "They were trained for this run, for a short time.",
    }[settings["source"]]
    epochs = listed([f"{n:,}" for n in content.figures["n_epochs"]])
    side = settings["resolution"]
    blocks: list[Block] = [
        Text(
            f"The paper (J. Hwang and J. Tani, UR 2018, {PAPER}) trains one network in each of three conditions, maps "
            "what it generates and draws conclusions from the differences. Nothing in it tells how much of a "
            f"difference is chance. Here the experiment is repeated with {number_told} in each condition, {epochs} "
            f"epochs each, {side} x {side} points of the map of each. {origin} They learned our own recordings of the "
            "six actions, since the paper's are not public, so that levels can differ; the question is "
            "whether the conclusions hold."
        ),
        Text(
            "Tick, length and number of punches of these recordings were chosen so that the level of Table I has the "
            "paper's size. The order of the conditions played no part in any choice; see [decisions.md](decisions.md). "
            "This page is written by a command from "
            + listed([f"[{name}]({prefix}{name})" for name in _files(content)])
            + "; a network's own figures are in the last of them."
        ),
    ]
    if settings["source"] == "quick":
        blocks.insert(
            1,
            Text(
                "**This is a quick look**: few networks, trained for a fraction of the paper's 100,000 epochs. It "
                "shows what the whole reproduction looks like and decides nothing; leave out `--quick` for that."
            ),
        )
    if content.figures["failures"]:
        failed = [f"{name} ({reason})" for name, reason in content.figures["failures"].items()]
        blocks.append(Text(f"Could not be trained and are left out: {listed(failed)}."))
    return blocks


def _files(content: Content) -> list[str]:
    names = ["results.json", "claims.json", "figures.json", "run.json"]
    return [*names, *(["sensitivity.json"] if content.sensitivity else []), "networks.csv"]


def _in_short(content: Content) -> list[Block]:
    blocks: list[Block] = [Heading("In short")]
    groups = {verdict: [one for one in content.claims if one["verdict"] == verdict] for verdict in SIGN}
    n_hold, n_fail, n_open = (len(groups[verdict]) for verdict in (HOLDS, FAILS, UNDECIDED))
    blocks.append(
        Text(
            f"Of {len(content.claims)} statements of the paper, {n_hold} hold over these seeds, {n_fail} do not, and "
            f"{n_open} stay undecided."
        )
    )
    lines = [f"{SIGN[FAILS]}: {one['says']} {_against(one)}" for one in groups[FAILS]]
    lines += [f"{SIGN[HOLDS]}: {one['says']}" for one in groups[HOLDS]]
    if groups[UNDECIDED]:
        lines.append(f"{SIGN[UNDECIDED]}: " + " ".join(one["says"] for one in groups[UNDECIDED]))
    blocks.append(Bullets(tuple(lines)))
    if content.sensitivity:
        changing = sensitivity.findings(content.sensitivity, only_changing=True)
        told = "What depends on the open choices" if changing else "No verdict that Table I decides depends on them"
        blocks.append(Text(f"{told} ([more below](#what-depends-on-which-open-choice)):" if changing else f"{told}."))
        blocks += [Bullets(tuple(changing))] if changing else []
    return blocks


def _against(claim: Mapping[str, Any]) -> str:
    """Return in plain words what was found instead."""
    if "rates" in claim:
        few = [one for one in claim["rates"] if one["high"] < 0.5]
        return "Here " + listed([f"{one['n_yes']} of {one['n']} {one['condition']} networks do" for one in few]) + "."
    wrong = [one for one in claim["differences"] if one["high"] is not None and one["high"] < 0]
    told = [
        f"{one['below']} is above {one['above']} by {number(-one['mean'])} "
        f"[{number(-one['high'])}, {number(-one['low'])}]"
        for one in wrong
    ]
    unit = f" {claim['unit']}" if claim["unit"] else ""
    return f"Here {listed(told)}{unit} ({claim['measured']})."


def _table(content: Content) -> list[Block]:
    rows = {row["memory"]: row for row in content.results["rows"]}
    head = ["", *(f"{CONDITION_TITLES[name]}: {who}" for name in CONDITION_NAMES for who in ("paper", "here"))]
    body = []
    for measure in (*TABLE_I, *FURTHER):
        cells = [f"{measure.title} [{measure.unit}]"]
        for name in CONDITION_NAMES:
            ours = rows[name]
            told = mean_cell(ours[measure.field])
            if ours["n_seeds"] > 1:
                told += f"<br>{range_cell(ours['spread'], measure.field)}"
            cells += [number(measure.paper.get(name), 2), told]
        body.append(tuple(cells))
    return [
        Heading("Table I"),
        Text(
            "The paper's one network beside ours: mean over the networks with its 95 % interval, below it the smallest "
            "and the largest network. Novelty and diversity are means over 30 draws of 30 appropriate actions."
        ),
        Table(tuple(head), tuple(body)),
        Picture(
            "paper_table",
            "Table I, network by network",
            "Where the dots of two conditions overlap, one network of each cannot tell which condition is ahead.",
        ),
    ]


def _claims(content: Content) -> list[Block]:
    rows = tuple(
        (one["says"], one["paper"], SIGN[one["verdict"]], f"{one['measured']}: {evidence(one)}")
        for one in content.claims
    )
    return [
        Heading("Claim by claim"),
        Text(
            "An order of conditions **holds** when every difference of means that it needs has its whole 95 % interval "
            "above zero, **does not hold** when one of them has it below zero, and is undecided otherwise. The "
            "intervals are over networks (the wider of bootstrap and Welch's t); 'larger in x % of pairs' is the "
            "probability that a network of the first condition has the larger value than one of the second. A "
            "statement about all conditions **holds** when in each of them most networks show it (Wilson's 95 % "
            "interval of the share above one half), and **does not hold** when in one of them most do not. "
            "Figures with slashes are means of open / half / closed."
        ),
        Table(("The paper says", "from", "over seeds", "what decides it"), rows, left=(0, 1, 2, 3)),
    ]


def _figures(content: Content) -> list[Block]:
    shown = content.figures
    examples = (
        "A fluctuating and a non-moving movement drawn at random from the first map that has one, the two most novel "
    )
    examples += "of the first map by greedy search, and the clearest combination of the first map that has one."
    missing = f" Not shown: {shown['examples_missing']}." if shown["examples_missing"] else ""
    walk = shown["walk"]
    first, last = (name.replace("_", " ") for name in walk["between"])
    return [
        Heading("Figures"),
        Picture(
            "paper_learning",
            "Learning curves (Fig. 2 of the paper)",
            "Left: median over networks, band from the lowest to the highest. Right: one network each, every kept "
            "point.",
        ),
        Picture(
            "paper_actions",
            "The six basic actions (Fig. 3a)",
            "Right arm solid, left arm dashed, as the robot's encoders recorded them.",
        ),
        Picture("paper_examples", "Movements that cannot be used, and new ones (Fig. 3b, c)", f"{examples}{missing}"),
        Picture(
            "paper_maps",
            "PB maps of the three conditions (Fig. 4)",
            f"Seed {shown['shown_seed']} of each, the lowest there is. Colour is the nearest basic action, strong "
            "where alike; lines enclose what is learned; hatched is what cannot be used; letters mark the learned "
            "PB values.",
        ),
        Picture(
            "paper_all_maps",
            "Every network's map",
            "The same actions, the same settings, other initial weights. Dots mark the learned PB values.",
        ),
        Picture(
            "paper_walk",
            "A walk through the map of a half closed network (Fig. 5)",
            f"Six evenly spaced points on the straight line from the learned PB value of {first} to that of {last}, in "
            f"{walk['memory']}; the paper does not tell how it chose its points.",
        ),
    ]


def _limits(content: Content) -> list[Block]:
    least = min(content.n_seeds.values())
    lines = [
        "The recordings are ours, taught in simulation. Another set of six actions may give another answer.",
        "The intervals speak of other initial weights for the same six actions, and of nothing else.",
        "'Simpler', 'rugged' and 'combination' are not defined in the paper; the measures are ours, and named above.",
        f"{len(content.claims)} statements are judged at 95 % each: one of them may well be decided wrongly by chance.",
    ]
    if least < 10:
        lines.insert(
            1, f"{plural(least, 'network')} in a condition is few: 'undecided' then says little about the paper."
        )
    return [Heading("What this does not show"), Bullets(tuple(lines))]


def _repeat(content: Content, prefix: str) -> list[Block]:
    versions = ", ".join(f"{name} {version}" for name, version in content.run["versions"].items())
    return [
        Heading("How to repeat it"),
        Code(content.run["command"]),
        Text(
            "The first of these trains its own few networks in minutes, the second ten per condition from nothing, the "
            "third adds the study of the open choices:"
        ),
        Code(
            "creative-nao evaluate paper --quick\ncreative-nao evaluate paper --retrain\n"
            "creative-nao evaluate paper --sensitivity"
        ),
        Text(
            f"The same seed gives the same figures on the same versions, whatever the number of workers. This page: "
            f"{versions}, "
            f"{content.run['platform']}, {content.run['created'][:10]}."
        ),
    ]


RESULTS_AT = "results/paper"
"""Where the documentation keeps the result files, seen from the page."""

PAGE = "reproduction.md"


def write_page(folder: Path) -> Path:
    """Write `reproduction.md` and `report.html` of a run folder from its result files and pictures."""
    with naming(f"results in {folder}"):
        blocks = make_page(read_content(folder), results_at="")
    style = (Path(__file__).parent / "report.css").read_text(encoding="utf-8")
    storage.write_text(
        folder / "report.html", to_html(blocks, style=style, image=lambda name: folder / "images" / f"{name}.png")
    )
    return storage.write_text(folder / PAGE, to_markdown(blocks))


def publish(folder: Path, docs: Path) -> list[Path]:
    """Bring the page of a run folder, its pictures and its result files into a documentation folder.

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
    results = docs / RESULTS_AT
    results.mkdir(parents=True, exist_ok=True)
    written = []
    for name in (*(f"{name}.json" for name in FILES), "networks.csv"):
        source, target = folder / name, results / name
        if name == "run.json":
            kept = {key: value for key, value in read_record(folder).items() if key != "hashes"}
            written.append(storage.write_text(target, json.dumps(kept, indent=2, allow_nan=False) + "\n"))
        elif source.is_file():
            written.append(storage.write_bytes(target, source.read_bytes()))
        else:
            target.unlink(missing_ok=True)
    (docs / "images").mkdir(exist_ok=True)
    for picture in sorted((folder / "images").glob("paper_*.png")):
        written.append(Path(shutil.copyfile(picture, docs / "images" / picture.name)))
    with naming(f"results in {results}"):
        blocks = make_page(read_content(results), results_at=RESULTS_AT)
    return [*written, storage.write_text(docs / PAGE, to_markdown(blocks))]
