import numpy as np
import pytest

from creative_nao.demonstrations import load_trajectory, save_trajectory
from creative_nao.errors import CreativeNaoError, FileFormatError, NotFoundError, SettingsError, ShapeError
from creative_nao.exchange import formats
from creative_nao.joints import JOINTS

HEADER = ",".join(["time_s", *JOINTS])
POSTURE = "0.5,-0.1,0.8,1.0,0.5,0.1,-0.8,-1.0"
GOOD = [HEADER, *(f"{0.15 * k:.2f},{POSTURE}" for k in range(5))]


def written(tmp_path, lines, encoding="utf-8"):
    path = tmp_path / "wave.csv"
    path.write_bytes("\n".join(lines).encode(encoding))
    return path


def changed(line, old, new, lines=GOOD):
    return [text.replace(old, new, 1) if number == line else text for number, text in enumerate(lines, start=1)]


def random_trajectory(n_steps=50):
    rng = np.random.default_rng(0)
    return np.array([0.5, -0.1, 0.8, 1.0, 0.5, 0.1, -0.8, -1.0]) + 0.1 * rng.uniform(-1, 1, (n_steps, 8))


def test_what_is_saved_is_read_back_to_the_bit(tmp_path):
    trajectory = random_trajectory()
    np.testing.assert_array_equal(load_trajectory(save_trajectory(tmp_path / "a.csv", trajectory)), trajectory)


def test_columns_may_stand_in_any_order_and_more_may_follow(tmp_path):
    lines = [",".join(["comment", *reversed(HEADER.split(","))])]
    lines += [",".join(["x", *reversed(line.split(","))]) for line in GOOD[1:]]
    np.testing.assert_array_equal(
        load_trajectory(written(tmp_path, lines)), [[float(x) for x in POSTURE.split(",")]] * 5
    )


def test_the_columns_of_another_robot_can_be_read(tmp_path):
    path = save_trajectory(tmp_path / "a.csv", np.arange(6.0).reshape(3, 2), 0.15, ("hip", "knee"))
    np.testing.assert_array_equal(load_trajectory(path, joints=("knee", "hip"))[:, 1], [0.0, 2.0, 4.0])
    np.testing.assert_array_equal(load_trajectory(path, joints=None)[:, 0], [0.0, 2.0, 4.0])


def test_another_rate_is_brought_to_the_tick(tmp_path):
    path = save_trajectory(tmp_path / "a.csv", random_trajectory(101), 0.02)
    assert load_trajectory(path, dt_s=0.1).shape == (21, 8)
    assert load_trajectory(path, dt_s=0.02).shape == (101, 8)


def test_spaces_blank_lines_and_a_byte_order_mark_do_no_harm(tmp_path):
    lines = [GOOD[0].replace(",", " , "), "", *GOOD[1:], "", ""]
    assert load_trajectory(written(tmp_path, lines, "utf-8-sig")).shape == (5, 8)


@pytest.mark.parametrize(
    ("lines", "text"),
    [
        ([], r"is empty, expected a movement"),
        (GOOD[:1], r"has 0 postures below its header, expected at least 2"),
        (GOOD[:2], r"has 1 postures below its header, expected at least 2"),
        (changed(1, "RElbowYaw", "RElbowJaw"), r"`RElbowYaw` is missing \(did you mean `RElbowJaw`\?\)"),
        (
            changed(1, "time_s", "clock"),
            r"no column `time_s` for the time; the first line has clock, RSh.* --time-column",
        ),
        (GOOD[1:], r"no column `time_s` for the time; the first line has 0.00,"),
        (
            changed(1, "LElbowRoll", "time_s"),
            r"2 columns may be the time: time_s, time_s; say which with --time-column",
        ),
        (changed(3, "0.8", "fast"), r"line 3: `RElbowYaw` is `fast`, expected a number"),
        (changed(3, "0.8", ""), r"line 3: `RElbowYaw` is ``, expected a number"),
        (changed(3, "0.8", "1_0"), r"line 3: `RElbowYaw` is `1_0`, expected a number"),
        (changed(3, "0.8", '"0,8"'), r"line 3: `RElbowYaw` is `0,8`, expected a number; a decimal comma\?"),
        (changed(3, "0.8", "nan"), r"line 3: `RElbowYaw` is `nan`, expected a finite number"),
        (changed(3, "0.8", "-inf"), r"line 3: `RElbowYaw` is `-inf`, expected a finite number"),
        (changed(4, "0.30", "0.15"), r"line 4: times of RShoulderPitch should rise, but 0.15 s follows 0.15 s"),
        (changed(4, "0.8", "2.2"), r"line 4: `RElbowYaw` is 2.2, outside the joint's range between -2.0857 and 2.0857"),
        (
            changed(4, "0.8", "45.8"),
            r"line 4: `RElbowYaw` is 45.8, looks like degrees, but 98% of the angles could be radians; say",
        ),
        (changed(5, "0.8", "0.8,0.8"), r"line 5: has 10 columns, expected 9 as the header; perhaps a comma is the dec"),
        (changed(5, ",0.8", ""), r"line 5: has 8 columns, expected 9 as the header"),
        (changed(6, "0.60", "600000"), r"are the times in seconds, not milliseconds\?"),
        ([HEADER, f"0.0,{POSTURE}", f"0.1,{POSTURE}"], r"lasts 0.1 s, shorter than one tick of 0.15 s"),
    ],
)
def test_a_fault_is_told_with_file_and_place(tmp_path, lines, text):
    with pytest.raises(FileFormatError, match=rf"wave.csv: .*{text}") as caught:
        load_trajectory(written(tmp_path, lines))
    assert "\n" not in str(caught.value)


def test_blank_lines_count_in_the_line_number(tmp_path):
    lines = [*GOOD[:2], "", *changed(3, "0.8", "fast")[2:]]
    with pytest.raises(FileFormatError, match="line 4: `RElbowYaw` is `fast`"):
        load_trajectory(written(tmp_path, lines))


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1"])
def test_another_encoding_is_named_as_such(tmp_path, encoding):
    lines = changed(1, "time_s", "größe,time_s")
    with pytest.raises(FileFormatError, match=r"is not UTF-8 text; .*save the file in UTF-8"):
        load_trajectory(written(tmp_path, lines, encoding))


def test_an_oversized_file_is_refused_unread(tmp_path, monkeypatch):
    monkeypatch.setattr(formats, "MAX_FILE_BYTES", 100)
    with pytest.raises(FileFormatError, match="bytes, expected at most 100"):
        load_trajectory(written(tmp_path, GOOD))


@pytest.mark.parametrize("content", [b"\x00" * 50, b'"', b"a\rb\n\x00,", b",,,\n,,,", b"time_s\n1\n2\n", b'"a,b\n1,2'])
def test_no_content_breaks_the_reader(tmp_path, content):
    path = tmp_path / "odd.csv"
    path.write_bytes(content)
    with pytest.raises(CreativeNaoError):
        load_trajectory(path)


def test_a_missing_file_is_not_found(tmp_path):
    with pytest.raises(NotFoundError, match=r"no movement at .*nothing.csv"):
        load_trajectory(tmp_path / "nothing.csv")


def test_arguments_of_another_kind_are_named(tmp_path):
    for arguments, text in (
        ((3,), "`path` should be text, but is 3"),
        (("a.csv", "fast"), "`dt_s` should be a number, but is 'fast'"),
        ((tmp_path / "wave.csv", 0.15, "RElbowYaw"), "`joints` should be a list, but is 'RElbowYaw'"),
    ):
        written(tmp_path, GOOD)
        with pytest.raises(SettingsError, match=text):
            load_trajectory(*arguments)


def test_a_tick_must_be_positive(tmp_path):
    with pytest.raises(SettingsError, match="`dt_s` should be a positive number of seconds, but is -1"):
        load_trajectory(written(tmp_path, GOOD), dt_s=-1)


def test_only_a_finite_trajectory_of_the_joints_is_saved(tmp_path):
    with pytest.raises(ShapeError, match=r"`trajectory` should have shape \(n_steps >= 1, 8\).* has \(8, 50\)"):
        save_trajectory(tmp_path / "a.csv", random_trajectory().T)
    with pytest.raises(ShapeError, match="`trajectory` should hold finite angles"):
        save_trajectory(tmp_path / "a.csv", random_trajectory() * np.nan)
    assert not (tmp_path / "a.csv").exists()
