import numpy as np
import pytest

from creative_nao.demonstrations import Demonstrations
from creative_nao.errors import NotFoundError, SettingsError, ShapeError
from creative_nao.joints import JOINTS

REST = np.array([0.5, -0.1, 0.8, 1.0, 0.5, 0.1, -0.8, -1.0])


def still(n_steps=4):
    return np.tile(REST, (n_steps, 1))


def test_it_keeps_own_float64_copies():
    mine = still().astype(np.float32)
    demos = Demonstrations(("a",), [mine])
    mine[:] = 0
    np.testing.assert_allclose(demos.trajectories[0], still(), rtol=1e-7)
    assert demos.trajectories[0].dtype == np.float64


def test_lengths_and_joints_are_the_users_choice():
    demos = Demonstrations(("a", "b"), [np.zeros((3, 2)), np.zeros((5, 2))], dt_s=0.02, joints=("hip", "knee"))
    assert (len(demos), demos.n_actions, demos.n_joints, demos.dt_s) == (2, 2, 2, 0.02)


def test_the_initial_posture_is_the_mean_first_posture():
    demos = Demonstrations(("a", "b"), [np.array([[0.0], [9.0]]), np.array([[1.0], [9.0]])], joints=("wheel",))
    assert demos.initial_posture.tolist() == [0.5]


def test_the_largest_speed_is_over_all_joints_and_actions():
    demos = Demonstrations(("a", "b"), [np.array([[0.0], [0.3]]), np.array([[0.0], [-0.6]])], 0.15, ("wheel",))
    assert demos.max_speed == pytest.approx(4.0)


def test_a_trajectory_is_found_by_its_name():
    demos = Demonstrations(("wave", "clap"), [still(), still(5)])
    assert len(demos.trajectory("clap")) == 5
    with pytest.raises(NotFoundError, match=r"no basic action `wav` \(did you mean `wave`\?\)"):
        demos.trajectory("wav")


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"names": ("a", "a")}, SettingsError, "`names` should be a list of different names"),
        ({"names": ()}, SettingsError, "`names` should be a list of at least 1 entries"),
        ({"names": 3}, SettingsError, "`names` should be a list, but is 3"),
        ({"dt_s": "x"}, SettingsError, "`dt_s` should be a number, but is 'x'"),
        ({"trajectories": None}, ShapeError, "`trajectories` should hold one trajectory for each of the 2 names"),
        ({"names": ("a",)}, ShapeError, "each of the 1 names, but holds 2"),
        (
            {"joints": ("hip",)},
            ShapeError,
            r"`trajectories\[0\] \(a\)` should have shape \(n_steps >= 2, 1\).*\(4, 8\)",
        ),
        ({"dt_s": 0.0}, SettingsError, "`dt_s` should be a positive number of seconds, but is 0.0"),
        ({"dt_s": float("nan")}, SettingsError, "`dt_s` should be a finite number, but is nan"),
        ({"record": {"when": object()}}, SettingsError, r"`record` should be bounded JSON \(it holds object\)"),
        ({"record": {"loss": float("nan")}}, SettingsError, r"`record` should be bounded JSON \(it holds nan\)"),
        ({"trajectories": [still(), still(1)]}, ShapeError, r"`trajectories\[1\] \(b\)` should have shape"),
        ({"trajectories": [still(), "wave"]}, ShapeError, r"`trajectories\[1\] \(b\)` should be an array of numbers"),
    ],
)
def test_what_does_not_fit_is_refused(change, error, text):
    whole = {"names": ("a", "b"), "trajectories": [still(), still()]}
    with pytest.raises(error, match=text):
        Demonstrations(**(whole | change))


def test_an_angle_that_is_no_number_is_refused_with_its_place():
    broken = still()
    broken[2, 1] = np.nan
    with pytest.raises(ShapeError, match=r"`trajectories\[0\] \(a\)` .* RShoulderRoll at step 2 is not a number"):
        Demonstrations(("a",), [broken])


def test_an_angle_beyond_the_joints_range_is_refused_with_the_range():
    broken = still()
    broken[3, 3] = 1.6
    with pytest.raises(
        ShapeError, match=r"RElbowRoll at step 3 is 1.6, outside the joint's range .* 0.0349 and 1.5446"
    ):
        Demonstrations(("a",), [broken])


def test_degrees_are_recognised():
    with pytest.raises(ShapeError, match="looks like degrees, expected radians"):
        Demonstrations(("a",), [np.degrees(still())])


def test_a_reading_just_beyond_the_range_passes():
    edge = still()
    edge[0, 3] = 1.5446 + 0.01
    assert Demonstrations(("a",), [edge]).joints == JOINTS


def test_it_is_shown_in_few_lines_and_as_curves():
    demos = Demonstrations(tuple(f"wave_{k}" for k in range(20)), [still()] * 20)
    assert repr(demos).startswith("Demonstrations of 8 joints at 0.15 s: wave_0 (4 postures), wave_1 (4 postures), ")
    assert repr(demos).endswith("wave_7 (4 postures), and 12 more")
    assert demos._repr_png_().startswith(b"\x89PNG")
    assert Demonstrations(("a",), [still()])._repr_png_().startswith(b"\x89PNG")
