"""The page about the reproduction: the content of the result files, given to a template.

The same files give the same page. It is Markdown for the documentation; a run folder also gets it as one HTML file.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jinja2
from markdown_it import MarkdownIt
from markupsafe import Markup

from creative_nao.errors import FileFormatError, NotFoundError
from creative_nao.evaluation.pages import DASH, data_uri, render
from creative_nao.evaluation.paper.bank import CONDITION_NAMES
from creative_nao.evaluation.paper.claims import (
    CONDITION_TITLES,
    DECIDED_BY_TABLE_I,
    FAILS,
    FURTHER,
    HOLDS,
    TABLE_I,
    UNDECIDED,
)
from creative_nao.evaluation.results import naming
from creative_nao.storage import read_json, write_text

PAGE = "reproduction.md"
RESULTS_AT = "results/paper"  # where the documentation keeps the result files, seen from the page

RESULT_FILES = ("results.json", "claims.json", "figures.json", "run.json", "sensitivity.json")
SENSITIVITY = "sensitivity.json"
"""The study of the open choices: there only if `studies/sensitivity.py` was run for these results."""

MINUS = "\N{MINUS SIGN}"
SIGNS = {FAILS: "**does not hold**", HOLDS: "**holds**", UNDECIDED: "undecided"}


def number(value: float | None, digits: int | None = None) -> str:
    """Return a figure with three significant digits or so, or with `digits` behind the point; a dash for None."""
    if value is None:
        return DASH
    if value == 0:
        return "0"
    if digits is None:
        size = abs(value)
        digits = 0 if size >= 100 else 1 if size >= 10 else 2 if size >= 0.1 else 4
    text = f"{value:,.{digits}f}"
    if not text.strip("-0.,"):
        text = text.lstrip("-")
    return text.replace("-", MINUS)


def interval(low: float | None, high: float | None) -> str:
    """Return an interval in brackets after a space, or nothing where there is none."""
    return "" if low is None or high is None else f" [{number(low)}, {number(high)}]"


def mean_cell(measured: Mapping[str, float | None] | None) -> str:
    """Return mean and interval."""
    return DASH if measured is None else f"{number(measured['mean'])}{interval(measured['low'], measured['high'])}"


def by_condition(values: Mapping[str, Any], digits: int | None = None) -> str:
    """Return one figure, or mean, of the three conditions: open / half / closed."""
    plain = [values.get(name) for name in CONDITION_NAMES]
    return " / ".join(number(one["mean"] if isinstance(one, Mapping) else one, digits) for one in plain)


FORMATS = {
    "number": number, "interval": interval, "mean_cell": mean_cell, "by_condition": by_condition, "signs": SIGNS,
    "conditions": CONDITION_NAMES, "titles": CONDITION_TITLES, "measures": (*TABLE_I, *FURTHER),
    "judged": DECIDED_BY_TABLE_I,
}  # fmt: skip
"""What the template needs besides results."""


def read_content(folder: Path) -> dict[str, Any]:
    """Return the content of the result files in `folder` by their names without ending; None for a missing study.

    NotFoundError tells of one that is missing and has to be there, FileFormatError of one that is no JSON.
    """
    content = {}
    for name in RESULT_FILES:
        path = folder / name
        if not path.is_file() and name != SENSITIVITY:
            raise NotFoundError(f"no {path}; make it with `creative-nao evaluate paper`")
        content[path.stem] = read_json(path, "results") if path.is_file() else None
    if isinstance(content["claims"], dict):  # release 0.1.0 wrote the list alone
        content["claims"] = content["claims"].get("claims")
    return content


def make_page(content: Mapping[str, Any], *, results_at: str = "") -> str:
    """Return the page as Markdown, made of what `read_content` gives.

    For its links, `results_at` is the folder of the result files, seen from the page; empty for the same folder.
    FileFormatError tells of a part of a result file that is missing or of another kind.
    """
    study = content["sensitivity"]
    with naming("results"):
        try:
            return render(
                "paper.md.jinja",
                **content,
                **FORMATS,
                n_seeds={row["memory"]: row["n_seeds"] for row in content["results"]["rows"]},
                by_verdict={sign: [one for one in content["claims"] if one["verdict"] == sign] for sign in SIGNS},
                findings=findings(study) if study else [],
                files=[*(name for name in RESULT_FILES if study or name != SENSITIVITY), "networks.csv"],
                prefix=f"{results_at}/" if results_at else "",
            )
        except jinja2.UndefinedError as error:
            raise FileFormatError(f"results: {error}") from error


def findings(study: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return what the study of the open choices, `sensitivity.json`, says of each claim that Table I decides.

    Returns:
        `study`: `scoring` or `training`. `says`: the claim. `titles`: by verdict, the ways in which it is reached.
        `first`: the condition that should have the largest mean, which it has in `n_first` of `n_ways` ways.
    """
    found = []
    for kind, claim in itertools.product(("scoring", "training"), DECIDED_BY_TABLE_I):
        rows, first = study[kind], claim.pairs[0][0]
        verdicts = [row["verdicts"][claim.key]["verdict"] for row in rows]
        titles = {
            verdict: [row["title"] for row, mine in zip(rows, verdicts, strict=True) if mine == verdict]
            for verdict in (HOLDS, FAILS, UNDECIDED)
            if verdict in verdicts
        }
        n_first = sum(row["order"][claim.field][:1] == [first] for row in rows)
        place = {"first": first, "n_first": n_first, "n_ways": len(rows)}
        found.append({"study": kind, "says": claim.says, "titles": titles, **place})
    return found


def to_html(markdown: str, images: Path) -> str:
    """Return the page as HTML that needs no other file: its pictures, seen from the folder `images`, are put in."""
    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = parser.parse(markdown)
    for token in tokens:
        for child in token.children or []:
            if child.type == "image":
                child.attrs["src"] = data_uri(images / str(child.attrs["src"]))
            if child.type == "link_open" and not str(child.attrs["href"]).startswith("https://"):
                del child.attrs["href"]  # files of the documentation are not beside a report
    body = parser.renderer.render(tokens, parser.options, {})
    body = body.replace("&lt;br&gt;", "<br>")
    body = body.replace("</table>", "</table>\n</div>").replace("<th></th>", "<td></td>")  # which heads nothing
    first, *others = body.split("<table>")
    frame = '<div class="wide" role="region" aria-label="Table {}" tabindex="0">\n<table>{}'
    body = first + "".join(frame.format(place, text) for place, text in enumerate(others, 1))
    return render("paper.html.jinja", body=Markup(body))  # noqa: S704 - Markdown without HTML in it


def write_page(folder: Path) -> Path:
    """Write `reproduction.md` and `report.html` of a run folder from its result files and pictures."""
    with naming(f"results in {folder}"):
        page = make_page(read_content(folder))
    write_text(folder / "report.html", to_html(page, folder))
    return write_text(folder / PAGE, page)
