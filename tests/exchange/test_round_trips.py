"""What is written comes back: angles to the bit, ticks to what the format can say."""

import json

import numpy as np
import pytest

from creative_nao import exchange
from creative_nao.demonstrations import load_demonstrations, load_trajectory
from creative_nao.errors import NotFoundError, SettingsError, ShapeError
from creative_nao.joints import JOINTS

FILES = ["a.csv", "a.npz", "a.py", "a.json", "a.yaml", "ros.json", "a.motion"]
METADATA = {"source": "memory half/0", "pb": [0.3, -0.1], "note": "ünïcode '''\n\"\"\" # quit()"}


@pytest.fixture(scope="module")
def jab():
    demos = load_demonstrations()
    return exchange.Motion(demos.trajectory("left_jab"), demos.dt_s, demos.joints, METADATA)


def written(path, motion, **options):
    name = "ros" if path.name.startswith("ros") else None
    return exchange.write(path, motion, name, **options)


@pytest.mark.parametrize("name", FILES)
def test_a_movement_comes_back_to_the_bit(name, jab, tmp_path):
    out = written(tmp_path / name, jab)
    found = exchange.read(out.path)

    assert found.format == out.format
    assert np.array_equal(found.motion.angles, jab.angles)
    assert (found.motion.dt_s, found.motion.joints) == (jab.dt_s, JOINTS)
    assert out.changes == ()


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("dt_s", [0.02, 1 / 30, 0.1234567])
def test_an_odd_tick_comes_back_as_well_as_the_format_can_say(name, dt_s, jab, tmp_path):
    """Nanoseconds; the whole movement of a Webots file is right to its millisecond."""
    slow = exchange.Motion(jab.angles * 0.01 + jab.angles.mean(axis=0), dt_s)
    found = exchange.read(written(tmp_path / name, slow).path)

    precision = 1e-3 / (len(jab.angles) - 1) if name == "a.motion" else 1.0001e-9
    assert np.array_equal(found.motion.angles, slow.angles)
    assert abs(found.motion.dt_s - dt_s) < precision


@pytest.mark.parametrize("name", ["a.npz", "a.json", "a.yaml"])
def test_metadata_that_has_a_place_comes_back(name, jab, tmp_path):
    assert exchange.read(written(tmp_path / name, jab).path).motion.metadata == METADATA


@pytest.mark.parametrize("name", ["a.csv", "ros.json", "a.motion"])
def test_metadata_without_a_place_stands_beside_the_file(name, jab, tmp_path):
    out = written(tmp_path / name, jab)

    assert out.record == tmp_path / f"{name}.record.json"
    assert json.loads(out.record.read_text()) == METADATA


def test_the_csv_is_the_one_that_demonstrations_read(jab, tmp_path):
    out = exchange.write(tmp_path / "a.csv", jab)

    assert np.array_equal(load_trajectory(out.path, jab.dt_s), jab.angles)


@pytest.mark.parametrize("name", ["a.py", "a.json", "a.yaml", "ros.json"])
def test_the_first_posture_is_never_asked_for_at_once(name, jab, tmp_path):
    """From the far end of every range, at 1.5 rad/s: the left shoulder has (2.0857 + 0.91) rad to go."""
    farthest = 2.0857 + jab.angles[0, 4]
    out = written(tmp_path / name, jab)

    assert jab.lead_s() == pytest.approx(farthest / 1.5, abs=0.0101)
    assert f"reached after {jab.lead_s():g} s" in out.notes[-1]
    if name == "a.json":
        assert json.loads(out.path.read_text())["times"][0][0] == jab.lead_s()


@pytest.mark.parametrize("name", FILES)
def test_equal_movements_give_equal_bytes_and_leave_nothing_else(name, jab, tmp_path):
    one, two = (written(tmp_path / folder / name, jab).path for folder in "ab")

    assert one.read_bytes() == two.read_bytes()
    assert len(list(one.parent.iterdir())) == (2 if name in ("a.csv", "ros.json", "a.motion") else 1)


def test_the_yaml_is_what_a_yaml_library_reads(jab, tmp_path):
    yaml = pytest.importorskip("yaml")
    text = exchange.write(tmp_path / "a.yaml", jab).path.read_text(encoding="utf-8")

    message = yaml.safe_load(text)
    assert message["joint_names"] == list(JOINTS)
    assert message["points"][7]["positions"] == jab.angles[7].tolist()
    stamp = message["points"][1]["time_from_start"]
    assert stamp["sec"] + stamp["nanosec"] / 1e9 == pytest.approx(jab.lead_s() + 0.15)


@pytest.mark.parametrize(
    ("name", "format", "error", "message"),
    [
        ("a.txt", None, SettingsError, "no format for .*known endings are .csv"),
        ("a.csv", "npz", SettingsError, "of the format npz should end in .npz"),
        ("a.csv", "nao", NotFoundError, r"no format `nao` \(did you mean `naoqi`\?\)"),
    ],
)
def test_a_wrong_name_is_told(name, format, error, message, jab, tmp_path):
    with pytest.raises(error, match=message):
        exchange.write(tmp_path / name, jab, format)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("angles", "options", "error", "message"),
    [
        (np.zeros((3, 7)), {}, ShapeError, r"shape \(n_steps >= 1, 8\).*but has \(3, 7\)"),
        (np.full((3, 8), np.nan), {}, ShapeError, "RShoulderPitch at step 0 is not a number"),
        ("wave", {}, ShapeError, "`angles` should be an array of numbers, but is str"),
        (np.zeros((3, 8)), {"dt_s": "x"}, SettingsError, "`dt_s` should be a number, but is 'x'"),
        (np.zeros((3, 8)), {"dt_s": 0.0}, SettingsError, "`dt_s` should be a positive"),
        (np.zeros((3, 1)), {"joints": ("a'",)}, SettingsError, "a name should be ASCII"),
        (
            np.zeros((3, 8)),
            {"metadata": {"x": {1}}},
            SettingsError,
            "`metadata` should be bounded JSON",
        ),
    ],
)
def test_a_motion_is_checked_when_it_is_made(angles, options, error, message):
    with pytest.raises(error, match=message):
        exchange.Motion(angles, **({"dt_s": 0.1} | options))


def test_a_motion_is_shown_in_one_line_and_as_curves(jab):
    assert repr(jab) == "Motion of 8 joints: 50 postures at 0.15 s, 7.35 s long"
    assert jab._repr_png_().startswith(b"\x89PNG")


def test_arguments_of_another_kind_are_named(jab, tmp_path):
    with pytest.raises(SettingsError, match="`motion` should be a `Motion`, but is 3"):
        exchange.write(tmp_path / "a.csv", 3)
    with pytest.raises(SettingsError, match="`motion` should be a `Motion`, but is 3"):
        exchange.made_safe(3)
    with pytest.raises(SettingsError, match="`path` should be text, but is 3"):
        exchange.read(3)
    with pytest.raises(SettingsError, match="`joints` should be a list, but is 'RElbowYaw'"):
        exchange.read(written(tmp_path / "a.csv", jab).path, joints="RElbowYaw")
