"""The structure of the package in numbers: files, lines, circles of files and class names, room by room.

    python benchmarks/structure.py                     # this tree
    python benchmarks/structure.py --before v0.1.0     # beside another commit, tag or branch of this repository

A room is a folder of `creative_nao/`; files at its top are the room `base`. A circle is a group of files that import
each other in a ring; every import counts, also one inside a function or below `if TYPE_CHECKING`.
"""

from __future__ import annotations

import argparse
import ast
import io
import statistics
import subprocess
import tarfile
import tempfile
from collections import defaultdict
from pathlib import Path

PACKAGE = "creative_nao"


def module_files(root: Path) -> dict[str, Path]:
    """Return every file of the package below `root` by its dotted module name."""
    names = {}
    for path in sorted((root / PACKAGE).rglob("*.py")):
        parts = path.relative_to(root).with_suffix("").parts
        names[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return names


def import_graph(root: Path) -> dict[str, set[str]]:
    """Return which modules each module imports; an `__init__` is followed only where it is imported for a submodule."""
    files = module_files(root)
    packages = {name for name, path in files.items() if path.name == "__init__.py"}
    graph: dict[str, set[str]] = {}
    for name, path in files.items():
        imported = set()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                imported |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
                for alias in node.names:
                    full = f"{node.module}.{alias.name}"
                    imported.add(full if full in files else node.module)
        graph[name] = (imported & set(files)) - packages - {name}
    return graph


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Return the groups of more than one module that reach each other (Tarjan's strongly connected components)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for successor in sorted(graph[node]):
            if successor not in index:
                visit(successor)
                low[node] = min(low[node], low[successor])
            elif successor in stack:
                low[node] = min(low[node], index[successor])
        if low[node] == index[node]:
            group = stack[stack.index(node) :]
            del stack[stack.index(node) :]
            if len(group) > 1:
                found.append(sorted(group))

    for node in graph:
        if node not in index:
            visit(node)
    return found


def repeated_class_names(root: Path) -> dict[str, list[str]]:
    """Return the class names that are defined in more than one module, with those modules."""
    homes = defaultdict(list)
    for name, path in module_files(root).items():
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef):
                homes[node.name].append(name)
    return {name: modules for name, modules in homes.items() if len(modules) > 1}


def rooms(root: Path) -> dict[str, list[int]]:
    """Return the number of lines of each file of every room."""
    found = defaultdict(list)
    for name, path in module_files(root).items():
        parts = name.split(".")
        is_room = len(parts) > 2 or (len(parts) == 2 and path.name == "__init__.py")
        found[parts[1] if is_room else "base"].append(len(path.read_text(encoding="utf-8").splitlines()))
    return dict(sorted(found.items()))


def _row(name: str, lines: list[int]) -> str:
    if not lines:
        return f"{name:<16}" + f"{'-':>7}" * 4
    return f"{name:<16}{len(lines):>7}{sum(lines):>7}{statistics.median(lines):>7.0f}{max(lines):>7}"


def _describe(before: Path | None, now: Path) -> str:
    trees = [tree for tree in (before, now) if tree is not None]
    counted = [rooms(tree) for tree in trees]
    head = f"{'room':<16}" + "".join(f"{column:>7}" for column in ("files", "lines", "median", "max"))
    out = []
    if before is not None:
        out.append(" " * 16 + f"{'before':>28}{'now':>28}")
        head += head[16:]
    out.append(head)
    for name in sorted({room for count in counted for room in count}):
        out.append(_row(name, counted[0].get(name, [])) + "".join(_row("", c.get(name, []))[16:] for c in counted[1:]))
    totals = [[n for lines in count.values() for n in lines] for count in counted]
    out.append(_row("all", totals[0]) + "".join(_row("", total)[16:] for total in totals[1:]))
    titles = ("now",) if before is None else ("before", "now")
    for title, tree in zip(titles, trees, strict=True):
        rings, repeated = circles(import_graph(tree)), repeated_class_names(tree)
        out.append(f"{title}: {len(rings)} circles of files, {len(repeated)} class names in two places")
        if tree is now:
            out += [f"  circle: {', '.join(ring)}" for ring in rings]
            out += [f"  class {name}: {', '.join(modules)}" for name, modules in repeated.items()]
    return "\n".join(out)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", metavar="COMMIT", help="a commit of this repository to count beside this tree")
    arguments = parser.parse_args()
    root = Path(__file__).resolve().parents[1]
    if arguments.before is None:
        print(_describe(None, root))
        return
    command = ["git", "-C", str(root), "archive", "--format=tar", arguments.before, PACKAGE]
    content = subprocess.run(command, check=True, capture_output=True).stdout
    with tempfile.TemporaryDirectory() as folder, tarfile.open(fileobj=io.BytesIO(content)) as archive:
        archive.extractall(folder, filter="data")
        print(_describe(Path(folder), root))


if __name__ == "__main__":
    main()
