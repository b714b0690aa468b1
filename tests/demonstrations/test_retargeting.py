"""From a body to the robot: our own six actions come back through a skeleton; what is no standing person is refused."""

import json
import time

import numpy as np
import pytest

from creative_nao import exchange
from creative_nao.cli import main
from creative_nao.demonstrations import (
    Retargeting,
    from_motion,
    load_demonstrations,
    load_take,
    load_trajectory,
    propose_cuts,
)
from creative_nao.demonstrations.retargeting import closed_form, directions, fit
from creative_nao.demonstrations.take import LANDMARKS, Take
from creative_nao.errors import FileFormatError, MissingDependencyError, SettingsError
from creative_nao.exchange import Reading
from creative_nao.exchange.motion import monotone_cubic
from creative_nao.joints import JOINTS, MAX_SPEED_RAD_S, limits

DEMOS = load_demonstrations()
RATE = 30.0


def landmarks(angles):
    """Places of a standing body of the robot's proportions, y up, facing z, from angles [rad], (n, 8)."""
    places = np.zeros((len(angles), 8, 3))
    for side, (first, x) in enumerate(((0, -0.1), (3, 0.1))):
        arm = angles[:, 4 * side : 4 * side + 4] * (1 if side == 0 else np.array([1, -1, -1, -1]))
        places[:, first] = [x, 0.25, 0.0]
        at = places[:, first]
        for step, (direction, length) in enumerate(zip(directions(arm), (0.105, 0.114), strict=True), start=1):
            forward, left, up = direction.T * (np.array([[1], [1 if side == 0 else -1], [1]]))
            at = at + length * np.stack([left, up, forward], axis=1)
            places[:, first + step] = at
        places[:, 6 + side] = [0.6 * x, 0.0, 0.0]
    return places


def table(path, places, names=LANDMARKS, rate=RATE, axes="xyz", times=None):
    columns = [f"{name}_{axis}" for name in names for axis in axes]
    kept = places[..., ["xyz".index(axis) for axis in axes]]
    times = np.arange(len(places)) / rate if times is None else times
    rows = np.column_stack([times, kept.reshape(len(places), -1)])
    np.savetxt(path, rows, delimiter=",", header=",".join(["time_s", *columns]), comments="", fmt="%.6f")
    return path


@pytest.fixture(scope="module")
def fine():
    """The right straight, 7.35 s at 30 frames a second."""
    wanted = np.arange(0.0, 7.35, 1 / RATE)
    return monotone_cubic(np.arange(50) * DEMOS.dt_s, DEMOS.trajectory("right_straight"), wanted)


@pytest.mark.parametrize("name", DEMOS.names)
def test_our_own_actions_come_back_through_a_skeleton(name, tmp_path):
    pytest.importorskip("pybvh")
    taught = DEMOS.trajectory(name)
    path = exchange.write(tmp_path / "a.bvh", exchange.Motion(taught, DEMOS.dt_s)).path

    (found,) = from_motion(path, {name: [(0.0, 7.35)]}, retargeting=Retargeting(dt_s=DEMOS.dt_s, arms="both"))
    assert found.refused == ""
    assert found.angles.shape == taught.shape
    assert np.abs(found.angles - taught).mean(axis=0).max() < 0.05
    assert found.report["stretch"] == pytest.approx(1.0, abs=0.02)


def test_directions_and_angles_are_each_others_inverse():
    rng = np.random.default_rng(0)
    low, high = (pair[:4] for pair in limits())
    angles = rng.uniform(low + 0.3, high - 0.3, (200, 4)) * [0.7, 1, 1, 1]
    for k in range(len(angles)):
        np.testing.assert_allclose(closed_form(*directions(angles[k : k + 1])), angles[k : k + 1], atol=1e-9)


def test_what_the_robot_cannot_reach_is_fitted_within_its_ranges():
    """An elbow bent by 140 degrees: the robot's bends 88, and its fist still goes where the person's does."""
    bend = np.full(60, np.radians(140.0))
    angles = np.stack([np.full(60, 0.9), np.full(60, -0.3), np.full(60, 0.9), bend], axis=1)
    found = fit(*directions(angles), 1 / 60)

    low, high = (pair[:4] for pair in limits())
    assert ((found >= low) & (found <= high)).all()
    assert found[:, 3] == pytest.approx(high[3])
    assert np.abs(np.diff(found, axis=0)).max() < 1e-3


def test_a_table_gives_what_a_skeleton_gives(fine, tmp_path):
    path = table(tmp_path / "a.csv", landmarks(fine))
    (found,) = from_motion(path, {"straight": [(0.0, 7.3)]}, retargeting=Retargeting(dt_s=1 / RATE, facing="chest"))

    n = min(len(found.angles), len(fine))
    assert np.abs(found.angles[:n] - fine[:n]).mean(axis=0).max() < 0.05
    low, high = limits()
    assert ((found.angles >= low - 1e-9) & (found.angles <= high + 1e-9)).all()


def test_a_wild_movement_is_slowed_only_where_it_is_too_fast(fine):
    wild = fine.copy()
    wild[100:130, 0] = np.where(np.arange(30) // 5 % 2, 0.5, -1.0)  # 1.5 rad within a frame, six times
    take = Take("wild", landmarks(wild), 1 / RATE, np.zeros(len(wild), bool), ())
    (found,) = from_motion(take, {"a": [(0.0, 7.0)]}, retargeting=Retargeting(low_pass_hz=100.0))

    speeds = np.abs(np.diff(found.angles, axis=0)).max(axis=0) / found.dt_s
    assert (speeds <= [MAX_SPEED_RAD_S[joint] for joint in JOINTS]).all()
    assert 1.0 < found.report["stretch"] < 1.5
    assert found.report["fastest_before_rad_s"] > 10


def test_actions_begin_and_end_in_the_posture_and_have_several_parts(fine):
    take = Take("t", landmarks(fine), 1 / RATE, np.zeros(len(fine), bool), ())
    once, twice, image = from_motion(
        take, {"once": [(0.5, 2.0)], "twice": [(0.5, 2.0), (2.8, 4.4)]}, mirror={"image": "once"}
    )
    guard = [0.9, -0.15, 0.9, 1.4, 0.9, 0.15, -0.9, -1.4]
    for action in (once, twice):
        np.testing.assert_allclose(action.angles[[0, -1]], [guard, guard], atol=1e-6)
    assert len(twice.angles) > len(once.angles)
    np.testing.assert_array_equal(image.angles[:, 4:], once.angles[:, :4] * [1, -1, -1, -1])
    assert image.report["mirrored_from"] == "once"


def test_the_same_take_turned_gives_the_same_action(fine):
    """The trunk's frame is found, not assumed: a person who faces elsewhere makes the same movement."""
    c, s = np.cos(2.0), np.sin(2.0)
    turned = landmarks(fine) @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    found = [
        from_motion(Take("t", one, 1 / RATE, np.zeros(len(fine), bool), ()), {"a": [(0.0, 7.0)]})[0].angles
        for one in (landmarks(fine), turned)
    ]
    np.testing.assert_allclose(*found, atol=1e-3)


def test_thirty_seconds_take_less_than_five(fine):
    places = np.concatenate([landmarks(fine)] * 5)
    take = Take("t", places, 1 / RATE, np.zeros(len(places), bool), ())
    started = time.process_time()
    from_motion(take, {"a": [(0.0, 30.0)]})
    assert time.process_time() - started < 5.0


def swapped(name):
    return {"R": "L", "L": "R"}[name[0]] + name[1:]


def broken(kind, places):
    """A file with a fault: places, names, options of `table`."""
    options = {}
    if kind == "flat":
        options["axes"] = "xy"
    elif kind == "constant":
        places[..., 2] = 0.0
    elif kind == "units":
        places[..., 1] *= 1000
    elif kind == "milliseconds":
        options["times"] = np.arange(len(places)) / RATE * 1000
    elif kind == "swapped":
        options["names"] = tuple(map(swapped, LANDMARKS))
    elif kind == "swapped hips":
        options["names"] = (*LANDMARKS[:6], "LHip", "RHip")
    elif kind == "lying":
        places = places[..., [0, 2, 1]] * [1, 1, -1]
    elif kind == "no body":
        options["names"] = tuple(f"marker{k}" for k in range(8))
    return places, options


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("flat", "`rshoulder` has no z: keypoints in two dimensions"),
        ("constant", "z does not change: keypoints in two dimensions"),
        ("units", "no places of one body in one unit"),
        ("milliseconds", "has a frame every 33.3333 s, expected every 0.001 to 0.2 s; --time-unit or --rate"),
        ("swapped", "left and right are swapped: the elbows bend backward"),
        ("swapped hips", "left and right are swapped at the shoulders or at the hips"),
        ("lying", "nobody stands: on average the trunk leans by 90 degrees"),
        ("no body", "no body with RShoulder, RElbow, RWrist"),
    ],
)
def test_what_is_no_standing_person_is_refused_in_one_line(kind, message, fine, tmp_path):
    places, options = broken(kind, landmarks(fine))
    path = table(tmp_path / "a.csv", places, **options)
    with pytest.raises(FileFormatError, match=message) as caught:
        load_take(path)
    assert str(path) in str(caught.value)


def test_other_units_axes_and_names_are_read_and_said(fine, tmp_path):
    places = landmarks(fine)
    (expected,) = from_motion(table(tmp_path / "a.csv", places), {"a": [(0.0, 7.0)]})
    names = ["RIGHT_SHOULDER", "RIGHT_ELBOW", "RIGHT_WRIST", "LEFT_SHOULDER", "LEFT_ELBOW", "LEFT_WRIST"]
    pipe = table(tmp_path / "pipe.csv", places * [1, -1, -1], [*names, "RIGHT_HIP", "LEFT_HIP"])
    kinect = ["ShoulderRight", "ElbowRight", "WristRight", "ShoulderLeft", "ElbowLeft", "WristLeft"]
    sensor = table(tmp_path / "kinect.csv", places * 1000, [*kinect, "HipRight", "HipLeft"])
    upright = table(tmp_path / "z.csv", places[..., [0, 2, 1]] * [1, -1, 1])
    slow = table(tmp_path / "ms.csv", places, times=np.arange(len(places)) / RATE * 1000)

    takes = [load_take(pipe), load_take(sensor), load_take(upright, up="z")]
    takes.append(load_take(slow, reading=Reading(time_unit="ms")))
    assert "y points down there; turned over" in takes[0].notes
    assert "z is up there" in takes[2].notes
    for take in takes:
        np.testing.assert_allclose(from_motion(take, {"a": [(0.0, 7.0)]})[0].angles, expected.angles, atol=2e-3)


def test_short_gaps_are_bridged_and_long_ones_refused_where_they_matter(fine, tmp_path):
    rows = table(tmp_path / "a.csv", landmarks(fine)).read_text().splitlines()
    rows[20] = rows[20].split(",", 1)[0] + "," * 24
    del rows[100:140]
    (tmp_path / "a.csv").write_text("\n".join(rows))
    take = load_take(tmp_path / "a.csv")

    assert "1 frames with missing landmarks; gaps up to 0.1 s bridged" in take.notes
    assert any(note.startswith("nothing is known for 1.3") for note in take.notes)
    assert from_motion(take, {"a": [(0.2, 2.5)]})[0].refused == ""
    with pytest.raises(FileFormatError, match=r"a: landmarks are missing at 3\.3"):
        from_motion(take, {"a": [(2.0, 4.0)]})


def test_faults_of_cuts_are_named(fine):
    take = Take("t", landmarks(fine), 1 / RATE, np.zeros(len(fine), bool), ())
    for cuts, mirror, error, message in (
        ({"a": [(44.0, 44.9)]}, {}, FileFormatError, r"a: 44 to 44.9 s is not within its 7.3. s"),
        ({"a": []}, {}, SettingsError, "`cuts of a` should be a list of at least 1"),
        ({"a": (1.0, 2.0)}, {}, SettingsError, "`cuts of a`, entry 1 should be a list, but is 1.0"),
        ({"a": [(1.0, 1.05)]}, {}, SettingsError, "has 3 frames, expected at least 6"),
        ({"../a": [(1.0, 2.0)]}, {}, SettingsError, "should be a plain name"),
        ({"a": [(1.0, 2.0)]}, {"b": "c"}, SettingsError, "mirror: `b` should be new and the image of one of a"),
    ):
        with pytest.raises(error, match=message):
            from_motion(take, cuts, mirror=mirror)
    (away,) = from_motion(take, {"a": [(1.0, 2.0)]}, retargeting=Retargeting(facing=170.0))
    assert away.refused.startswith("the chest turns away from where the take faces by 170 degrees")


def test_cuts_are_proposed_where_a_wrist_goes_out_and_comes_back(fine):
    take = Take("t", landmarks(fine), 1 / RATE, np.zeros(len(fine), bool), ())
    found = [cut for cut in propose_cuts(take) if cut.arm == "right"]

    assert len(found) == 3  # the straight is thrown three times
    assert all(cut.end_s > cut.start_s for cut in found)


def test_teach_from_writes_actions_with_a_report(fine, tmp_path, capsys):
    path = table(tmp_path / "take.csv", landmarks(fine))
    out = tmp_path / "out"
    assert main(["teach", "--from", str(path), "--out", str(out)]) == 0
    assert (out / "cuts.png").exists()
    assert "--cut NAME=" in capsys.readouterr().out

    words = ["--cut", "right=0.2:2.6", "--mirror", "left=right", "--no-film"]
    assert main(["teach", "--from", str(path), "--out", str(out), *words]) == 0
    record = json.loads((out / "record.json").read_text())
    assert record["written"] == ["right", "left"]
    assert record["actions"]["left"]["distances"]["right"] > 10
    assert record["actions"]["right"]["self_contact_share"] == 0
    assert load_demonstrations(out).names == ("left", "right")
    assert load_trajectory(out / "left.csv", 0.02).shape[1] == 8
    assert (out / "left.png").exists()
    assert "2 of 2 actions written" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--cut", "a=1:2"], "--cut, --mirror, --up and what a take does not say need --from"),
        (["--from", "x.csv", "--seed", "3"], "--seed is not for --from"),
        (["--from", "x.csv", "--fill", "rest"], "--fill is not for --from"),
        (["--from", "x.csv"], "no take at x.csv"),
        (["--from", "x.csv", "--cut", "a=1:2", "--cut", "b=2:3"], "--cut is given twice"),
    ],
)
def test_mistakes_get_one_line_and_exit_code_2(words, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["teach", "--out", "out", *words]) == 2
    assert message in capsys.readouterr().err


def test_a_missing_extra_is_named(tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "pybvh", None)
    (tmp_path / "a.bvh").write_text("HIERARCHY\n")
    with pytest.raises(MissingDependencyError, match=r"a BVH file needs .* pip install .creative-nao\[mocap\]"):
        load_take(tmp_path / "a.bvh")
