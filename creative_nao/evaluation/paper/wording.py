"""The figures of the reproduction in words: cells of tables and sentences, made from the result files alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from creative_nao.evaluation.paper.comparisons import FAILS, HOLDS, UNDECIDED
from creative_nao.evaluation.paper.reference import CONDITION_NAMES

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
