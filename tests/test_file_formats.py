"""Files are whole or not there."""

import stat

import numpy as np
import pytest

from creative_nao.arrays import load_tensors, save_tensors, take
from creative_nao.errors import FileFormatError, NotFoundError
from creative_nao.storage import as_yaml, replacing, write_text


def test_a_file_is_replaced_in_one_step(tmp_path):
    path = write_text(tmp_path / "deep" / "a.txt", "old")
    with replacing(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"

    assert path.read_text() == "new"
    assert stat.S_IMODE(path.stat().st_mode) & 0o444 == 0o444


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    path = write_text(tmp_path / "a.txt", "old")

    def fail():
        with replacing(path) as temporary:
            temporary.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()

    assert path.read_text() == "old"
    assert [file.name for file in tmp_path.iterdir()] == ["a.txt"]


def test_tensors_and_header_come_back(tmp_path):
    path = save_tensors(tmp_path / "t", kind="test", header={"a": [1, "x"]}, tensors={"w": np.eye(3, dtype=np.float32)})
    header, tensors = load_tensors(path, kind="test")

    assert header == {"a": [1, "x"]}
    assert np.array_equal(tensors["w"], np.eye(3))


def test_another_kind_is_refused(tmp_path):
    path = save_tensors(tmp_path / "t", kind="memory", header={}, tensors={})

    with pytest.raises(FileFormatError, match="expected kind 'checkpoint', but its header says kind 'memory'"):
        load_tensors(path, kind="checkpoint")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(NotFoundError, match=r"no memory file at .*none"):
        load_tensors(tmp_path / "none", kind="memory")


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((2, 2)), r"`w` should have shape \(any, 3\), but has \(2, 2\)"),
        (np.full((2, 3), np.inf), "`w` should hold finite numbers"),
        (np.zeros((2, 3), int), "`w` should hold floating numbers, but holds int64"),
    ],
)
def test_an_array_that_does_not_fit_is_named(array, message):
    with pytest.raises(FileFormatError, match=message):
        take("f", {"w": array}, "w", (None, 3))


def test_a_missing_array_is_named():
    with pytest.raises(FileFormatError, match="f: the array `w` is missing"):
        take("f", {}, "w", (1,))


def test_equal_content_gives_equal_bytes(tmp_path):
    tensors = {name: np.full(3, k, dtype=np.float32) for k, name in enumerate("abcdefgh")}
    files = [save_tensors(tmp_path / name, kind="test", header={"x": 1}, tensors=tensors) for name in ("a", "b", "c")]

    assert len({file.read_bytes() for file in files}) == 1


def test_yaml_is_read_as_safe_loader_does_but_for_exponents():
    text = "a: {b: [1, 2.5, true, null, text], c: 1e-05}\nd: &x [1]\ne: *x\nf:\n- {<<: {g: 1}, g: 2}\n"
    assert as_yaml(text, "f") == {
        "a": {"b": [1, 2.5, True, None, "text"], "c": 1e-05}, "d": [1], "e": [1], "f": [{"g": 2}],
    }  # fmt: skip
    assert as_yaml("", "f") is None
    assert as_yaml("1_0", "f") == 10


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [1", r"f: not YAML \(.*flow sequence"),
        ("a: !!python/object/apply:os.system ['touch ran']", "f: not YAML .*could not determine a constructor"),
        ("a: 1\nb: {c: 1, c: 2}", "f: line 2: `c` is there already"),
        ("a: " + "[" * 70 + "]" * 70, "f: not YAML .*nested too deeply"),
        ("a: " + "[" * 100_000, "f: not YAML .*nest"),
        ("&a [*a]", "f: its anchors and aliases unfold to more than 250000 values"),
        ("".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9) if k else 1}]\n" for k in range(9)), "unfold to more"),
        ("a: [" + "[1]," * 150_000 + "]", "f: not YAML .*more than 250000 values"),
        ("a: " + "x" * 2_000_000, "f: has 2000003 characters, expected at most 2000000 of YAML"),
        ("--- 1\n--- 2\n", "f: not YAML"),
        ("a: 2001-99-99", "f: not YAML"),
    ],
)
def test_yaml_that_would_cost_or_mislead_is_refused(text, message):
    with pytest.raises(FileFormatError, match=message):
        as_yaml(text, "f")
