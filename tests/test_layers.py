"""Imports run one way, between rooms and between files: a room imports only what stands to its right."""

import ast
from pathlib import Path

import pytest
import structure

PACKAGE = Path(__file__).parents[1] / "creative_nao"
BASE = {"joints", "errors", "storage", "runtime", "schema", "arrays"}
ORDER = [
    "cli",
    "explorer",
    "evaluation",
    "agents",
    "testing",
    "envs",
    "maps",
    "model",
    "demonstrations",
    "exchange",
    "measures",
    "robot",
]
MAY_IMPORT = {part: set(ORDER[place + 1 :]) | BASE for place, part in enumerate(ORDER)}
MAY_IMPORT["measures"] = BASE  # siblings: measures and robot know nothing of each other
MAY_IMPORT["demonstrations"] = {"exchange", "robot"} | BASE
MAY_IMPORT["exchange"] = {"robot"} | BASE
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


def test_no_files_import_each_other_in_a_circle():
    assert structure.circles(structure.import_graph(PACKAGE.parent)) == []


def test_no_class_name_is_in_two_places():
    assert structure.repeated_class_names(PACKAGE.parent) == {}


def test_a_circle_below_type_checking_or_in_a_function_is_found(tmp_path):
    room = tmp_path / structure.PACKAGE
    room.mkdir()
    (room / "first.py").write_text("if TYPE_CHECKING:\n    from creative_nao.second import Second\nclass First: ...\n")
    (room / "second.py").write_text("def late():\n    from creative_nao import third\n")
    (room / "third.py").write_text("import creative_nao.first\nclass First: ...\n")
    ring = ["creative_nao.first", "creative_nao.second", "creative_nao.third"]
    assert structure.circles(structure.import_graph(tmp_path)) == [ring]
    assert structure.repeated_class_names(tmp_path) == {"First": ["creative_nao.first", "creative_nao.third"]}


def test_the_package_keeps_its_size():
    """At most 160 files, 34,260 lines, none above 450: a new file or mechanism takes the place of another.

    The restructured package had 134 files and 26,836 lines; the rest is room for what came after it: the benchmark of
    imagination, recordings of people and robots, and agents that learn what memories look like: a network, the truth
    that it is taught, its training, movements of several PB vectors, and a sense of what the body refuses.
    """
    lines = [n for room in structure.rooms(PACKAGE.parent).values() for n in room]
    assert (len(lines) <= 160, sum(lines) <= 34_260, max(lines) <= 450) == (True, True, True)


def test_no_two_test_files_share_a_name():
    """Without packages among the tests, pytest cannot collect two files of one name."""
    names = [path.name for path in Path(__file__).parent.rglob("test_*.py")]
    assert sorted(names) == sorted(set(names))
