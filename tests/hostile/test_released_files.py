"""What release 0.1.0 wrote is still read, and holds what the present release would write."""

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest
from victims import FOREIGN, KINDS, SINCE

FOLDER = Path(__file__).parents[1] / "released_files"
MADE_ANEW = {"record", "versions", "command", "created", "machine", "taught", "path", "source", "policy"}
"""Parts that tell when, where and by which versions a file was made, or are drawn at random."""


def parts(value):
    """Return the plain parts of a loaded object: names of fields or places with what stands there."""
    if dataclasses.is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    elif not isinstance(value, dict) and hasattr(value, "__dict__"):
        value = vars(value)
    if isinstance(value, dict):
        return {name: inner for name, inner in value.items() if name not in MADE_ANEW}
    return dict(enumerate(value)) if isinstance(value, list | tuple) else None


def check_same(old, new, where):
    if isinstance(new, np.ndarray):
        assert np.array_equal(old, new), where
    elif (inner := parts(new)) is not None:
        found = parts(old)
        assert found is not None, where
        assert found.keys() == inner.keys(), where
        for name in inner:
            check_same(found[name], inner[name], f"{where}.{name}")
    else:
        both_nan = old != old and new != new
        named_by_file = isinstance(new, str) and Path(new).is_file()  # a memory may be
        assert old == new or both_nan or named_by_file, where


def test_there_is_a_file_of_each_kind():
    assert {path.stem for path in FOLDER.iterdir()} - {"README"} == set(KINDS) - set(FOREIGN) - set(SINCE)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in (*FOREIGN, *SINCE)])
def test_a_released_file_is_read(kind, victims, tmp_path):
    victim = victims[kind]
    path = tmp_path / victim.path.name
    shutil.copy(next(FOLDER.glob(f"{kind}.*")), path)
    old, new = victim.load(path), victim.load(victim.path)
    victim.use(old)
    check_same(old, new, kind)
