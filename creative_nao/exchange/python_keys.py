"""Key lists out of a Python file as Choregraphe exports it, or as `naoqi_script.py` writes it. The file is never run.

Only assignments to `names`, `times` and `keys` (or `angles`) and their `.append(...)` calls are looked at, in the order
of the lines and wherever they stand; what they hold must be literals.
"""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

from creative_nao.errors import FileFormatError
from creative_nao.exchange import reading
from creative_nao.exchange.key_lists import keys_of
from creative_nao.exchange.keys import Keys

MAX_PYTHON_BYTES = 2_000_000
"""A syntax tree takes a hundred times the room of its text."""

_LISTS = {
    "names": "names", "jointNames": "names", "joint_names": "names",
    "times": "times", "timeLists": "times", "time_lists": "times",
    "keys": "keys", "angles": "keys", "angleLists": "keys", "angle_lists": "keys",
}  # fmt: skip
"""Names under which the three lists are known."""


def read_python(path: Path, content: bytes) -> Keys:
    """Read the three lists of a Python file without running it.

    Raises:
        FileFormatError: If it is not Python, or a list is missing, given twice, or not made of literals.
    """
    if len(content) > MAX_PYTHON_BYTES:
        raise FileFormatError(
            f"{path}: has {len(content)} bytes, expected at most {MAX_PYTHON_BYTES} of a Python file."
        )
    text = _without_print_statements(reading.as_text(path, content))
    try:
        tree = ast.parse(text)
        found = _gathered(path, tree)
    except (SyntaxError, ValueError, RecursionError, MemoryError, OverflowError) as error:
        if isinstance(error, FileFormatError):
            raise
        line = getattr(error, "lineno", None)
        place = f"line {line}: " if line else ""
        reason = "is nested too deeply" if isinstance(error, RecursionError | MemoryError) else "is not Python text"
        raise FileFormatError(f"{path}: {place}{reason} ({str(error)[:80]}).") from None
    missing = [name for name in ("names", "times", "keys") if not found.get(name)]
    if missing:
        raise FileFormatError(
            f"{path}: no list of {' and '.join(missing)}; expected names, times and keys (or angles)."
        )
    return keys_of(path, found["names"], found["times"], found["keys"])


def _gathered(path: Path, tree: ast.Module) -> dict[str, list[Any]]:
    """Return what is assigned and appended to the three lists, in the order of the lines."""
    found: dict[str, list[Any]] = {}
    statements = [node for node in ast.walk(tree) if isinstance(node, ast.Assign | ast.AnnAssign | ast.Expr)]
    for node in sorted(statements, key=lambda node: node.lineno):
        if isinstance(node, ast.Expr):
            call = node.value
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute) and call.func.attr == "append":
                name = _list_name(call.func.value)
                if name and len(call.args) == 1:
                    found.setdefault(name, []).append(_literal(path, call.args[0], name))
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        for name in filter(None, map(_list_name, targets)):
            if found.get(name):
                raise FileFormatError(
                    f"{path}: line {node.lineno}: `{name}` begins anew; the file holds more than one movement, "
                    "keep one."
                )
            found[name] = [] if node.value is None or _is_empty(node.value) else _list(path, node.value, name)
    return found


def _list_name(node: ast.expr) -> str:
    name = node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""
    return _LISTS.get(name, "")


def _is_empty(node: ast.expr) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "list" and not node.args


def _list(path: Path, node: ast.expr, name: str) -> list[Any]:
    return reading.listed(_literal(path, node, name), path, f"line {node.lineno}: `{name}`")


def _literal(path: Path, node: ast.expr, name: str) -> Any:
    try:
        return ast.literal_eval(node)
    except (ValueError, TypeError, SyntaxError):
        raise FileFormatError(
            f"{path}: line {node.lineno}: `{name}` should hold plain numbers and texts, but holds an expression; "
            "it is not run."
        ) from None


def _without_print_statements(text: str) -> str:
    """Make exports written for Python 2 readable: their `print err` and `except X, err` are no syntax today."""
    lines = text.splitlines()
    for place, line in enumerate(lines):
        bare = line.strip()
        space = line[: len(line) - len(line.lstrip())]
        if bare.startswith("print ") and not bare.startswith("print ("):
            lines[place] = f"{space}pass"
        elif bare.startswith("except ") and bare.endswith(":") and "," in bare and "(" not in bare:
            lines[place] = f"{space}except Exception:"
    return "\n".join(lines)
