"""Write docs/api.md, the list of public names, from the packages' `__all__` and docstrings.

python docs/make_api.py
"""

import importlib
import inspect
from pathlib import Path

PACKAGES = (
    "creative_nao",
    "creative_nao.demonstrations",
    "creative_nao.model",
    "creative_nao.measures",
    "creative_nao.maps",
    "creative_nao.envs",
    "creative_nao.testing",
    "creative_nao.agents",
    "creative_nao.exchange",
    "creative_nao.robot",
)
"""The packages whose `__all__` is the public interface, in reading order."""
HEAD = """# Public names

Every name in these tables is public: it is what `from package import name` promises, and changes to it follow
[the stability policy](stability.md). Everything else may change without notice, and so may names that begin with an
underscore. `help(name)` tells shapes, units, ranges and errors. This page is written by `python docs/make_api.py`.
"""


def signature(value: object) -> str:
    """Return the arguments of a function by name and kind, without hints and defaults; nothing for other values."""
    if not inspect.isroutine(value):
        return ""
    words, keyword_only = [], False
    for argument in inspect.signature(value).parameters.values():
        if argument.kind is argument.KEYWORD_ONLY and not keyword_only:
            words.append("*")
            keyword_only = True
        star = {argument.VAR_POSITIONAL: "*", argument.VAR_KEYWORD: "**"}.get(argument.kind, "")
        keyword_only = keyword_only or star == "*"
        optional = "" if argument.default is argument.empty or star else "="
        words.append(f"{star}{argument.name}{optional}")
    return f"({', '.join(words)})"


def first_line(value: object) -> str:
    """Return the first sentence of a class's or function's docstring; for a constant, its type."""
    if inspect.ismodule(value) or inspect.isclass(value) or inspect.isroutine(value):
        return " ".join((inspect.getdoc(value) or "").split("\n\n")[0].split())
    return f"Constant, `{'Path' if isinstance(value, Path) else type(value).__name__}`."


def section(package: str) -> str:
    """Return the heading, the first line of the package's docstring and one row a public name."""
    module = importlib.import_module(package)
    rows = [f"\n## `{package}`\n", first_line(module), "", "| name | what it is |", "| --- | --- |"]
    for name in module.__all__:
        value = getattr(module, name)
        rows.append(f"| `{name}{signature(value)}` | {first_line(value).replace('|', chr(92) + '|')} |")
    return "\n".join(rows) + "\n"


def api_page() -> str:
    """Return the whole page."""
    return HEAD + "".join(section(package) for package in PACKAGES)


if __name__ == "__main__":
    Path(__file__).with_name("api.md").write_text(api_page(), encoding="utf-8")
