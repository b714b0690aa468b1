"""What the fuzzer has found once is read or refused by name for ever; and no reader of files is left untried."""

import ast
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from mutations import mutate
from test_broken_bytes import refused
from victims import KINDS, OWN_FILES, READERS, WRITERS

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
FOUND = sorted((HERE / "corpus").glob("*/*"))
OURS = {"read_bytes", "read_text", "read_json", "read_npz", "unpack_npz", "load_tensors", "load_json"}
BASE = {"creative_nao/storage.py", "creative_nao/arrays.py", "creative_nao/schema.py"}
DIRECT = {"open", "read_text", "read_bytes", "load", "fromfile", "loadtxt", "genfromtxt", "load_file", "read_csv"}
LOADERS = {"np", "numpy", "json", "torch", "yaml", "pickle", "tomllib", "safetensors", "joblib", "marshal"}


@pytest.mark.parametrize("path", FOUND, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_what_was_found_once_stays_mended(path, victims, tmp_path):
    broken = tmp_path / f"found-{victims[path.parent.name].path.name}"
    broken.write_bytes(path.read_bytes())
    refused(victims[path.parent.name], broken)


@pytest.mark.parametrize("kind", KINDS)
def test_a_moment_of_fuzzing_finds_nothing(kind, victims, tmp_path):
    rng = np.random.default_rng([11, KINDS.index(kind)])
    whole, path = victims[kind].path.read_bytes(), tmp_path / f"fuzzed-{victims[kind].path.name}"
    others = [victim.path.read_bytes() for victim in victims.values()]
    for _ in range(60):
        path.write_bytes(mutate(whole, others, rng))
        refused(victims[kind], path)


def readers(path):
    """Return the names by which a module reads files: through the project's own readers, and directly."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    imported = {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("creative_nao")
        for alias in node.names
    }
    calls = [node.func for node in ast.walk(tree) if isinstance(node, ast.Call)]
    ours, direct = set(), set()
    for call in calls:
        name = call.id if isinstance(call, ast.Name) else call.attr if isinstance(call, ast.Attribute) else ""
        owner = call.value.id if isinstance(call, ast.Attribute) and isinstance(call.value, ast.Name) else ""
        if name in OURS and (name in imported or owner in ("storage", "arrays", "schema")):
            ours.add(name)
        elif isinstance(call, ast.Name) and name == "open":
            direct.add(name)
        elif isinstance(call, ast.Attribute) and name in DIRECT and (name != "load" or owner in LOADERS):
            direct.add(f"{owner}.{name}")
    return ours, direct


@cache
def modules():
    paths = sorted((ROOT / "creative_nao").rglob("*.py"))
    return [(path.relative_to(ROOT).as_posix(), readers(path)) for path in paths]


def test_every_reader_is_tried():
    """A loader that is added has to come with a kind in `victims.py`, or with the reason why it needs none."""
    through = {name for name, (ours, _) in modules() if ours} - BASE
    assert through - set(OWN_FILES) == set(READERS) - set(OWN_FILES)  # a file may also read what is its own
    assert {kind for kinds in READERS.values() for kind in kinds} | {"motion_ros_json"} == set(KINDS)


def test_no_other_module_opens_files():
    direct = {name for name, (_, names) in modules() if names} - BASE
    assert direct - set(WRITERS) - set(OWN_FILES) == set()
    through = {name for name, (ours, _) in modules() if ours}
    assert set(OWN_FILES) <= direct | through, "what opens no file any more needs no reason"


def test_the_check_of_the_checkers_would_notice(tmp_path):
    path = tmp_path / "new.py"
    path.write_text(
        "from creative_nao.storage import read_text\nfrom creative_nao import arrays\nimport numpy as np\n"
        "read_text(p, 'x')\narrays.read_npz(p)\nopen(p)\nnp.load(p)\np.read_bytes()\n"
    )
    assert readers(path) == ({"read_text", "read_npz"}, {"open", "np.load", "p.read_bytes"})
