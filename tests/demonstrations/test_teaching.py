import json

import numpy as np
import pytest

from creative_nao.cli.teach import TeachSettings
from creative_nao.cli.teach import run as teach_command
from creative_nao.demonstrations import ACTIONS, Demonstrations, GuidanceVariation, load_demonstrations
from creative_nao.demonstrations.keyframes import GUARD, both_arms
from creative_nao.demonstrations.teaching import Grip, Teacher, as_demonstrations, shortcomings, teach
from creative_nao.errors import NotFoundError, SettingsError
from creative_nao.joints import ENCODER_STEP_RAD, JOINTS

NONE = GuidanceVariation(0, 0, 0, 0)


def rng(seed=0):
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def lessons():
    return teach(rng())


@pytest.fixture(scope="module")
def straight():
    return Teacher(variation=NONE).teach("right_straight", rng())


def test_the_arms_are_dragged_and_not_set(lessons):
    """They lag where it is fast, and follow within the strength of a hand."""
    for lesson in lessons:
        off = np.abs(lesson.recorded - lesson.led)
        assert 0.03 < off.max() < 0.25, lesson.name
        assert off.mean() < 0.02, lesson.name
        assert 2.0 < lesson.mean_pull_n < lesson.max_pull_n < 20.0, lesson.name


def test_limp_arms_that_nobody_holds_fall():
    dropped = Teacher(Grip(0, 0, 0, 0), NONE).teach("left_jab", rng())
    pitch = JOINTS.index("LShoulderPitch")
    assert dropped.recorded[-1, pitch] > 1.2  # hanging down is 1.57
    assert dropped.max_pull_n == 0.0


def test_a_firm_hand_leads_more_exactly_than_a_soft_one(straight):
    soft = Teacher(Grip(stiffness_n_m=200.0, turn_stiffness_nm=1.0), NONE).teach("right_straight", rng())
    assert np.abs(soft.recorded - soft.led).mean() > 2 * np.abs(straight.recorded - straight.led).mean()


def test_a_hand_is_no_stronger_than_it_is_said_to_be():
    weak = Teacher(Grip(max_force_n=4.0), NONE).teach("right_straight", rng())
    assert weak.max_pull_n <= 200.0
    assert np.abs(weak.recorded - weak.led).max() > 0.3


def test_the_body_is_held_and_only_the_arms_move(straight):
    moved = np.ptp(straight.frames, axis=0)
    assert np.sort(moved)[-4:].min() > 0.25
    assert np.sort(moved)[: len(moved) - 4].max() < 0.01


def test_without_variation_what_is_led_is_what_is_meant(straight):
    np.testing.assert_allclose(straight.led, straight.meant, atol=1e-12)


def test_the_recording_holds_whole_encoder_counts(lessons):
    counts = np.array([lesson.recorded for lesson in lessons]) / ENCODER_STEP_RAD
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)


def test_one_seed_gives_one_recording_and_no_other_action_matters(lessons):
    again = teach(rng(), actions=("left_hook",))[0]
    np.testing.assert_array_equal(again.recorded, lessons[2].recorded)
    assert not np.array_equal(teach(rng(1), actions=("left_hook",))[0].recorded, lessons[2].recorded)


def test_the_shipped_six_are_what_seed_zero_gives(lessons):
    """Another version or processor may round an encoder count otherwise."""
    for lesson, shipped in zip(lessons, load_demonstrations().trajectories, strict=True):
        np.testing.assert_allclose(lesson.recorded, shipped, atol=0.01, err_msg=lesson.name)


def test_an_unknown_action_cannot_be_taught():
    with pytest.raises(NotFoundError, match="no basic action `kick`"):
        teach(rng(), actions=("kick",))


def test_a_hand_out_of_range_is_refused_by_name():
    with pytest.raises(SettingsError, match="`stiffness_n_m` should be at least 0, but is -1"):
        Grip(stiffness_n_m=-1)


def test_what_was_taught_has_no_shortcomings(lessons):
    assert shortcomings(lessons, as_demonstrations(lessons)) == []


def test_each_shortcoming_is_told(lessons):
    trajectories = [lesson.recorded.copy() for lesson in lessons]
    trajectories[0][3, 3] = 1.56  # RElbowRoll, at most 1.5446
    trajectories[1][-1] = both_arms(GUARD, GUARD) + 0.13
    trajectories[2][20, 0] += 1.0
    told = shortcomings(lessons, Demonstrations(tuple(ACTIONS), trajectories))
    assert told[0] == "left_jab leaves the range of RElbowRoll by 0.015 rad."
    assert "right_straight ends 0.130 rad from the guard" in told[1]
    assert "the largest speed is" in told[2]
    assert len(told) == 3


def test_the_command_writes_what_can_be_loaded(tmp_path, capsys, lessons):
    assert teach_command(TeachSettings(out=tmp_path / "mine")) == 0
    demos = load_demonstrations(tmp_path / "mine")
    assert demos.names == tuple(ACTIONS)
    np.testing.assert_array_equal(demos.trajectories[5], lessons[5].recorded)
    assert demos.record["taught"]["command"] == "creative-nao teach --out DIR --seed 0"
    assert "Largest speed 5." in capsys.readouterr().out


def test_the_command_prints_its_figures_as_json(tmp_path, capsys):
    assert teach_command(TeachSettings(out=tmp_path, seed=1, json=True)) == 0
    figures = json.loads(capsys.readouterr().out)
    assert set(figures["actions"]) == set(ACTIONS)
    assert figures["smallest_distance"] >= 20.0
    assert figures["shortcomings"] == []


def test_the_command_says_when_a_recording_is_unfit(tmp_path, capsys):
    settings = TeachSettings(out=tmp_path, drift_rad=0.2)
    assert teach_command(settings) == 1
    record = json.loads((tmp_path / "record.json").read_text())
    assert record["shortcomings"]
    assert record["command"].endswith("--seed 0 --drift-rad 0.2")
    assert record["shortcomings"][0] in capsys.readouterr().err


def test_the_command_refuses_what_cannot_be(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(SettingsError, match=r"`out` should be a folder, but .*file is a file"):
        teach_command(TeachSettings(out=tmp_path / "file"))
    with pytest.raises(SettingsError, match="`seed` should be 0 or larger, but is -1"):
        teach_command(TeachSettings(out=tmp_path, seed=-1))
    with pytest.raises(SettingsError, match=r"`tremor_rad` should be at most 0.1, but is 3"):
        teach_command(TeachSettings(out=tmp_path, tremor_rad=3))
