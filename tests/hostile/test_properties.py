"""Properties: what is written comes back, and any bytes at all are read or refused by name, in bounded time."""

import contextlib
import json
import string

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from mutations import change_tree
from test_broken_bytes import refused
from victims import JSONS, KINDS, TEXTS

from creative_nao.arrays import load_tensors, read_npz, save_tensors
from creative_nao.errors import CreativeNaoError, FileFormatError, SettingsError, shown
from creative_nao.schema import (
    Count,
    JsonObject,
    Names,
    PlainName,
    Text,
    UnitInterval,
    Versions,
    checked,
    parse,
    record,
)
from creative_nao.storage import MAX_DEPTH, as_json, as_text

FAST = settings(
    deadline=None,  # time is bounded where a loader is called, on the processor: a busy machine is no fault of it
    max_examples=20,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
NAMES = st.text(string.ascii_letters + string.digits + "_./", min_size=1, max_size=20)
ARRAYS = st.sampled_from(["f4", "f8", "i4", "i8", "u1", "bool"]).flatmap(
    lambda dtype: arrays(dtype, array_shapes(min_dims=1, max_dims=3, max_side=4))
)
WHOLE = st.integers(-(10**38), 10**38)
PLAIN = st.recursive(
    st.none() | st.booleans() | WHOLE | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)


@FAST
@given(header=st.dictionaries(NAMES.filter(lambda name: name != "kind"), PLAIN, max_size=4),
       tensors=st.dictionaries(NAMES, ARRAYS, max_size=4))  # fmt: skip
def test_header_and_arrays_come_back_to_the_bit(header, tensors, tmp_path):
    path = save_tensors(tmp_path / "f", kind="test", header=header, tensors=tensors)
    told, found = load_tensors(path, kind="test")
    assert told == header
    assert found.keys() == tensors.keys()
    for name, array in tensors.items():
        assert found[name].dtype == array.dtype
        assert found[name].shape == array.shape
        assert found[name].tobytes() == array.tobytes()


@FAST
@given(tensors=st.dictionaries(st.text(string.ascii_letters, min_size=1, max_size=9), ARRAYS, min_size=1, max_size=4))
def test_arrays_of_an_archive_come_back_to_the_bit(tensors, tmp_path):
    path = tmp_path / "f.npz"
    np.savez(path, **tensors)
    found = read_npz(path, "test")
    assert {name: (a.dtype, a.shape, a.tobytes()) for name, a in found.items()} == {
        name: (a.dtype, a.shape, a.tobytes()) for name, a in tensors.items()
    }


@FAST
@given(value=PLAIN)
def test_json_comes_back(value):
    assert as_json(json.dumps(value), "f") == value


@FAST
@given(depth=st.integers(1, 3 * MAX_DEPTH))
def test_json_is_read_down_to_its_depth_and_no_deeper(depth):
    text = "[" * depth + "]" * depth
    if depth <= MAX_DEPTH:
        assert as_json(text, "f") is not None
    else:
        with pytest.raises(FileFormatError, match="nested too deeply"):
            as_json(text, "f")


def said(call):
    """Return the message of the error that a call raises, and a good one if it raises none."""
    try:
        call()
    except FileFormatError as error:
        return str(error)
    return "f: good"


@FAST
@given(content=st.binary(max_size=200))
def test_any_bytes_are_json_or_a_named_error(content):
    assert said(lambda: as_json(as_text(content, "f", "text"), "f")).startswith("f: ")


@record
class Inner:
    """A record within another."""

    n: Count


KINDS_OF_FIELDS = {
    Count: int, UnitInterval: float, bool: bool, Text: str, PlainName: str, Names: tuple, JsonObject: dict,
    Versions: dict, tuple[float, ...]: tuple, tuple[Inner, ...]: tuple, Inner: Inner,
}  # fmt: skip


@FAST
@given(value=PLAIN)
def test_every_field_gives_its_kind_or_a_named_error(value):
    for kind, made in KINDS_OF_FIELDS.items():
        taken = []
        words = said(lambda kind=kind, taken=taken: taken.append(parse(kind, {"a": value}["a"], "f")))
        assert words.startswith("f")
        assert all(type(one) is made for one in taken)
        with contextlib.suppress(SettingsError):
            assert type(checked(kind, value, "a")) is made


@FAST
@given(value=PLAIN | st.lists(WHOLE, max_size=100) | st.text(min_size=100), name=st.text())
def test_a_message_is_one_short_line_that_can_be_seen(value, name):
    assert len(shown(value)) <= 120
    text = str(CreativeNaoError(f"{name}{shown(value)}\x1b[2J\n{'x' * 2_000}"))
    assert text.isprintable()
    assert len(text) <= 990
    with contextlib.suppress(SettingsError):
        assert not set(checked(PlainName, name, "name")) & set("/\\:\n\0")


@pytest.mark.parametrize("kind", KINDS)
def test_any_bytes_are_read_or_refused(kind, victims, tmp_path):
    path = tmp_path / f"any-{victims[kind].path.name}"

    @settings(FAST, max_examples=8)
    @given(content=st.binary(max_size=300))
    def holds(content):
        path.write_bytes(content)
        refused(victims[kind], path)

    holds()


@pytest.mark.parametrize("kind", TEXTS)
def test_any_text_is_read_or_refused(kind, victims, tmp_path):
    path = tmp_path / f"any-{victims[kind].path.name}"
    whole = victims[kind].path.read_text(encoding="utf-8")

    @settings(FAST, max_examples=12)
    @given(place=st.integers(0, len(whole)), text=st.text(max_size=12), cut=st.integers(0, 12))
    def holds(place, text, cut):
        path.write_text(whole[:place] + text + whole[place + cut :], encoding="utf-8", errors="replace")
        refused(victims[kind], path)

    holds()


@pytest.mark.parametrize("kind", JSONS)
def test_any_tree_is_read_or_refused(kind, victims, tmp_path):
    path = tmp_path / f"any-{victims[kind].path.name}"
    whole = json.loads(victims[kind].path.read_text(encoding="utf-8"))

    @settings(FAST, max_examples=20)
    @given(seed=st.integers(0, 2**32))
    def holds(seed):
        path.write_text(json.dumps(change_tree(whole, np.random.default_rng(seed))), encoding="utf-8")
        refused(victims[kind], path)

    holds()
