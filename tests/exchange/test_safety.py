"""Nothing a joint cannot do leaves the project unsaid."""

import numpy as np
import pytest

from creative_nao import exchange
from creative_nao.demonstrations import load_demonstrations
from creative_nao.errors import SettingsError
from creative_nao.exchange import Motion, UnsafeMotionError, inspect, made_safe
from creative_nao.joints import ENCODER_STEP_RAD, MAX_SPEED_RAD_S

ELBOW = ("RElbowRoll",)  # range 0.0349 to 1.5446, at most 6.47 rad/s


def elbow(*angles, dt_s=0.5):
    return Motion(np.array(angles)[:, None], dt_s, ELBOW)


def test_the_basic_actions_are_safe():
    demos = load_demonstrations()
    assert not any(inspect(Motion(trajectory, demos.dt_s)) for trajectory in demos.trajectories)


def test_each_stretch_beyond_a_range_is_found_with_its_worst_moment():
    (first, second) = inspect(elbow(1.0, 1.6, 1.7, 1.5, 0.0, 0.5))

    assert (first.start_s, first.end_s, first.worst_s) == (0.5, 1.0, 1.0)
    assert first.excess == pytest.approx(1.7 - 1.5446)
    assert (second.start_s, second.end_s, second.worst) == (2.0, 2.0, 0.0)
    assert "RElbowRoll at 0.50 to 1.00 s is up to 0.1554 rad beyond its range of 0.0349 to 1.5446 rad" in str(first)


def test_a_speed_is_found_on_both_sides_of_the_limit():
    step = MAX_SPEED_RAD_S["RElbowRoll"] * 0.1

    assert inspect(elbow(0.5, 0.5 + 0.999 * step, dt_s=0.1)) == []
    (found,) = inspect(elbow(0.5, 0.5 + 1.001 * step, dt_s=0.1))
    assert (found.kind, found.start_s, found.end_s) == ("speed", 0.0, 0.1)


@pytest.mark.parametrize("name", ["a.csv", "a.npz", "a.py", "a.json", "a.yaml", "a.motion"])
def test_every_exporter_refuses_what_is_unsafe_and_writes_nothing(name, tmp_path):
    for motion in (elbow(1.0, 1.6), elbow(0.1, 1.4, dt_s=0.1)):
        with pytest.raises(UnsafeMotionError, match=r"unsafe movement: RElbowRoll at .*--unsafe clip"):
            exchange.write(tmp_path / name, motion)
    assert not list(tmp_path.iterdir())


def test_clip_sets_angles_to_the_end_of_the_range_and_says_which():
    safe, changes = made_safe(elbow(1.0, 1.6, 1.7, 1.5), "clip")

    assert safe.angles[:, 0].tolist() == [1.0, 1.5446, 1.5446, 1.5]
    assert len(changes) == 1
    assert changes[0].startswith("clipped: RElbowRoll at 0.50 to 1.00 s")
    assert inspect(safe) == []


def test_clip_cures_speed_by_time_and_keeps_the_shape():
    fast = elbow(0.1, 1.4, 0.2, dt_s=0.1)  # 13 rad/s: 2.009 times too fast
    safe, (sentence,) = made_safe(fast, "clip")

    assert np.array_equal(safe.angles, fast.angles)
    assert safe.dt_s == 0.21  # the next whole 10 ms
    assert "would move at 13.00 rad/s at 0.00 s, its motor at 6.47 rad/s at most" in sentence
    assert "every tick lasts 0.21 s instead of 0.1 s (2.100 times)" in sentence
    assert inspect(safe) == []


def test_keep_changes_nothing_and_says_what_is_unsafe(tmp_path):
    motion = elbow(0.1, 1.7, dt_s=0.1)
    out = exchange.write(tmp_path / "a.npz", motion, unsafe="keep")

    assert np.array_equal(exchange.read(out.path, joints=ELBOW).motion.angles, motion.angles)
    assert [sentence.split(":")[0] for sentence in out.changes] == ["unsafe, kept"] * 2
    with pytest.raises(SettingsError, match="a robot plays naoqi, use clip"):
        exchange.write(tmp_path / "a.py", motion, unsafe="keep")


def test_a_count_of_the_encoder_beyond_a_range_is_no_reason_to_refuse():
    motion = elbow(1.0, 1.5446 + 0.9 * ENCODER_STEP_RAD)
    safe, changes = made_safe(motion)

    assert safe.angles[1, 0] == 1.5446
    assert "at most one encoder count beyond" in changes[0]


def test_joints_without_known_ranges_are_not_sent_to_a_robot(tmp_path):
    head = Motion(np.zeros((3, 1)), 0.1, ("HeadYaw",))

    with pytest.raises(UnsafeMotionError, match="HeadYaw is not one of the arm joints whose ranges are known; leave"):
        exchange.write(tmp_path / "a.py", head, unsafe="clip")
    assert exchange.write(tmp_path / "a.csv", head, unsafe="keep").changes


def test_an_unknown_wish_is_told():
    with pytest.raises(SettingsError, match="one of refuse, clip, keep, but is 'yes'"):
        made_safe(elbow(1.0, 1.1), "yes")
