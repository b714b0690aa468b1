"""Recordings as people have them: one reader, one wording; what changes the meaning is followed or refused."""

import contextlib
import json
import time
from pathlib import Path

import numpy as np
import pytest

from creative_nao import exchange
from creative_nao.cli import main
from creative_nao.demonstrations import load_demonstrations
from creative_nao.errors import FileFormatError
from creative_nao.exchange import FORMATS, Reading
from creative_nao.exchange.formats import MAX_FILE_BYTES
from creative_nao.exchange.robot_program import MAX_PYTHON_BYTES
from creative_nao.joints import JOINTS
from creative_nao.storage import MAX_YAML_BYTES

DEMOS = load_demonstrations()
JAB = DEMOS.trajectory("left_jab")
TIMES = 0.15 * np.arange(len(JAB))
HEADER = ",".join(["time_s", *JOINTS])


def table(angles=JAB, times=TIMES, header=HEADER, mark=",", point=".", digits=4):
    cells = [[f"{t:.{digits}f}", *(f"{a:.{digits}f}" for a in row)] for t, row in zip(times, angles, strict=True)]
    lines = [mark.join(cell.replace(".", point) for cell in row) for row in cells]
    return "\n".join([header.replace(",", mark), *lines]) + "\n"


def read(tmp_path, name, text, **options):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    reading = Reading(**{k: options.pop(k) for k in list(options) if k in Reading.__dataclass_fields__})
    return exchange.read(path, reading=reading, **options)


@pytest.mark.parametrize(
    ("text", "options", "note"),
    [
        (table(), {}, None),
        ("sep=;\n" + table(mark=";", point=","), {}, "the line `sep=;` followed"),
        (table(mark=";", point=","), {}, "decimal commas read as points"),
        (table(mark="\t"), {}, "columns parted by tabs"),
        (table(header=HEADER.replace("time_s", "timestamp"), times=1.7e9 + TIMES), {}, "counts from 1970 in s"),
        (table(header=HEADER.replace("time_s", "stamp"), times=1.7e12 + 1e3 * TIMES), {}, "counts from 1970 in ms"),
        (table(header=HEADER.replace("time_s", "Time (ms)"), times=1e3 * TIMES), {}, "`Time (ms)` read in ms"),
        (table(times=1e3 * TIMES), {"time_unit": "ms"}, "`time_s` read in ms"),
        (table(header=HEADER.replace("time_s", "clock")), {"time_column": "clock"}, "`clock` taken for the time"),
        (table(header=HEADER.replace("time_s", "frame")), {"rate": 1 / 0.15}, "6.66667 postures a second"),
        (table(np.degrees(JAB)), {}, "angles converted from degrees"),
        (table(np.degrees(JAB), header=HEADER.replace("Roll", "Roll_deg").replace("Pitch", "Pitch [deg]")
               .replace("Yaw", "Yaw(deg)")), {}, "angles converted from degrees"),
        (table(header="DCM/Time,".replace("DCM/Time", "time_s") + ",".join(
            f"Device/SubDeviceList/{joint}/Position/Sensor/Value" for joint in JOINTS)), {}, None),
    ],
)  # fmt: skip
def test_tables_of_many_hands_give_the_same_movement(text, options, note, tmp_path):
    found = read(tmp_path, "a.csv", text, **options)
    np.testing.assert_allclose(found.motion.angles, JAB, atol=1e-4)
    assert found.motion.dt_s == pytest.approx(0.15, abs=1e-6)
    assert note is None or any(note in said for said in found.notes)


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (table(header=HEADER.replace("time_s", "clock")), {}, "no column `time_s` for the time; .*-column, or --rate"),
        (table(), {"rate": 20.0}, "has the times `time_s`, so --rate is not for it"),
        (table(times=50.0 * np.arange(50)), {}, "are the times in seconds, not milliseconds"),
        (table(times=1e3 * TIMES), {}, r"lasts 7350 s with 150 s between postures: are the times .* --time-unit ms"),
        (HEADER + "\n", {}, "has 0 postures below its header"),
        (table(header=HEADER.replace("RElbowYaw", "RElbowYaw_deg").replace("RElbowRoll", "RElbowRoll_rad")), {},
         "columns in radians and in degrees"),
        ("sep=x\n" + table(), {}, "line 1: `sep=x`"),
    ],
)  # fmt: skip
def test_tables_that_do_not_say_enough_are_refused(text, options, message, tmp_path):
    with pytest.raises(FileFormatError, match=message):
        read(tmp_path, "a.csv", text, **options)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("a.motion", {"rate": 10.0}, "webots has times of its own, so --rate is not for it"),
        ("a.json", {"time_column": "t"}, "json has times of its own, so --time-column is not for it"),
        ("a.motion", {"time_unit": "ms"}, "says its own unit, so --time-unit is not for it"),
        ("a.json", {"unit": "degrees"}, "says its own unit, so --unit is not for it"),
    ],
)
def test_an_option_that_a_file_contradicts_is_refused(name, options, message, tmp_path):
    path = exchange.write(tmp_path / name, exchange.Motion(JAB, 0.15)).path
    with pytest.raises(FileFormatError, match=message):
        exchange.read(path, reading=Reading(**options))


def test_one_angle_out_of_place_does_not_make_degrees_of_all(tmp_path):
    wild = JAB.copy()
    wild[7, 2] = 57.3
    with pytest.raises(FileFormatError, match=r"line 9: `RElbowYaw` is 57\.3, looks like degrees, but 100% of"):
        read(tmp_path, "a.csv", table(wild))


@pytest.mark.parametrize("fill", ["guard", "rest", "zero"])
def test_one_armed_recordings_are_filled_on_request(fill, tmp_path):
    arm = ("RShoulderPitch", "RShoulderRoll", "RElbowYaw", "RElbowRoll")
    text = table(JAB[:, :4], header=",".join(["time_s", *arm]))
    with pytest.raises(FileFormatError, match=r"\(the whole left arm\) are missing; .*--fill guard or --fill rest"):
        read(tmp_path, "a.csv", text)
    found = read(tmp_path, "a.csv", text, fill=fill)

    np.testing.assert_allclose(found.motion.angles[:, :4], JAB[:, :4], atol=1e-4)
    assert (np.ptp(found.motion.angles[:, 4:], axis=0) == 0).all()
    assert f"held in the {fill} posture: LShoulderPitch, LShoulderRoll, LElbowYaw, LElbowRoll" in found.notes
    assert exchange.inspect(found.motion) == []


def test_a_mistyped_joint_is_not_filled(tmp_path):
    with pytest.raises(FileFormatError, match=r"`LElbowRoll` is missing \(did you mean `LElbowRol`\?\)"):
        read(tmp_path, "a.csv", table(header=HEADER.replace("LElbowRoll", "LElbowRol")), fill="rest")


KEYS = "names = ['RElbowYaw']\ntimes = [[1.0, 2.0]]\nkeys = [[0.1, 0.2]]\n"
PLAY = "motion.angleInterpolation(names, keys, times, True)\n"
FOLLOWED = {
    "absolute by a name": (KEYS + "yes = True\nmotion.angleInterpolation(names, keys, times, yes)\n", [[0.1, 0.2]]),
    "a print of Python 2": (KEYS + "if ready: print 'go', names\nraise E, 'x'\nx = `names`\n" + PLAY, [[0.1, 0.2]]),
    "an except of Python 2": ("try:\n  " + KEYS.replace("\n", "\n  ") + PLAY + "except E, e: print e\n", [[0.1, 0.2]]),
    "a main": (KEYS + "def main():\n  " + PLAY + "if __name__ == '__main__': main()\n", [[0.1, 0.2]]),
    "a function": ("def play(n, t, k):\n  m.angleInterpolation(n, k, t, True)\n" + KEYS + "play(names, times, keys)\n",
                   [[0.1, 0.2]]),
    "an alias that grows": ("a = [0.1]\nkeys = [a]\nnames = ['RElbowYaw']\ntimes = [[1, 2]]\na.append(0.2)\n" + PLAY,
                            [[0.1, 0.2]]),
    "units": ("names = ['RElbowYaw']\ntimes = [[1, 2]]\nkeys = [[10 * almath.TO_RAD, math.radians(20)]]\n" + PLAY,
              [np.radians([10, 20])]),
    "a name alone": ("motion.post.angleInterpolation('RElbowYaw', [0.1, 0.2], [1.0, 2.0], True)\n", [[0.1, 0.2]]),
    "two movements": (KEYS + PLAY + KEYS.replace("0.2", "0.5") + PLAY, [[0.1, 0.2], [0.1, 0.5]]),
    "two without a call": (KEYS + KEYS.replace("0.2", "0.5"), [[0.1, 0.2], [0.1, 0.5]]),
    "comments": ("#names.append('x')\n" + KEYS + "# keys[0] = 3\n'''times = []'''\n" + PLAY, [[0.1, 0.2]]),
    "attributes": ("class A:\n  def f(self):\n    self.n = ['RElbowYaw']; self.t = [[1, 2]]; self.k = [[0.1, 0.2]]\n"
                   "  def g(self):\n    self.m.angleInterpolation(self.n, self.k, self.t, True)\n", [[0.1, 0.2]]),
    "changed afterwards": (KEYS + PLAY + "keys[0][0] = 5\n", [[0.1, 0.2]]),
}  # fmt: skip


@pytest.mark.parametrize("name", FOLLOWED)
def test_programs_are_followed(name, tmp_path):
    text, expected = FOLLOWED[name]
    found = FORMATS["naoqi"].read(tmp_path / "a.py", text.encode())
    assert [one.joints for one in found] == [("RElbowYaw",)] * len(expected)
    np.testing.assert_allclose([one.angles[0] for one in found], expected)


def test_a_program_may_declare_its_encoding(tmp_path):
    text = "#!/usr/bin/env python\n# -*- coding: latin-1 -*-\n# geste d'\u00e9t\u00e9\n" + KEYS + PLAY
    assert len(FORMATS["naoqi"].read(tmp_path / "a.py", text.encode("latin-1"))) == 1
    with pytest.raises(FileFormatError, match="is not UTF-8 text"):
        FORMATS["naoqi"].read(tmp_path / "a.py", text.replace("latin-1", "utf-8").encode("latin-1"))


NOT_FOLLOWED = {
    "motion.angleInterpolation(names, keys, times, False)": "line 4: angles are relative",
    "no = 0\nmotion.angleInterpolation(names, keys, times, no)": "line 5: angles are relative",
    "motion.angleInterpolation(names, keys, times, isAbsolute=False)": "line 4: angles are relative",
    "motion.angleInterpolation(names, keys, times, not True)": "line 4: .*holds an expression",
    f"for row in times:\n  row[0] = row[0] / 2\n{PLAY}": "line 4: `for` uses `times`",
    f"row = keys[0]\nrow[1] = 5\n{PLAY}": "line 5: `row.1.` is set in place",
    f"keys[0][1] = 5\n{PLAY}": "line 4: `keys.0..1.` is set in place",
    f"keys.reverse()\n{PLAY}": "line 4: `keys` may change here",
    f"times = [[t / 2 for t in row] for row in times]\n{PLAY}": "line 4: .*holds an expression",
    f"if fast: times = [[0.5, 1.0]]\n{PLAY}": "line 4: `times` is set only under the `if` of line 4",
    f"slower(times)\n{PLAY}": "line 4: `times` may change here",
    f"def f():\n  keys[0][0] = 9\nf()\n{PLAY}": "line 5: `keys.0..0.` is set in place",
    f"def f():\n  global keys\n  keys = []\nf()\n{PLAY}": "line 5: `keys` changes in a function",
    f"exec('keys = 3')\n{PLAY}": "line 4: `exec` may change what is played",
    f"locals()['keys'] = 3\n{PLAY}": "line 4: `locals` may change what is played",
    f"f = lambda: keys.append(1)\nf()\n{PLAY}": "line 4: `keys` is used in an expression",
    f"del keys[0]\n{PLAY}": "line 4: `del` uses `keys`",
    f"from other import keys\n{PLAY}": "line 4: `from` uses `keys`",
    f"names = [f'{{a}}']\n{PLAY}": "line 4: .*holds an expression",
    f"times = [[1, 3 / 2]]\n{PLAY}": "line 4: .*holds an expression",  # 1 in Python 2
    "isAbsolute = False\n": "line 4: angles are relative",
}


@pytest.mark.parametrize("change", NOT_FOLLOWED)
def test_a_word_that_changes_the_meaning_is_refused_by_its_line(change, tmp_path):
    with pytest.raises(FileFormatError, match=NOT_FOLLOWED[change]):
        FORMATS["naoqi"].read(tmp_path / "a.py", (KEYS + change).encode())


def test_chains_stand_for_their_joints(tmp_path):
    columns = [[0.1 * k, 0.2] for k in range(4)]
    for n in (4, 6):
        text = json.dumps({"names": ["LArm"], "times": [[1, 2]] * n, "angles": (columns * 2)[:n]})
        found = read(tmp_path, "a.json", text, joints=JOINTS[4:])
        assert found.motion.angles[0].tolist() == [0.0, 0.1, 0.2, 0.30000000000000004]
        assert any(note.startswith("LArm read as LShoulderPitch, LShoulderRoll") for note in found.notes)
    with pytest.raises(FileFormatError, match="LArm make 6 joints, but there are lists for 5"):
        read(tmp_path, "a.json", json.dumps({"names": ["LArm"], "times": [[1]] * 5, "angles": [[1]] * 5}))


def timeline(keys, head='fps="25" start_frame="1" end_frame="-1"', curve='mute="0" unit="0"'):
    curves = "".join(
        f'<ActuatorCurve name="value" actuator="{joint}" {curve}>\n'
        + "".join(f'<Key frame="{frame}" value="{value:.4f}"/>\n' for frame, value in keys)
        + "</ActuatorCurve>"
        for joint in JOINTS
    )
    space = 'xmlns="http://www.aldebaran-robotics.com/schema/choregraphe/project.xsd"'
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<ChoregrapheProject {space} xar_version="3"><Box name="wave">'
        f'<Timeline enable="1" {head}><ActuatorList model="nao">{curves}</ActuatorList></Timeline></Box>'
        "</ChoregrapheProject>"
    )


def test_a_timeline_is_read_in_degrees_and_frames(tmp_path):
    found = read(tmp_path, "wave.xar", timeline([(10, 5.0), (25, 10.0), (40, 8.0)]), joints=("LElbowYaw",))
    assert np.degrees(found.motion.angles[:, 0]) == pytest.approx([5, 10, 8])
    assert (found.motion.dt_s, found.format) == (0.6, "choregraphe")
    assert {"angles converted from degrees", "frames read at 25 a second"} <= set(found.notes)
    with pytest.raises(FileFormatError, match="no timeline with curves"):
        read(tmp_path, "wave.xar", timeline([(1, 0.1), (2, 0.2)], curve='mute="1"'), joints=("LElbowYaw",))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (timeline([(10, 1.0), (40, 2.0)], head='fps="25" end_frame="30"'), "line 4: a key at frame 40, .* is 30"),
        (timeline([(10, 1.0), (40, 2.0)], head='fps="0"'), "`fps` is '0', expected frames a second"),
        (timeline([(10, 1.0)], curve='unit="gon"'), "`unit` of RShoulderPitch is 'gon'"),
        (timeline([(10, 1.0), (5, 2.0)]), "line 4: times of RShoulderPitch should rise"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "line 1: has a document type"),
        ("<a>" * 200, "line 1: has elements too deep"),
        ("<a><b></a>", "line 1: not XML"),
    ],
)  # fmt: skip
def test_timelines_that_cannot_be_followed_are_refused(text, message, tmp_path):
    with pytest.raises(FileFormatError, match=message):
        read(tmp_path, "a.xar", text)


def test_postures_need_a_rate(tmp_path):
    motors = [
        "".join(f"<Motor><name>{joint}</name><value>{row[k]:.6f}</value></Motor>" for k, joint in enumerate(JOINTS))
        for row in JAB[:5]
    ]
    text = "<poses>" + "".join(f"<position><version>2</version>{one}</position>" for one in motors) + "</poses>"
    with pytest.raises(FileFormatError, match="5 postures without times; say with --rate"):
        read(tmp_path, "a.xap", text)
    found = read(tmp_path, "a.xap", text, rate=2.0)
    assert found.motion.dt_s == 0.5
    np.testing.assert_allclose(found.motion.angles, JAB[:5], atol=1e-6)


def states(angles=JAB, start=1_700_000_000):
    documents = []
    for k, row in enumerate(angles):
        nanoseconds = k * 150_000_000
        stamp = f"{{sec: {start + nanoseconds // 10**9}, nanosec: {nanoseconds % 10**9}}}"
        documents.append(f"header:\n  stamp: {stamp}\nname: [{', '.join(JOINTS)}]\nposition: {row.tolist()}\n---\n")
    return "".join(documents)


def test_joint_states_are_read_to_the_nanosecond(tmp_path):
    found = read(tmp_path, "echo.yaml", states())
    assert (found.motion.dt_s, found.motion.angles.tolist()) == (0.15, JAB.tolist())
    with pytest.raises(FileFormatError, match="message 3 has 8 positions of 8 joints, expected one for each of"):
        read(tmp_path, "echo.yaml", states().replace("LElbowRoll", "LHand").replace("LHand", "LElbowRoll", 2))


def test_moveit_wraps_and_yaml_wraps_lines(tmp_path):
    yaml = pytest.importorskip("yaml")
    points = [
        {"positions": row.tolist(), "time_from_start": {"secs": int(t), "nsecs": round(t % 1 * 1e9)}}
        for t, row in zip(TIMES, JAB, strict=True)
    ]
    inner = {
        "joint_trajectory": {"joint_names": list(JOINTS), "points": points},
        "multi_dof_joint_trajectory": {"points": []},
    }
    for message in ({"trajectory": [inner]}, {"goal": {"trajectory": inner}}, {"planned_trajectory": inner}):
        found = read(tmp_path, "plan.yaml", yaml.safe_dump(message, width=40))
        assert found.motion.angles.tolist() == JAB.tolist()
    anchored = "angle: &a -0.1\njoint_names: [RElbowYaw]\npoints:\n" + "".join(
        f"- {{positions: [*a], time_from_start: {k}.0}}\n" for k in range(3)
    )
    assert read(tmp_path, "a.yaml", anchored, joints=("RElbowYaw",)).motion.angles[0, 0] == -0.1


def test_every_command_says_the_same_of_the_same_file(tmp_path, capsys):
    """Milliseconds, one arm, degrees: in score, infer, export and train alike."""
    folder = tmp_path / "demos"
    folder.mkdir()
    bad = {"ms": (table(times=1e3 * TIMES), "are the times in seconds, not milliseconds"),
           "arm": (table(JAB[:, :4], header=",".join(["time_s", *JOINTS[:4]])), "the whole left arm")}  # fmt: skip
    for name, (text, message) in bad.items():
        path = folder / f"{name}.csv"
        path.write_text(text)
        for words in (
            ["score", str(path)],
            ["infer", str(path)],
            ["export", "--from", str(path), "--out", str(tmp_path / "a.json")],
            ["train", "--demonstrations", str(folder), "--out", str(tmp_path / "m.safetensors")],
        ):
            assert main(words) == 2
            assert message in capsys.readouterr().err
        path.unlink()
    path = tmp_path / "degrees.csv"
    path.write_text(table(np.degrees(JAB)))
    assert main(["score", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["files"][0]["notes"][0].startswith("angles converted from degrees")


def test_several_movements_become_several_files_actions_and_rows(tmp_path, capsys):
    text = "".join(
        f"names = {list(JOINTS)}\ntimes = [{(1 + TIMES).tolist()}] * 8\nkeys = {one.T.tolist()}\n{PLAY}"
        for one in DEMOS.trajectories[:2]
    )
    folder = tmp_path / "demos"
    folder.mkdir()
    path = folder / "both.py"
    path.write_text(text)
    assert load_demonstrations(folder).names == ("both_1", "both_2")
    assert main(["export", "--from", str(path), "--out", str(tmp_path / "out.csv")]) == 0
    assert {"out-1.csv", "out-2.csv"} <= {one.name for one in tmp_path.iterdir()}
    assert main(["score", str(path)]) == 0
    assert capsys.readouterr().out.count("learned, DTW") == 2
    with pytest.raises(FileFormatError, match=r"holds 2 movements: 1 \(line 4\), 2 \(line 8\); say which one"):
        exchange.read(path)
    second = exchange.read(path, reading=Reading(movement=2)).motion.angles
    assert np.array_equal(second, DEMOS.trajectories[1])


def test_a_skeleton_holds_the_movement_and_is_no_recording(tmp_path):
    path = exchange.write(tmp_path / "a.bvh", exchange.Motion(JAB, 0.15)).path
    lines = path.read_text().splitlines()
    first = np.array(lines[-50].split(), dtype=float)
    assert lines.count("HIERARCHY") == 1
    assert "Frame Time: 0.15" in lines
    assert first[6 + 6 : 6 + 9] == pytest.approx(np.degrees(JAB[0, :3]), abs=1e-6)  # after hips, spine and head
    with pytest.raises(FileFormatError, match=r"skeleton of a body, .*teach --from a.bvh"):
        exchange.read(path)


KEY = '<Key frame="1" value="2"/>'
PYTHON, LARGEST, YAML = MAX_PYTHON_BYTES, MAX_FILE_BYTES, MAX_YAML_BYTES
FLOODS = {
    "f-strings": ("naoqi", lambda n: "f'" + "{a}" * (n // 3 - 9) + "'\n", PYTHON),
    "statements": ("naoqi", lambda n: "x = times\n" * (n // 10), PYTHON),
    "keys": ("naoqi", lambda n: "keys=[[" + "1.25," * (n // 5 - 9) + "2]]", PYTHON),
    "dots": ("naoqi", lambda n: "a.b." * (n // 4), PYTHON),
    "quotes": ("naoqi", lambda n: '"""' + "\\" * (n - 9), PYTHON),
    "cells": ("csv", lambda n: "time_s;a\n" + "1;2\n" * (n // 4 - 9), LARGEST),
    "elements": ("choregraphe", lambda n: "<Animation><ActuatorCurve>" + '<Key frame="1"/>' * (n // 17), LARGEST),
    "postures": ("webots", lambda n: "#WEBOTS_MOTION,V1.0,a\n" + "00:00:000,A,0.1\n" * (n // 17), LARGEST),
    "points": ("ros", lambda n: "points:\n" + "- {positions: [0.1], time_from_start: 1.0}\n" * (n // 44), YAML),
    "messages": ("ros", lambda n: "name: [a]\nposition: [1]\n---\n" * (n // 28), YAML),
}  # fmt: skip


def seconds(kind, text):
    started = time.process_time()
    with contextlib.suppress(FileFormatError):
        FORMATS[kind].read(Path("flood"), text.encode())
    return time.process_time() - started


@pytest.mark.parametrize("name", FLOODS)
def test_reading_takes_time_as_its_file_is_long(name):
    kind, flood, _ = FLOODS[name]
    short, long = (min(seconds(kind, flood(n)) for _ in range(2)) for n in (20_000, 80_000))
    assert long < 12 * short + 0.05


@pytest.mark.slow
@pytest.mark.parametrize("name", FLOODS)
def test_every_reader_takes_at_most_two_seconds_up_to_its_cap(name):
    kind, flood, cap = FLOODS[name]
    assert seconds(kind, flood(cap - 1_000)) < 2.0
