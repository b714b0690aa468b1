"""Generated pages: Jinja templates hold the sentences, Python gives the figures.

Every value in an HTML template (`*.html.jinja`) is escaped. Markdown has no automatic escaping: in a Markdown template
(`*.md.jinja`) text that comes from a file passes the filter `md`, or `code` for a code span. Control characters and
marks that change the direction of text are replaced in both.

Filters of the templates: `md`, `code`, `interval` (mean with interval), `span` (interval alone), `thousands`, and the
blocks `{% filter paragraph %}` and `{% filter bullet %}`, which wrap Markdown at 120 columns.
"""

from __future__ import annotations

import base64
import functools
import re
import textwrap
import unicodedata
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jinja2

WIDTH = 120
"""Columns of wrapped Markdown."""
DASH = "\N{EN DASH}"
"""Stands where there is no figure."""
MARKDOWN = ".md.jinja"
IMAGE_TYPES = {".png": "image/png", ".svg": "image/svg+xml"}
_MARKUP = str.maketrans(
    {mark: f"\\{mark}" for mark in "\\`|*[]"} | {"<": "&lt;", ">": "&gt;", "&": "&amp;"}
)  # fmt: skip


def render(template: str, folder: Path | None = None, /, **values: Any) -> str:
    """Return a page.

    Args:
        template: File in the folder of templates, ending in `.html.jinja` or `.md.jinja`.
        folder: Folder of templates; default: `templates` of this package.
        values: What the template uses; a name that it uses and that is not given is an error.
    """
    text = _environment(folder).get_template(template).render(**values)
    if template.endswith(MARKDOWN):  # blocks are one empty line apart, wherever the template's statements stood
        text = re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"
    return text


@functools.cache
def _environment(folder: Path | None) -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("creative_nao.evaluation") if folder is None else jinja2.FileSystemLoader(folder),
        autoescape=jinja2.select_autoescape(["html.jinja"], default=False),
        undefined=jinja2.StrictUndefined,
        finalize=_visible,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "md": md, "code": code, "interval": interval, "span": span, "thousands": "{:,}".format,
        "paragraph": paragraph, "bullet": bullet,
    }  # fmt: skip
    return environment


def _visible(value: Any) -> Any:
    """Replace control characters, marks of direction and other invisible characters in text."""
    if not isinstance(value, str) or value.isprintable():
        return value
    return type(value)("".join("\N{REPLACEMENT CHARACTER}" if _is_hidden(letter) else letter for letter in value))


def _is_hidden(letter: str) -> bool:
    return letter not in "\n\t" and unicodedata.category(letter) in ("Cc", "Cf", "Cs", "Zl", "Zp")


def md(text: str) -> str:
    r"""Return text from a file as it may stand in a sentence or table cell of Markdown, without any markup in it.

    Example:
        >>> md("a|b <script>")
        'a\\|b &lt;script&gt;'
    """
    return " ".join(_visible(str(text)).split()).translate(_MARKUP)


def code(text: str) -> str:
    """Return text as a code span of Markdown; backticks within it need longer ones around it."""
    text = " ".join(_visible(str(text)).split())
    longest = max(map(len, re.findall("`+", text)), default=0)
    fence, gap = "`" * (longest + 1), " " if longest else ""
    return f"{fence}{gap}{text}{gap}{fence}"


def paragraph(text: str) -> str:
    """Return sentences as one wrapped paragraph of Markdown and an empty line."""
    return _wrapped(text, "", "") + "\n\n"


def bullet(text: str) -> str:
    """Return sentences as one wrapped item of a Markdown list."""
    return _wrapped(text, "- ", "  ") + "\n"


def _wrapped(text: str, first: str, others: str) -> str:
    wrapper = textwrap.TextWrapper(
        WIDTH, initial_indent=first, subsequent_indent=others, break_long_words=False, break_on_hyphens=False
    )
    return wrapper.fill(" ".join(text.split()))


def interval(found: Mapping[str, Any] | None, digits: int, *, scale: float = 1.0, sign: str = "") -> str:
    """Return a mean with its interval as text; a dash where there is none.

    Args:
        found: `mean`, `low` and `high`.
        digits: Behind the point.
        scale: Factor, such as 100 for a percentage.
        sign: `+` shows the sign of positive figures too.

    Example:
        >>> interval({"mean": 0.5, "low": 0.25, "high": 0.75}, 1, scale=100.0)
        '50.0 [25.0, 75.0]'
    """
    if found is None:
        return DASH
    mean = f"{scale * found['mean']:{sign}.{digits}f}"
    return mean if found["low"] is None else f"{mean} {span(found, digits, scale=scale, sign=sign)}"


def span(found: Mapping[str, Any], digits: int, *, scale: float = 1.0, sign: str = "") -> str:
    """Return an interval alone as text; the arguments are those of `interval`."""
    if found["low"] is None:
        return "unknown"
    return f"[{scale * found['low']:{sign}.{digits}f}, {scale * found['high']:{sign}.{digits}f}]"


def data_uri(path: Path) -> str:
    """Return a PNG or SVG file as a data URI, for pages that load nothing."""
    return f"data:{IMAGE_TYPES[path.suffix]};base64,{base64.b64encode(path.read_bytes()).decode('ascii')}"
