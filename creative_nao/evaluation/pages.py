"""Generated pages and tables: Jinja templates hold the sentences, Python gives the figures.

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
from typing import Any, NamedTuple

import jinja2
from rich.table import Table

WIDTH = 120
"""Columns of wrapped Markdown."""
DASH = "\N{EN DASH}"
"""Stands where there is no figure."""
MARKDOWN = ".md.jinja"
IMAGE_TYPES = {".png": "image/png", ".svg": "image/svg+xml"}
CONTENT_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'"
"""Of a page that runs no script and loads nothing; templates know it as `csp`."""
_MARKUP = str.maketrans({mark: f"\\{mark}" for mark in "\\`|*[]~#"} | {"<": "&lt;", ">": "&gt;", "&": "&amp;"})
_BLOCK = re.compile(r"(?<!\S)(\d*)([-+=]+|[.)])(?!\S)")
"""Words that begin a list, a rule or a heading where a line begins with them."""


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
    environment.globals["csp"] = CONTENT_POLICY
    environment.filters |= {
        "imagined_per_performed": imagined_per_performed, "worth": worth,
        "md": md, "code": code, "interval": interval, "span": span, "thousands": "{:,}".format,
        "paragraph": _wrapped, "bullet": functools.partial(_wrapped, first="- ", others="  ", after="\n"),
    }  # fmt: skip
    return environment


def _visible(value: Any) -> Any:
    """Replace control characters, marks of direction and other invisible characters in text."""
    if not isinstance(value, str) or value.isprintable():
        return value
    hidden = {x for x in value if x not in "\n\t" and unicodedata.category(x) in ("Cc", "Cf", "Cs", "Zl", "Zp")}
    return type(value)("".join("\N{REPLACEMENT CHARACTER}" if letter in hidden else letter for letter in value))


def md(text: str) -> str:
    r"""Return text from a file as it may stand in a sentence or table cell of Markdown, without any markup in it.

    Example:
        >>> md("a|b <script>")
        'a\\|b &lt;script&gt;'
    """
    return _BLOCK.sub(r"\1\\\2", " ".join(_visible(str(text)).split()).translate(_MARKUP))


def code(text: str) -> str:
    """Return text as a code span of Markdown; backticks within it need longer ones around it."""
    text = " ".join(_visible(str(text)).split())
    longest = max(map(len, re.findall("`+", text)), default=0)
    fence, gap = "`" * (longest + 1), " " if longest else ""
    return f"{fence}{gap}{text}{gap}{fence}"


def _wrapped(text: str, first: str = "", others: str = "", after: str = "\n\n") -> str:
    wrapper = textwrap.TextWrapper(WIDTH, first, others, break_long_words=False, break_on_hyphens=False)
    return wrapper.fill(" ".join(text.split())) + after


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


class Column(NamedTuple):
    """A column of measures; what it means is told in `report.html.jinja`."""

    title: str
    field: str
    digits: int


MEASURED_COLUMNS = (
    Column("appropriate [%]", "appropriateness_pct", 1),
    Column("novelty [rad]", "novelty", 1),
    Column("diversity [rad]", "diversity", 1),
    Column("reward", "reward", 2),
    Column("of oracle [%]", "oracle_share", 1),
    Column("regret", "regret", 2),
    Column("best", "best", 2),
    Column("coverage [%]", "coverage_pct", 1),
    Column("refused [%]", "refused_pct", 1),
)
FIGURE_TITLES = {
    "appropriate_pct": "appropriate [%]",
    "learned_pct": "learned [%]",
    "novelty": "novelty [rad]",
    "diversity": "diversity [rad]",
}
"""The paper's four figures of a map."""
TITLES = ("track", *(column.title.replace(" [", "\n[") for column in MEASURED_COLUMNS), "performed", "seconds")
SUMMARY_TITLES = (
    "track",
    "imagined for\neach performed",
    "reward\n(mean)",
    "worth\nimaginings",
    "reward\n(IQM)",
    "of oracle\n[%]",
    "over\nbaseline",
    "beats\nbaseline [%]",
    "ahead on",
    "actions in\ntraining",
)
SHORT_ENV = {
    "CreativeNao/Boxing-v0": "physical",
    "CreativeNao/BoxingMental-v0": "mental",
    "CreativeNao/BoxingMental-v1": "mental, every try observed",
    "CreativeNao/BoxingModulation-v0": "modulation",
}


def env_label(env: str) -> str:
    """Return an environment's name in words: `physical`, `mental`, or the name itself."""
    return SHORT_ENV.get(env, env.rpartition("/")[2])


def figure(row: Mapping[str, Any], column: Column) -> tuple[str, str]:
    """Return mean and interval of a row's field as text; a dash where there is none."""
    scale = 100.0 if column.field == "oracle_share" else 1.0
    mean, _, below = interval(row.get(column.field), column.digits, scale=scale).partition(" ")
    return mean, below


def cells(row: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the cells of a row after agent and environment: a figure each, and what stands below it."""
    trained, seconds, imagined = row["n_actions_training"], row["seconds_training"], row.get("n_imagined", 0.0)
    further = [f"+ {imagined:,.0f} imagined"] * (imagined > 0) + [f"+ {trained:,} training"] * (trained > 0)
    return [
        (row.get("track", DASH), ""),
        *(figure(row, column) for column in MEASURED_COLUMNS),
        (str(row["n_actions"]), " ".join(further)),
        (f"{row['seconds']:.1f}", f"+ {seconds:.0f} training" if seconds else ""),
    ]


def summary_cells(entry: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the cells of an entry of the summary after agent and environment, as `cells`."""
    versus = entry["versus"]
    texts = [
        interval(entry["reward"], 2),
        worth(entry),
        interval(entry["reward_iqm"], 2),
        interval(entry["oracle_share"], 1, scale=100.0),
        interval(versus and versus["difference"], 2, sign="+"),
        interval(versus and versus["probability_of_improvement"], 0, scale=100.0),
    ]
    return [
        (entry.get("track") or DASH, ""),
        (imagined_per_performed(entry), ""),
        *((mean, below) for mean, _, below in (text.partition(" ") for text in texts)),
        (f"{versus['n_memories_ahead']} of {entry['n_memories']}" if versus else DASH, ""),
        (f"{entry['n_actions_training']:,}", ""),
    ]


def imagined_per_performed(entry: Mapping[str, Any]) -> str:
    """Return how many movements an agent imagined for each that it performed; a dash where a file does not tell."""
    if (n_imagined := entry.get("n_imagined")) is None:
        return DASH
    return f"{n_imagined / entry['n_actions']:.3g}" if entry.get("n_actions") else DASH


def worth(entry: Mapping[str, Any]) -> str:
    """Return how many imagined candidates an agent is worth as text; at the ends of the curve as a bound."""
    if (found := entry.get("worth")) is None:
        return DASH
    last = entry["worth_most"]
    if mark := {1.0: "at most ", float(last): "at least "}.get(round(found["mean"], 9), ""):
        return f"{mark}{found['mean']:.0f}"
    return interval(found, 1)


def terminal_table(results: Mapping[str, Any]) -> Table:
    """Return the table for a terminal: row by row for one memory, over all of them for several."""
    rows = results["rows"]
    memories = list(dict.fromkeys(row["memory"] for row in rows))
    several = len(memories) > 1
    subject = f"{len(memories)} memories" if several else f"memory {memories[0]}"
    table = Table(
        title=f"Suite {results['suite']}: {subject}, {rows[0]['n_seeds']} seeds, {rows[0]['n_actions']} actions each",
        caption="Over memories and seeds, 95 % stratified bootstrap intervals below; IQM: mean of the middle half. "
        "What each memory gave stands in results.json."
        if several
        else "Mean over seeds with its 95 % interval below; an action is one performed movement.",
    )
    table.add_column("agent", style="bold")
    table.add_column("environment")
    for title in SUMMARY_TITLES if several else TITLES:
        table.add_column(title, justify="right")
    entries = results["summary"] if several else rows
    for place, entry in enumerate(entries):
        last = place + 1 == len(entries) or entries[place + 1]["env"] != entry["env"]
        texts = ["\n".join(filter(None, cell)) for cell in (summary_cells if several else cells)(entry)]
        table.add_row(entry["agent"], env_label(entry["env"]), *texts, end_section=last)
    return table


def conditions_table(results: Mapping[str, Any]) -> Table:
    """Return the paper's figures condition by condition for a terminal; `results` has `conditions`."""
    table = Table(
        title="Memories by condition: maps, means over seeds and sets with 95 % intervals below",
        caption="Back: memories that give every basic action back. Set by set and the differences: results.json.",
    )
    table.add_column("condition", style="bold")
    for title in ("back", *FIGURE_TITLES.values()):
        table.add_column(title, justify="right")
    for entry in results["conditions"]:
        texts = (interval(entry["figures"][key], 1).replace(" ", "\n", 1) for key in FIGURE_TITLES)
        table.add_row(entry["condition"], f"{entry['n_recalled']} of {entry['n_memories']}", *texts)
    return table


def markdown_table(results: Mapping[str, Any]) -> str:
    """Return the table as Markdown, a line per row."""
    rows = [(row["agent"], env_label(row["env"]), row["memory"], cells(row)) for row in results["rows"]]
    several = len({row["memory"] for row in results["rows"]}) > 1
    return render("table.md.jinja", titles=[column.title for column in MEASURED_COLUMNS], several=several, rows=rows)
