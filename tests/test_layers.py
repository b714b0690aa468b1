"""Imports run one way: a part may import what stands to its right, never to its left."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "creative_nao"
BASE = {"joints", "errors", "storage", "runtime", "fields", "schema", "arrays"}
ORDER = [
    "cli",
    "explorer",
    "evaluation",
    "agents",
    "testing",
    "envs",
    "maps",
    "model",
    "exchange",
    "demonstrations",
    "measures",
    "robot",
]
MAY_IMPORT = {part: set(ORDER[place + 1 :]) | BASE for place, part in enumerate(ORDER)}
MAY_IMPORT["measures"] = BASE  # siblings: measures and robot know nothing of each other
MAY_IMPORT["demonstrations"] = {"robot"} | BASE
MAY_IMPORT["exchange"] = {"demonstrations"} | BASE
MAY_IMPORT["robot"] = BASE


def imported_parts(path: Path) -> set[str]:
    parts = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative imports hide the direction; write the whole name"
            if node.module == "creative_nao":
                parts |= {alias.name for alias in node.names}
            elif node.module and node.module.startswith("creative_nao."):
                parts.add(node.module.split(".")[1])
        elif isinstance(node, ast.Import):
            parts |= {alias.name.split(".")[1] for alias in node.names if alias.name.startswith("creative_nao.")}
    return parts


FILES = sorted(PACKAGE.glob("*/**/*.py"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_part_imports_only_what_stands_to_its_right(path):
    part = path.relative_to(PACKAGE).parts[0]
    foreign = imported_parts(path) - {part, "__version__"}
    assert foreign <= MAY_IMPORT[part], f"{path} imports {sorted(foreign - MAY_IMPORT[part])}"


@pytest.mark.parametrize("name", sorted(BASE))
def test_the_base_stands_on_nothing_of_the_project(name):
    assert imported_parts(PACKAGE / f"{name}.py") <= BASE


def test_every_folder_is_in_the_order():
    folders = {path.name for path in PACKAGE.iterdir() if path.is_dir() and path.name != "__pycache__"}
    assert folders <= set(ORDER)
