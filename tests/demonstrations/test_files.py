import json
import subprocess
import sys

import numpy as np
import pytest

from creative_nao.demonstrations import (
    ACTIONS,
    Demonstrations,
    load_demonstrations,
    save_demonstrations,
    save_trajectory,
)
from creative_nao.errors import FileFormatError, NotFoundError
from creative_nao.joints import ENCODER_STEP_RAD, JOINTS, limits
from creative_nao.measures import dtw_matrix, score


@pytest.fixture(scope="module")
def six():
    return load_demonstrations()


def test_the_six_are_shipped_in_the_papers_order(six):
    assert six.names == tuple(ACTIONS)
    assert [trajectory.shape for trajectory in six.trajectories] == [(50, 8)] * 6
    assert (six.dt_s, six.joints) == (0.15, JOINTS)


def test_the_six_are_brisk_and_within_the_ranges(six):
    low, high = limits()
    assert 5.0 <= six.max_speed <= 6.0
    for trajectory in six.trajectories:
        assert (trajectory >= low).all()
        assert (trajectory <= high).all()


def test_the_six_are_encoder_readings(six):
    counts = np.concatenate(six.trajectories) / ENCODER_STEP_RAD
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)


def test_the_six_start_and_end_near_one_guard(six):
    ends = np.array([trajectory[[0, -1]] for trajectory in six.trajectories])
    assert np.abs(ends - six.initial_posture).max() < 0.12


def test_the_six_are_far_apart_and_learned(six):
    distances = dtw_matrix(six.trajectories)
    assert distances[np.triu_indices(6, 1)].min() >= 20.0
    assert set(score(six.trajectories, six).outcome) == {"learned"}


def test_the_record_says_how_the_six_were_made(six):
    taught = six.record["taught"]
    assert taught["command"].startswith("creative-nao teach --out ")
    assert taught["settings"]["seed"] == 0
    assert taught["shortcomings"] == []
    assert set(six.record["files"]) == {f"{name}.csv" for name in ACTIONS}


def test_a_set_is_saved_and_loaded_to_the_bit(tmp_path, six):
    save_demonstrations(tmp_path / "new" / "folder", six)
    again = load_demonstrations(tmp_path / "new" / "folder")
    assert again.names == six.names
    for one, other in zip(again.trajectories, six.trajectories, strict=True):
        np.testing.assert_array_equal(one, other)
    assert again.record["taught"] == six.record


def test_other_actions_follow_by_the_alphabet(tmp_path, six):
    for name in ("wave", "bow", "right_hook", "left_jab"):
        save_trajectory(tmp_path / f"{name}.csv", six.trajectories[0])
    (tmp_path / "notes.txt").write_text("not an action")
    (tmp_path / ".hidden.csv").write_text("not an action")
    assert load_demonstrations(tmp_path).names == ("left_jab", "right_hook", "bow", "wave")


def test_further_columns_are_left_out_and_named(tmp_path):
    wide = np.random.default_rng(0).uniform(-0.03, 0.03, (5, 3))
    save_trajectory(tmp_path / "a.csv", wide, joints=("LElbowYaw", "Current", "LShoulderPitch"))
    demos = load_demonstrations(tmp_path, joints=("LShoulderPitch", "LElbowYaw"))
    np.testing.assert_array_equal(demos.trajectories[0], wide[:, [2, 0]])
    assert demos.record["notes"] == {"a.csv": ["left out, not among the wanted joints: Current"]}


def test_another_robots_actions_name_the_joints(tmp_path):
    save_trajectory(tmp_path / "a.csv", np.zeros((5, 2)), joints=("hip", "knee"))
    save_trajectory(tmp_path / "b.csv", np.zeros((9, 2)), joints=("knee", "hip"))
    assert load_demonstrations(tmp_path, joints=None).joints == ("hip", "knee")


def test_a_finer_recording_is_brought_to_the_tick(tmp_path):
    save_trajectory(tmp_path / "a.csv", np.zeros((101, 1)), 0.02, ("hip",))
    demos = load_demonstrations(tmp_path, dt_s=0.1, joints=("hip",))
    assert (demos.trajectories[0].shape, demos.dt_s) == ((21, 1), 0.1)


def test_a_missing_or_empty_folder_is_not_found(tmp_path):
    with pytest.raises(
        NotFoundError, match=r"no folder of basic actions at .*; make one with `creative-nao teach --out"
    ):
        load_demonstrations(tmp_path / "nowhere")
    with pytest.raises(NotFoundError, match="no recording in"):
        load_demonstrations(tmp_path)


@pytest.mark.parametrize("content", ["{", "[" * 100_000, "\ud800".encode("utf-8", "surrogatepass").decode("latin-1")])
def test_a_broken_record_is_told(tmp_path, content):
    save_trajectory(tmp_path / "a.csv", np.zeros((5, 1)), joints=("hip",))
    (tmp_path / "record.json").write_text(content, encoding="latin-1")
    with pytest.raises(FileFormatError, match=r"record.json: (not JSON|byte 0 of the record of demonstrations is not)"):
        load_demonstrations(tmp_path, joints=("hip",))


def test_a_record_is_plain_json(tmp_path):
    save_demonstrations(tmp_path, Demonstrations(("a",), [np.zeros((2, 1))], joints=("hip",), record={"seed": 3}))
    assert json.loads((tmp_path / "record.json").read_text())["seed"] == 3


def test_loading_needs_neither_torch_nor_mujoco():
    code = (
        "import sys; from creative_nao.demonstrations import load_demonstrations; load_demonstrations();"
        "print([m for m in ('torch', 'mujoco', 'numba') if m in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
