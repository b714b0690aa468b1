"""A page as a list of blocks, written as Markdown for the documentation and as HTML for a run folder.

Also here:
- The figures of the reproduction in words: cells of tables and sentences, made from the result files alone.
"""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from creative_nao.evaluation.paper.comparisons import CONDITION_NAMES, FAILS, HOLDS, UNDECIDED


@dataclass(frozen=True)
class Heading:
    """A heading; level 1 is the title."""

    text: str
    level: int = 2


@dataclass(frozen=True)
class Text:
    """A paragraph; `**strong**`, `code` in backticks and [links](target) may stand in it."""

    text: str


@dataclass(frozen=True)
class Bullets:
    """A list of such texts."""

    items: tuple[str, ...]


@dataclass(frozen=True)
class Table:
    """A table of such texts; the first column is left, the others are right unless `left` says so."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    left: tuple[int, ...] = (0,)


@dataclass(frozen=True)
class Picture:
    """A figure with its caption; `name` is the file's name without folder and ending."""

    name: str
    title: str
    caption: str


@dataclass(frozen=True)
class Code:
    """Lines for a shell."""

    text: str


Block = Heading | Text | Bullets | Table | Picture | Code


def to_markdown(blocks: Sequence[Block], *, images: str = "images") -> str:
    """Return the page as Markdown; pictures are PNG files in the folder `images`, seen from the page."""
    return "\n\n".join(_markdown(block, images) for block in blocks) + "\n"


def to_html(blocks: Sequence[Block], *, style: str, image: Callable[[str], Path]) -> str:
    """Return the page as one HTML file that needs nothing else.

    Args:
        blocks: The page.
        style: The style sheet.
        image: Tells the file of a picture by its name.
    """
    title = next(block.text for block in blocks if isinstance(block, Heading))
    body = "\n".join(_html(block, image) for block in blocks)
    return (
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<title>{html.escape(title)}</title>\n'
        f"<style>\n{style}</style>\n</head>\n<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def _markdown(block: Block, images: str) -> str:
    match block:
        case Heading():
            return f"{'#' * block.level} {block.text}"
        case Text():
            return block.text
        case Bullets():
            return "\n".join(f"- {item}" for item in block.items)
        case Table():
            rule = ["---" if place in block.left else "---:" for place in range(len(block.head))]
            return "\n".join("| " + " | ".join(row) + " |" for row in (block.head, tuple(rule), *block.rows))
        case Picture():
            return f"![{block.title}]({images}/{block.name}.png)\n\n**{block.title}.** {block.caption}"
        case Code():
            return f"```sh\n{block.text}\n```"


def _html(block: Block, image: Callable[[str], Path]) -> str:
    match block:
        case Heading():
            return f"<h{block.level}>{_inline(block.text)}</h{block.level}>"
        case Text():
            return f"<p>{_inline(block.text)}</p>"
        case Bullets():
            return "<ul>\n" + "\n".join(f"<li>{_inline(item)}</li>" for item in block.items) + "\n</ul>"
        case Table():
            return _html_table(block)
        case Picture():
            coded = base64.b64encode(image(block.name).read_bytes()).decode("ascii")
            return (
                f'<figure>\n<img src="data:image/png;base64,{coded}" alt="{html.escape(block.title)}">\n'
                f"<figcaption><strong>{_inline(block.title)}.</strong> {_inline(block.caption)}</figcaption>\n</figure>"
            )
        case Code():
            return f"<pre>{html.escape(block.text)}</pre>"


def _html_table(block: Table) -> str:
    def line(cells: Sequence[str], tag: str) -> str:
        starts = [f'<{tag} class="left">' if place in block.left else f"<{tag}>" for place in range(len(cells))]
        told = (f"{start}{_inline(cell)}</{tag}>" for start, cell in zip(starts, cells, strict=True))
        return f"<tr>{''.join(told)}</tr>"

    rows = "\n".join(line(row, "td") for row in block.rows)
    return (
        f'<div class="wide">\n<table>\n<thead>{line(block.head, "th")}</thead>\n<tbody>\n{rows}\n</tbody>\n'
        "</table>\n</div>"
    )


def _inline(text: str) -> str:
    told = html.escape(text)
    told = told.replace("&lt;br&gt;", "<br>")
    told = re.sub(r"`([^`]+)`", r"<code>\1</code>", told)
    told = re.sub(r"\*\*([^*]+)\*\*", r"<strong>\1</strong>", told)
    # Files of the documentation are not beside a report; what a link leads to elsewhere is.
    told = re.sub(r"\[([^\]]+)\]\((https?://[^)]+)\)", r'<a href="\2">\1</a>', told)
    return re.sub(r"\[([^\]]+)\]\([^)]+\)", r"\1", told)


MINUS, DASH = "\N{MINUS SIGN}", "\N{EN DASH}"
SIGN = {HOLDS: "**holds**", FAILS: "**does not hold**", UNDECIDED: "undecided"}


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


def signed(value: float) -> str:
    """Return a difference with its sign."""
    text = number(value)
    return text if text.startswith(MINUS) else f"+{text}"


def interval(low: float | None, high: float | None) -> str:
    """Return an interval in brackets, or nothing where there is none."""
    return "" if low is None or high is None else f" [{number(low)}, {number(high)}]"


def mean_cell(measured: Mapping[str, float | None] | None) -> str:
    """Return mean and interval."""
    return DASH if measured is None else f"{number(measured['mean'])}{interval(measured['low'], measured['high'])}"


def range_cell(spread: Mapping[str, Mapping[str, float]], field: str) -> str:
    """Return the smallest and the largest value over seeds."""
    found = spread.get(field)
    return DASH if found is None else f"{number(found['smallest'])} to {number(found['largest'])}"


def by_condition(values: Mapping[str, Any], digits: int | None = None) -> str:
    """Return one figure of the three conditions, open / half / closed."""
    return " / ".join(number(values.get(name), digits) for name in CONDITION_NAMES)


def evidence(claim: Mapping[str, Any]) -> str:
    """Return what decides a claim: shares of networks, or differences of means."""
    if "rates" in claim:
        shares = ", ".join(f"{one['condition']} {one['n_yes']} of {one['n']}" for one in claim["rates"])
        return f"{shares}; {claim['unit']}: {by_condition(claim['means'])}"
    return "; ".join(compared(one) for one in claim["differences"]) or "nothing to compare"


def compared(difference: Mapping[str, Any]) -> str:
    """Return one difference of means with its interval and the probability of superiority."""
    span = interval(difference["low"], difference["high"])
    return (
        f"{difference['above']} {MINUS} {difference['below']}: {signed(difference['mean'])}{span}, "
        f"larger in {100 * difference['superiority']:.0f} % of pairs"
    )


def order(names: Sequence[str]) -> str:
    """Return an order of conditions from the largest mean to the smallest."""
    return " > ".join(names) if names else DASH


def listed(words: Sequence[str]) -> str:
    """Return words as a sentence lists them."""
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + f" and {words[-1]}" if words else ""


def plural(count: int, word: str) -> str:
    """Return `1 network`, `2 networks`."""
    return f"{count:,} {word}{'' if count == 1 else 's'}"
