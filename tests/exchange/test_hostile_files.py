"""Whatever stands in a file, the answer is one clear error: nothing hangs, fills the memory, or is run."""

import contextlib
import io
import json
import zipfile

import numpy as np
import pytest

from creative_nao import exchange
from creative_nao.demonstrations import load_demonstrations
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError
from creative_nao.joints import JOINTS

FILES = ["a.csv", "a.npz", "a.py", "a.json", "a.yaml", "ros.json", "a.motion"]


def write(name, tmp_path):
    demos = load_demonstrations()
    motion = exchange.Motion(demos.trajectories[0], demos.dt_s, metadata={"source": "test"})
    return exchange.write(tmp_path / name, motion, "ros" if name.startswith("ros") else None).path


@pytest.mark.parametrize("name", FILES)
def test_a_torn_file_never_gives_a_strange_error(name, tmp_path, rng):
    path = write(name, tmp_path)
    whole = path.read_bytes()
    for size in [1, 2, 5, 20, len(whole) // 3, len(whole) // 2, *rng.integers(1, len(whole), 12)]:
        path.write_bytes(whole[: int(size)])
        with contextlib.suppress(FileFormatError):  # a table cut between two lines is a shorter table
            exchange.read(path)


@pytest.mark.parametrize("name", FILES)
def test_changed_bytes_never_give_a_strange_error(name, tmp_path, rng):
    path = write(name, tmp_path)
    whole = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    for _ in range(40):
        broken = whole.copy()
        broken[rng.integers(0, len(whole), 5)] = rng.integers(0, 256, 5)
        path.write_bytes(broken.tobytes())
        with contextlib.suppress(FileFormatError):
            exchange.read(path)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def keys(**changes):
    found = {"names": list(JOINTS), "times": [1.0, 2.0, 3.0], "angles": [[0.1, 0.1, 0.1]] * 8} | changes
    return json.dumps({name: value for name, value in found.items() if value is not None})


def points(*rows, names=("RElbowYaw",)):
    return json.dumps({"joint_names": list(names), "points": list(rows)})


CASES = {
    "nan.json": (keys(angles=[[0.1, float("nan"), 0.1]] * 8), "it holds nan"),
    "huge.json": (keys(angles=[[0.1, 10**400, 0.1]] * 8), "it holds a whole number of more than 40 digits"),
    "overflow.json": (keys().replace("0.1", "1e999"), "it holds inf"),
    "text.json": (keys(angles=[["x", 1, 2]] * 8), "`angles` of RShoulderPitch, entry 1 should be a number, but is 'x'"),
    "true.json": (keys(angles=[[True, 1, 2]] * 8), "should be a number, but is True"),
    "short.json": (keys(angles=[[0.1, 0.1]] * 8), "has 3 times and 2 angles"),
    "count.json": (keys(angles=[[0.1] * 3] * 7), "8 names, 8 lists of times and 7 lists of angles"),
    "fall.json": (keys(times=[1.0, 3.0, 2.0]), "key 3: times of RShoulderPitch should rise, but 2 s follows 3 s"),
    "relative.json": (keys(isAbsolute=False), "angles are relative"),
    "unit.json": (keys(unit="gon"), "`unit` is 'gon', expected radians or degrees"),
    "none.json": (keys(times=None), "should hold `names`, `times` and `angles`, but holds names, angles"),
    "twice.json": (keys(names=[JOINTS[0], *JOINTS[:7]]), "more than once|`LElbowRoll` is missing"),
    "mapping.json": (keys(names={"a": 1}), "`names` should be a list, but is {'a': 1}"),
    "milliseconds.json": (keys(times=[0, 5000, 91234]), "are the times in seconds, not milliseconds"),
    "single.json": (keys(times=[1.0], angles=[[0.1]] * 8), "has a single posture"),
    "deep.json": ('{"names": ' + "[" * 100_000 + "]" * 100_000 + "}", "nested too deeply"),
    "list.json": ("[1, 2]", r"should be a JSON object, but is \[1, 2\]"),
    "point.json": (points({"positions": [1, 2]}), "point 0 has 2 positions, expected 1"),
    "time.json": (points({"positions": [1.0]}), "`time_from_start` of point 0 should be a number, but is None"),
    "points.json": ('{"joint_names": ["a"], "points": 3}', "`points` should be a list, but is 3"),
    "empty.json": (" \n", "is empty, expected a movement"),
    "tag.yaml": ("joint_names: !!python/object/apply:os.system ['touch ran']", "could not determine a constructor"),
    "alias.yaml": ("a: &a [*a]\njoint_names: *a\npoints: *a", "unfold to more than 250000 values"),
    "twice.yaml": ("joint_names: [a]\njoint_names: [b]", "line 2: `joint_names` is there already"),
    "deep.yaml": ("joint_names: " + "[" * 50_000, "nest"),
    "indent.yaml": ("\n".join("  " * k + "a:" for k in range(200)), "nested too deeply"),
    "tab.yaml": ("a:\n\tb: 1", "line 2, column 1"),
    "text.yaml": ("joint_names: [RElbowYaw]\npoints: [{positions: [x], time_from_start: 1}]", "a number, but is 'x'"),
    "open.yaml": ("joint_names: [RElbowYaw\npoints: []", "flow sequence"),
    "more.yaml": ("joint_names: [a]\npoints: []\n   x: 1", "line 3"),
    "code.py": ("names = __import__('os').listdir()", "line 1: `names` should hold plain numbers and texts"),
    "call.py": ("names = ['a']\ntimes = [[1, 2]]\nkeys = [[f(1), 2]]", "line 3: `keys` should hold plain"),
    "deep.py": ("names = " + "[" * 5000 + "]" * 5000, "is not Python text|nested too deeply"),
    "minus.py": ("names = ['a']\ntimes = [" + "-" * 50_000 + "1]", "line 2: `times` should hold plain numbers"),
    "two.py": ("names = ['a']\nnames = ['b']", "line 2: `names` begins anew"),
    "none.py": ("x = 1", "no list of names and times and keys"),
    "null.py": ("names = ['a']\0", "is not Python text"),
    "header.motion": ("#WEBOTS_MOTION\n", "line 1 should be #WEBOTS_MOTION,V1.0,JOINT"),
    "cells.motion": ("#WEBOTS_MOTION,V1.0,RElbowYaw\n00:00:000,A\n", "line 2: has 2 cells, expected 3"),
    "time.motion": ("#WEBOTS_MOTION,V1.0,RElbowYaw\n1.5,A,0.1\n", "line 2: time is '1.5'"),
    "angle.motion": ("#WEBOTS_MOTION,V1.0,RElbowYaw\n00:00:000,A,x\n", "line 2: RElbowYaw is 'x'"),
    "nan.motion": ("#WEBOTS_MOTION,V1.0,RElbowYaw\n00:00:000,A,nan\n00:01:000,A,1\n", "not a finite number"),
    "header.csv": ("RElbowYaw\n1\n2\n", "no column `time_s` for the time; .* RElbowYaw; say which one"),
    "wide.csv": ("time_s,RElbowYaw\n0,1,2\n", "line 2: has 3 columns, expected 2"),
    "comma.csv": ('time_s,RElbowYaw\n0,"0,5"\n1,"0,6"\n', "line 2: `RElbowYaw` is `0,5`, expected a number; a dec"),
    "time.csv": ("time_s,RElbowYaw\nx,1\n1,2\n", "line 2: `time_s` is `x`, expected a number"),
    "angle.csv": ("time_s,RElbowYaw\n0,x\n1,2\n", "line 2: `RElbowYaw` is `x`, expected a number"),
    "text.npz": ("PK\x03\x04 nothing", "no readable NPZ file"),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_fault_is_named(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text, message = CASES[name]
    path = tmp_path / name
    path.write_bytes(text.encode())

    with pytest.raises(FileFormatError, match=message) as caught:
        exchange.read(path, joints=JOINTS if "RShoulderPitch" in text else ("RElbowYaw",))
    assert str(path) in str(caught.value)
    assert len(str(caught.value)) < 500
    assert not (tmp_path / "ran").exists()


def npz(path, **arrays):
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    path.write_bytes(content.getvalue())
    return path


GOOD = {"angles": np.zeros((3, 1)), "dt_s": np.array(0.1), "joints": np.array(["RElbowYaw"])}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"angles": np.array([[{}]], dtype=object)},
            "`angles` holds object, expected numbers or text",
        ),
        ({"angles": np.zeros((3, 2))}, r"`angles` should be numbers of shape \(n_steps, 1\), but is float64 \(3, 2\)"),
        ({"angles": np.array([["x"]])}, "`angles` should be numbers"),
        ({"angles": np.full((3, 1), np.inf)}, "not a finite number"),
        ({"dt_s": np.array(-1.0)}, "`dt_s` should be a positive number"),
        ({"dt_s": np.array([1.0, 2.0])}, r"`dt_s` should be numbers of shape \(\)"),
        ({"joints": np.array([1.0])}, "`joints` should be a list of names"),
        ({"metadata": np.array("[1]")}, r"should be a JSON object, but is \[1\]"),
        ({"metadata": np.array(3)}, "`metadata` should be JSON text"),
        ({"angles": np.zeros((3_000_000, 1))}, "bytes unpacked, but this file announces 3 and 24000"),
    ],
)
def test_a_fault_in_an_array_is_named(changes, message, tmp_path):
    with pytest.raises(FileFormatError, match=message):
        exchange.read(npz(tmp_path / "a.npz", **(GOOD | changes)), joints=("RElbowYaw",))


def test_missing_arrays_are_named(tmp_path):
    with pytest.raises(FileFormatError, match="the array `angles` is missing; the file has dt_s, joints"):
        exchange.read(npz(tmp_path / "a.npz", dt_s=GOOD["dt_s"], joints=GOOD["joints"]))
    with pytest.raises(FileFormatError, match="neither `dt_s` nor `times_s` is there"):
        exchange.read(npz(tmp_path / "a.npz", angles=GOOD["angles"], joints=GOOD["joints"]))


def test_an_archive_that_lies_about_its_size_is_refused(tmp_path):
    path = npz(tmp_path / "a.npz", **(GOOD | {"angles": np.zeros((100_000, 1))}))
    content = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        size = archive.getinfo("angles.npy").file_size
    path.write_bytes(content.replace(size.to_bytes(4, "little"), (10).to_bytes(4, "little")))

    with pytest.raises(FileFormatError, match="no readable NPZ file"):
        exchange.read(path, joints=("RElbowYaw",))


@pytest.mark.parametrize(("name", "size"), [("a.csv", 16_000_001), ("a.py", 600_001)])
def test_a_huge_file_is_refused_before_it_is_parsed(name, size, tmp_path):
    path = tmp_path / name
    with open(path, "wb") as stream:
        stream.write(b"names = 1 #")
        stream.truncate(size)

    with pytest.raises(FileFormatError, match=rf"has {size} bytes, expected at most {size - 1}"):
        exchange.read(path)


def test_a_missing_file_and_a_senseless_tick_are_told(tmp_path):
    with pytest.raises(NotFoundError, match=r"no movement at .*none\.csv"):
        exchange.read(tmp_path / "none.csv")
    with pytest.raises(SettingsError, match="`dt_s` should be a finite number, but is nan"):
        exchange.read(write("a.csv", tmp_path), dt_s=float("nan"))
