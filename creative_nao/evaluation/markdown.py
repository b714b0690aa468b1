"""Markdown pieces of the generated pages: paragraphs, tables, figures with intervals."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

WIDTH = 120
DASH = "\N{EN DASH}"


def paragraph(*sentences: str) -> str:
    """Return sentences as one wrapped paragraph."""
    return textwrap.fill(" ".join(sentences), WIDTH, break_long_words=False, break_on_hyphens=False)


def bullet(*sentences: str) -> str:
    """Return sentences as one wrapped item of a list."""
    return textwrap.fill(
        " ".join(sentences),
        WIDTH,
        initial_indent="- ",
        subsequent_indent="  ",
        break_long_words=False,
        break_on_hyphens=False,
    )


def table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table whose first column is text and whose others are figures."""
    lines = ["| " + " | ".join(titles) + " |", "| --- |" + " ---: |" * (len(titles) - 1)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def interval(found: Mapping[str, Any] | None, digits: int, *, scale: float = 1.0, sign: str = "") -> str:
    """Return a figure with its interval as text; a dash where there is none.

    Example:
        >>> interval({"mean": 0.5, "low": 0.25, "high": 0.75}, 1, scale=100.0)
        '50.0 [25.0, 75.0]'
    """
    if found is None:
        return DASH
    mean = f"{scale * found['mean']:{sign}.{digits}f}"
    return mean if found["low"] is None else f"{mean} {span(found, digits, scale=scale, sign=sign)}"


def span(found: Mapping[str, Any], digits: int, *, scale: float = 1.0, sign: str = "") -> str:
    """Return an interval alone as text."""
    if found["low"] is None:
        return "unknown"
    return f"[{scale * found['low']:{sign}.{digits}f}, {scale * found['high']:{sign}.{digits}f}]"
