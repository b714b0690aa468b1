"""A record takes what its fields allow and refuses all else in one line that names file and field."""

from __future__ import annotations

import copy
import dataclasses
import pickle
import subprocess
import sys
import time
from typing import Annotated, Literal

import numpy as np
import pytest

from creative_nao.errors import FileFormatError, NotFoundError, SettingsError
from creative_nao.schema import (
    Count,
    Field,
    JsonObject,
    Names,
    PlainName,
    Sha256,
    Text,
    UnitInterval,
    Version1,
    Versions,
    checked,
    dump,
    load_json,
    parse,
    record,
    save_json,
)


@record
class Gait:
    """How it walks."""

    n_steps: Annotated[int, Field(ge=1, le=4_000)]
    swing: float = 0.5

    def __post_init__(self) -> None:
        if self.n_steps == 13:
            raise SettingsError("`n_steps` should not be 13")


@record
class Walk:
    """A walk."""

    format_version: Version1
    joints: Names = ("RElbowYaw",)
    gait: Gait | None = None
    others: tuple[Gait, ...] = ()
    path: tuple[tuple[float, float], ...] = ()
    share: UnitInterval = 1.0
    note: Text = ""
    name: PlainName = "walk"
    mode: Literal["slow", "fast"] = "slow"
    speed: int | str = 1
    trusted: bool = False
    sha256: Sha256 = "0" * 64
    versions: Versions = dataclasses.field(default_factory=dict)
    record: JsonObject = dataclasses.field(default_factory=dict)


@record(closed=False, eq=False)
class Row:
    """A row that may hold more."""

    n: Count


GOOD = {
    "format_version": 1, "gait": {"n_steps": 3}, "others": [{"n_steps": 1, "swing": 2}], "path": [[0, 1], [0.5, 0.5]],
    "versions": {"numpy": "2"}, "record": {"settings": {"a": [None, 1.5, {"b": True}]}},
}  # fmt: skip


def deep(levels):
    found = []
    for _ in range(levels):
        found = [found]
    return found


def test_a_record_comes_back_from_json(tmp_path):
    walk = parse(Walk, GOOD, "walk.json")
    assert walk == load_json(Walk, save_json(tmp_path / "walk.json", walk), "walk")
    assert walk.others == (Gait(1, 2.0),)
    assert walk.path == ((0.0, 1.0), (0.5, 0.5))
    assert dump(walk)["others"] == [{"n_steps": 1, "swing": 2.0}]
    assert pickle.loads(pickle.dumps(walk)) == walk == copy.deepcopy(walk)  # jobs and settings go to other processes
    assert dataclasses.replace(walk, note="new").note == "new"
    with pytest.raises(dataclasses.FrozenInstanceError):
        walk.note = "changed"


WRONG = [
    ({"format_version": True}, "`format_version` should be a whole number, but is True"),
    ({"format_version": 1.0}, "`format_version` should be a whole number"),
    ({"format_version": 2, "newer": 1}, "`format_version` should be 1, the version that this release reads, but is 2"),
    ({"format_version": ...}, "`format_version` is missing"),
    ({"jonts": []}, "no key `jonts` (did you mean `joints`?); there are: format_version, joints, "),
    ({"joints": []}, "`joints` should be a list of at least 1 entries"),
    ({"joints": ["a", "a"]}, "`joints` should be a list of different names"),
    ({"joints": ["a\nb"]}, "`joints`, entry 1 should be a name of 1 to 200 printable characters, but is 'a\\nb'"),
    ({"joints": "ab"}, "`joints` should be a list, but is 'ab'"),
    ({"gait": {"n_steps": 0}}, "`gait`: `n_steps` should be at least 1, but is 0"),
    ({"gait": {"n_steps": 10**30}}, "`gait`: `n_steps` should be at most 4000, but is 1000"),
    ({"gait": {"n_steps": 13}}, "`gait`: `n_steps` should not be 13"),
    ({"gait": {"n_step": 1}}, "`gait`: no key `n_step` (did you mean `n_steps`?); there are: n_steps, swing"),
    ({"gait": {}}, "`gait`: `n_steps` is missing"),
    ({"gait": [1]}, "`gait` should be a JSON object, but is [1]"),
    ({"others": [{"n_steps": 1}, {"n_steps": 1, "swing": "2"}]}, "`others`, entry 2: `swing` should be a number, but"),
    ({"others": [3]}, "`others`, entry 1 should be a JSON object, but is 3"),
    ({"path": [[1]]}, "`path`, entry 1, entry 2 is missing"),
    ({"path": [[1, 2, 3]]}, "`path`, entry 1 should be a list of at most 2 entries"),
    ({"path": [[1, True]]}, "`path`, entry 1, entry 2 should be a number, but is True"),
    ({"share": 1.5}, "`share` should be at most 1"),
    ({"share": float("nan")}, "`share` should be a finite number, but is nan"),
    ({"share": 10**400}, "`share` should be a number of at most 40 digits"),
    ({"share": "0.5"}, "`share` should be a number, but is '0.5'"),
    ({"note": "x" * 300}, "`note` should be text of at most 200 characters, but is 'xxx"),
    ({"note": "\ud800"}, "`note` should be text that can be written as UTF-8"),
    ({"note": deep(100_000)}, "`note` should be text, but is a list"),
    ({"name": "../up"}, "`name` should be a plain name, as of a file, but is '../up'"),
    ({"mode": "quick"}, "`mode` should be `slow` or `fast`, but is 'quick'"),
    ({"mode": []}, "`mode` should be `slow` or `fast`, but is []"),
    ({"speed": []}, "`speed` should be a whole number or text, but is []"),
    ({"trusted": 1}, "`trusted` should be true or false, but is 1"),
    ({"sha256": "0"}, "`sha256` should be a SHA-256 of 64 hexadecimal digits"),
    ({"versions": {"numpy": 2}}, "`versions`: `numpy` should be text, but is 2"),
    ({"versions": {2: "2"}}, "`versions` should have keys that are text, but has 2"),
    ({"record": {"a": deep(100_000)}}, "`record` should be bounded JSON (it is nested too deeply), but is"),
    ({"record": {"a": float("inf")}}, "`record` should be bounded JSON (it holds inf)"),
    ({"record": {"a": {1: 2}}}, "`record` should be bounded JSON (it has a key that is no text)"),
    ({"record": [["a", 1]]}, "`record` should be a JSON object, but is [['a', 1]]"),
    ({"\ud800": 1}, "walk.json should be an object of at most 10000 fields named by text"),
]


@pytest.mark.parametrize(("changes", "text"), WRONG)
def test_a_wrong_field_is_named(changes, text):
    values = {name: value for name, value in {**GOOD, **changes}.items() if value is not ...}
    with pytest.raises(FileFormatError) as caught:
        parse(Walk, values, "walk.json")
    assert str(caught.value).startswith("walk.json")
    assert text in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b'{"format_version": 1, "format_version": 1}', "walk.json: not JSON (it says `format_version` twice)"),
        ('{"share": NaN}', "walk.json: not JSON (it holds nan)"),
        ('{"share": ' + "9" * 5_000 + "}", "walk.json: not JSON (Exceeds the limit (4300 digits)"),
        ('{"share": ' + "9" * 50 + "}", "walk.json: not JSON (it holds a whole number of more than 40 digits)"),
        ("[" * 100_000, "walk.json: not JSON (it is nested too deeply)"),
        (b"\xff", "walk.json: byte 0 of the text is not UTF-8"),
        ("[]", "walk.json should be a JSON object, but is []"),
        ("null", "walk.json should be a JSON object, but is None"),
    ],
)
def test_broken_json_is_refused(text, message):
    with pytest.raises(FileFormatError) as caught:
        parse(Walk, text, "walk.json")
    assert message in str(caught.value)


def test_files_are_bounded_before_they_are_read(tmp_path):
    path = save_json(tmp_path / "walk.json", parse(Walk, GOOD, ""))
    with pytest.raises(FileFormatError, match=r"walk\.json: has \d+ bytes, expected at most 100 of a walk"):
        load_json(Walk, path, "walk", largest=100)
    with pytest.raises(NotFoundError, match="no walk at"):
        load_json(Walk, tmp_path / "none", "walk")


def test_a_constructor_raises_settings_errors():
    assert Walk(1, joints=["a"], gait={"n_steps": np.int64(3)}).gait == Gait(3)
    assert Gait(2, np.float32(0.5)).swing == 0.5
    for make, text in (
        (lambda: Gait(0), "`n_steps` should be at least 1, but is 0"),
        (lambda: Gait(n_steps=13), "`n_steps` should not be 13"),
        (lambda: Gait(True), "`n_steps` should be a whole number, but is True"),
        (lambda: Gait(1, float("nan")), "`swing` should be a finite number, but is nan"),
        (Gait, "`n_steps` is missing"),
        (lambda: Gait(1, 2.0, 3), "at most 2 values are taken: n_steps, swing"),
        (lambda: Gait(n_step=1), "no key `n_step` (did you mean `n_steps`?); there are: n_steps, swing"),
        (lambda: dataclasses.replace(Gait(1), n_steps=0), "`n_steps` should be at least 1, but is 0"),
    ):
        with pytest.raises(SettingsError) as caught:
            make()
        assert str(caught.value) == text


def test_what_a_user_wrote_by_hand_is_a_setting():
    with pytest.raises(SettingsError, match=r"suite mine\.toml: `n_steps` should be at least 1, but is 0"):
        parse(Gait, {"n_steps": 0}, "suite mine.toml", error=SettingsError)


def test_arguments_of_functions_are_checked():
    assert checked(Count, np.int64(4), "n_steps") == 4
    for value, expected in ((0, "at least 1"), (True, "a whole number"), ("x", "a whole number"), (2.0, "a whole")):
        with pytest.raises(SettingsError, match=f"`n_steps` should be {expected}.*, but is {value!r}"):
            checked(Count, value, "n_steps")
    generator = np.random.default_rng(0)
    assert checked(np.random.Generator, generator, "rng") is generator
    with pytest.raises(SettingsError, match="`rng` should be a `Generator`, but is 0"):
        checked(np.random.Generator, 0, "rng")
    with pytest.raises(SettingsError, match="`gait`: `n_steps` should be at least 1, but is 0"):
        checked(Gait, {"n_steps": 0}, "gait")


def test_an_open_record_ignores_what_it_does_not_know():
    assert parse(Row, {"n": 1, "more": 2}, "row").n == 1
    with pytest.raises(FileFormatError, match="row: `n` should be at least 1"):
        parse(Row, {"n": 0, "more": 2}, "row")


@pytest.mark.parametrize(
    "values",
    [
        {f"k{k}": 1 for k in range(100_000)},
        {**GOOD, "versions": {f"k{k}": 1 for k in range(100_000)}},
        {**GOOD, "joints": [1] * 100_000},
        {**GOOD, "others": [{"wrong": 1}] * 100_000},
    ],
    ids=["fields", "versions", "joints", "others"],
)
def test_many_faults_take_no_longer_than_one(values):
    start = time.process_time()
    with pytest.raises(FileFormatError):
        parse(Walk, values, "walk.json")
    assert time.process_time() - start < 1.0


def test_importing_the_package_imports_no_pydantic():
    script = "import sys, creative_nao; sys.exit('pydantic' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0
