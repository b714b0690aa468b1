"""Recordings from elsewhere: any order of joints, degrees, handles, keys at different times; all said in notes."""

import json

import numpy as np
import pytest

from creative_nao import exchange
from creative_nao.demonstrations import load_demonstrations
from creative_nao.errors import FileFormatError
from creative_nao.exchange.motion import resample
from creative_nao.joints import JOINTS

CHOREGRAPHE = """
# Choregraphe bezier export in Python.
from naoqi import ALProxy
names = list()
times = list()
keys = list()
{appends}
try:
  motion = ALProxy("ALMotion")
  motion.angleInterpolationBezier(names, times, keys)
except BaseException, err:
  print err
open("ran", "w").write("this file was run")
"""


@pytest.fixture(scope="module")
def demos():
    return load_demonstrations()


@pytest.fixture(scope="module")
def punch(demos):
    return demos.trajectory("right_straight")


def export_of(angles, times, names=JOINTS, handles=True):
    lines = []
    for name, column in zip(names, np.transpose(angles), strict=True):
        keys = [[a, [3, -0.05, 0], [3, 0.05, 0]] if handles else a for a in column.tolist()]
        lines.append(f"names.append({name!r})\ntimes.append({list(times)})\nkeys.append({keys})\n")
    return CHOREGRAPHE.format(appends="\n".join(lines))


def test_a_choregraphe_export_is_read_and_never_run(punch, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "export.py"
    times = (1.0 + 0.15 * np.arange(50)).tolist()
    path.write_text(export_of(punch, times))
    found = exchange.read(path)

    assert np.array_equal(found.motion.angles, punch)
    assert found.motion.dt_s == 0.15
    assert "Bezier handles were left out; between keys a monotone cubic is taken" in found.notes
    assert [file.name for file in tmp_path.iterdir()] == ["export.py"]


@pytest.mark.parametrize(
    "form", ["names = {n}\ntimes = {t}\nkeys = {k}", "self.names={n};self.times={t};self.angles={k}"]
)
def test_plain_assignments_are_read_wherever_they_stand(form, punch, tmp_path):
    path = tmp_path / "a.py"
    times = [0.5 + 0.15 * step for step in range(50)]
    text = form.format(n=list(JOINTS), t=[times] * 8, k=punch.T.tolist())
    path.write_text("class A:\n  def f(self):\n    " + text.replace("\n", "\n    "))

    assert np.array_equal(exchange.read(path).motion.angles, punch)


def test_degrees_are_recognised_and_said(punch, tmp_path):
    path = tmp_path / "a.json"
    times = [0.15 * step for step in range(50)]
    found = {"names": JOINTS, "times": times, "angles": np.degrees(punch).T.tolist()}
    path.write_text(json.dumps(found))
    read = exchange.read(path)

    np.testing.assert_allclose(read.motion.angles, punch, atol=1e-15)
    assert any(note.startswith("angles converted from degrees: the largest is 8") for note in read.notes)


def test_of_what_needs_no_change_nothing_is_said(punch, tmp_path):
    out = exchange.write(tmp_path / "a.yaml", exchange.Motion(punch, 0.15))

    assert exchange.read(out.path).notes == ()


def test_a_unit_that_the_file_names_is_believed(tmp_path):
    path = tmp_path / "a.json"
    small = {"names": ["RElbowYaw"], "times": [[1, 2]], "angles": [[1.0, 2.0]], "unit": "degrees"}
    path.write_text(json.dumps(small))
    read = exchange.read(path, joints=("RElbowYaw",))

    assert read.motion.angles[:, 0] == pytest.approx(np.radians([1.0, 2.0]))
    assert "angles converted from degrees" in read.notes


def test_a_csv_in_degrees_is_read_here(demos, punch, tmp_path):
    path = tmp_path / "a.csv"
    rows = np.column_stack([np.arange(50) * 0.15, np.degrees(punch)])
    np.savetxt(path, rows, delimiter=",", header="time_s," + ",".join(JOINTS), comments="", fmt="%.12f")

    np.testing.assert_allclose(exchange.read(path).motion.angles, punch, atol=1e-12)


def test_joints_in_any_order_with_others_among_them(punch, tmp_path):
    names = ["HeadYaw", *reversed(JOINTS), "LHand"]
    angles = np.column_stack([np.zeros(50), punch[:, ::-1], np.ones(50)])
    out = exchange.write(tmp_path / "a.npz", exchange.Motion(angles, 0.15, tuple(names)), unsafe="keep")
    read = exchange.read(out.path)

    assert np.array_equal(read.motion.angles, punch)
    assert "left out, not among the wanted joints: HeadYaw, LHand" in read.notes
    assert exchange.read(out.path, joints=None).motion.joints == tuple(names)


def test_text_in_a_column_nobody_wants_does_no_harm(punch, tmp_path):
    path = exchange.write(tmp_path / "a.csv", exchange.Motion(punch, 0.15)).path
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([f"{header},remark", *(f"{row},fine" for row in rows)]))

    assert np.array_equal(exchange.read(path).motion.angles, punch)


def test_a_missing_joint_is_named_with_the_nearest(tmp_path):
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"names": ["RShoulderPich"], "times": [[1, 2]], "angles": [[0, 0.1]]}))

    with pytest.raises(FileFormatError, match=r"`RShoulderPitch`, .* are missing \(did you mean `RShoulderPich`\?\)"):
        exchange.read(path)


def test_joints_with_keys_of_their_own_meet_at_one_tick(tmp_path):
    """A joint that moves evenly between its two keys does so here too, at 0.15 s; a single key is held."""
    path = tmp_path / "a.json"
    names = ["RElbowYaw", "LElbowYaw", "LShoulderPitch"]
    keys = {"names": names, "times": [[0, 1.5], [0, 0.6, 1.5], [0.3]], "angles": [[0, 1.5], [0.5, 0.5, 0.5], [0.7]]}
    path.write_text(json.dumps(keys))
    read = exchange.read(path, joints=tuple(names))

    assert read.motion.dt_s == 0.15
    assert read.motion.angles[:, 1] == pytest.approx(np.full(11, 0.5))
    assert read.motion.angles[:, 2] == pytest.approx(np.full(11, 0.7))
    assert read.motion.angles[3, 0] == pytest.approx(0.45, abs=1e-12)
    assert any("keys at different times" in note for note in read.notes)
    assert any("brought to a tick of 0.15 s" in note for note in read.notes)


def test_another_tick_is_made_on_request(punch, tmp_path):
    path = exchange.write(tmp_path / "a.motion", exchange.Motion(punch, 0.15)).path
    read = exchange.read(path, dt_s=0.3)

    assert read.motion.angles.shape == (25, 8)
    np.testing.assert_allclose(read.motion.angles, resample(np.arange(50) * 0.15, punch, 0.3), atol=1e-12)
    assert "postures every 0.15 s brought to a tick of 0.3 s" in read.notes


def test_an_asterisk_of_webots_is_no_key(tmp_path):
    path = tmp_path / "a.motion"
    path.write_text(
        "#WEBOTS_MOTION,V1.0,RElbowYaw,LElbowYaw\n00:00:000,A,0.1,*\n00:01:000,B,*,0.5\n00:02:000,C,0.3,*\n"
    )
    read = exchange.read(path, joints=("RElbowYaw", "LElbowYaw"), dt_s=1.0)

    assert read.motion.angles == pytest.approx(np.array([[0.1, 0.5], [0.2, 0.5], [0.3, 0.5]]))


ECHO = """header:
  stamp:
    secs: 12
    nsecs: 0
  frame_id: ''
joint_names:
- RElbowYaw
- "LElbowYaw"
points:
  - positions: [0.1, -0.2]   # the beginning
    velocities: []
    time_from_start:
      secs: 1
      nsecs: 500000000
  - positions:
    - 0.2
    - -1e-1
    time_from_start: {secs: 2, nsecs: 0}
---
"""


def test_what_a_ros_console_prints_is_read(tmp_path):
    path = tmp_path / "echo.yaml"
    path.write_text(ECHO)
    read = exchange.read(path, joints=("LElbowYaw", "RElbowYaw"))

    assert read.format == "ros"
    assert read.motion.angles.tolist() == [[-0.2, 0.1], [-0.1, 0.2]]
    assert read.motion.dt_s == 0.5


def test_the_goal_of_an_action_is_read(tmp_path):
    points = [{"positions": [0.1 * k], "time_from_start": k + 1.0} for k in range(3)]
    path = tmp_path / "goal.json"
    path.write_text(json.dumps({"goal": {"trajectory": {"joint_names": ["RElbowYaw"], "points": points}}}))

    assert exchange.read(path, joints=("RElbowYaw",)).motion.dt_s == 1.0


@pytest.mark.parametrize("name", ["a.csv", "a.npz", "a.py", "a.json", "a.yaml", "a.motion"])
def test_a_format_is_known_by_its_content_when_the_ending_says_nothing(name, punch, tmp_path):
    out = exchange.write(tmp_path / name, exchange.Motion(punch, 0.15))
    other = out.path.rename(tmp_path / "recording.txt")

    assert exchange.read(other).format == out.format


def test_content_is_believed_before_the_ending(punch, tmp_path):
    out = exchange.write(tmp_path / "a.motion", exchange.Motion(punch, 0.15))

    assert exchange.read(out.path.rename(tmp_path / "a.csv")).format == "webots"
