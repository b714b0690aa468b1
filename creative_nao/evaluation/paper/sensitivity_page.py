"""What the study of the open choices says: tables, and sentences about what depends on what."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from creative_nao.evaluation.paper.blocks import Block, Bullets, Heading, Table, Text
from creative_nao.evaluation.paper.claims import CLAIMS, Order
from creative_nao.evaluation.paper.comparisons import FAILS, HOLDS, UNDECIDED
from creative_nao.evaluation.paper.reference import CONDITION_NAMES
from creative_nao.evaluation.paper.rescoring import FIGURES
from creative_nao.evaluation.paper.sensitivity import CLAIM_KEYS
from creative_nao.evaluation.paper.wording import SIGN, by_condition, listed, order

TITLES = {
    "appropriateness_pct": "appropriate [%]",
    "learned_pct": "learned [%]",
    "novelty": "novelty",
    "diversity": "diversity",
}
JUDGED = [claim for claim in CLAIMS if isinstance(claim, Order) and claim.key in CLAIM_KEYS]
SHORT = {
    "half-novel": "half most novel",
    "half-diverse": "half most diverse",
    "closed-appropriate": "closed most appropriate",
    "closed-like-training": "closed most learned",
}


def blocks(study: Mapping[str, Any]) -> list[Block]:
    """Return the part of the page about the study."""
    settings = study["settings"]
    epochs, side, seeds = settings["n_epochs"], settings["resolution"], settings["n_seeds"]
    rule = f"Means of {' / '.join(CONDITION_NAMES)}, {side} x {side} points of each map."
    return [
        Heading("What depends on which open choice"),
        Text(
            "The paper leaves choices open; [decisions.md](decisions.md) lists ours. Here each is changed alone. The "
            "tables give the four figures, the order of the means, and the verdicts on the four claims that Table I "
            "decides, by the same rule as above."
        ),
        Heading("Other ways to score the same movements", 3),
        Text(
            f"All networks of this page. {rule} Where the distance has another unit, so have novelty and diversity, "
            "and an action is learned up to the same share of the mean distance between two basic actions as 10 is by "
            "default."
        ),
        _figures_table(study["scoring"]),
        _verdict_table(study["scoring"]),
        Heading("Other ways to train", 3),
        Text(
            f"{seeds} networks per row and condition, {epochs:,} epochs. {rule} The first row is the default trained "
            "as few and as short; with so few networks only large differences are decided. Another tick and another "
            "speed are read from the same recordings by a monotone cubic; a distance is summed over ticks, so that it "
            "grows with their number while the threshold of 10 stays. A network sees nothing but the change "
            "of angle from tick to tick: movements 1.5 times as slow at 0.15 s are the row of 0.10 s."
        ),
        _figures_table(study["training"]),
        _verdict_table(study["training"], with_back=True),
        Bullets(tuple(findings(study))),
    ]


def findings(study: Mapping[str, Any], only_changing: bool = False) -> list[str]:
    """Return in sentences which conclusions change with which choice.

    Args:
        study: Content of `sensitivity.json`.
        only_changing: Leave out the conclusions whose verdict is the same in every way.
    """
    few = f"{study['settings']['n_seeds']} short networks each"
    return [
        *_told(study["scoring"], "however it is scored", "depends on how it is scored", only_changing),
        *_told(
            study["training"], f"however it is trained ({few})", f"depends on how it is trained ({few})", only_changing
        ),
    ]


def _told(rows: Sequence[Mapping[str, Any]], steady: str, depends: str, only_changing: bool) -> list[str]:
    lines = []
    for claim in JUDGED:
        found = {row["title"]: row["verdicts"][claim.key]["verdict"] for row in rows}
        first = claim.pairs[0][0]
        n_first = sum(row["order"][claim.field][:1] == [first] for row in rows)
        means = f"{first} has the largest mean in {n_first} of {len(rows)} ways"
        if len(set(found.values())) == 1:
            if not only_changing:
                lines.append(f"'{claim.says}' {steady}: {next(iter(found.values()))}; {means}.")
            continue
        parts = [
            f"{verdict} with {listed([title for title, one in found.items() if one == verdict])}"
            for verdict in (HOLDS, FAILS, UNDECIDED)
            if verdict in found.values()
        ]
        lines.append(f"'{claim.says}' {depends}: {'; '.join(parts)}. {means[0].upper()}{means[1:]}.")
    return lines


def _figures_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    body = []
    for row in rows:
        cells = [
            by_condition({name: one["mean"] if one else None for name, one in row["figures"][field].items()})
            for field in FIGURES
        ]
        body.append((row["title"], *cells))
    return Table(("changed", *(TITLES[field] for field in FIGURES)), tuple(body))


def _verdict_table(rows: Sequence[Mapping[str, Any]], with_back: bool = False) -> Table:
    body = []
    for row in rows:
        cells = [
            f"{order(row['order'][field])}<br>{SIGN[row['verdicts'][key]['verdict']]}"
            for field, key in zip(
                ("novelty", "diversity", "appropriateness_pct", "learned_pct"), CLAIM_KEYS, strict=True
            )
        ]
        if with_back:
            cells.append(
                " / ".join(f"{row['n_giving_all_back'][name]} of {row['n_seeds'][name]}" for name in CONDITION_NAMES)
            )
        body.append((row["title"], *cells))
    head = ["changed", *(SHORT[key] for key in CLAIM_KEYS), *(["give all six back"] if with_back else [])]
    return Table(tuple(head), tuple(body), left=tuple(range(len(head))))
