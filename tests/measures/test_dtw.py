import subprocess
import sys

import numpy as np
import pytest
from dtaidistance import dtw_ndim
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures import _dtw_kernels, dtw, dtw_matrix
from creative_nao.measures import dtw as dtw_function
from creative_nao.measures.dtw import cumulative_cost

# The public function hides the module of the same name.
dtw_module = sys.modules[dtw_function.__module__]

angles = st.floats(-3.0, 3.0, width=32)


def trajectories(n_joints=8):
    return st.integers(1, 12).flatmap(lambda n: arrays(np.float64, (n, n_joints), elements=angles))


def dtw_reference(a, b):
    return cumulative_cost(a, b)[-1][-1]


def walks(rng, lengths, n_joints=8):
    return [np.cumsum(rng.normal(scale=0.2, size=(n, n_joints)), axis=0) for n in lengths]


@settings(max_examples=60, deadline=None)
@given(trajectories(), trajectories())
def test_it_is_the_reference(a, b):
    assert dtw(a, b) == pytest.approx(dtw_reference(a, b), rel=1e-12, abs=1e-12)


@settings(max_examples=60, deadline=None)
@given(trajectories(), trajectories())
def test_it_is_symmetric_to_the_bit_and_never_negative(a, b):
    assert dtw(a, b) == dtw(b, a) >= 0.0


@settings(max_examples=40, deadline=None)
@given(trajectories())
def test_a_trajectory_is_at_distance_zero_of_itself_and_of_itself_slowed_down(a):
    assert dtw(a, a) == 0.0
    assert dtw(a, np.repeat(a, 3, axis=0)) == 0.0


def test_two_libraries_agree():
    """dtaidistance with the local cost of our definition, on lengths from 1 to 90."""
    rng = np.random.default_rng(0)
    a, b = walks(rng, rng.integers(1, 90, 40)), walks(rng, rng.integers(1, 90, 5))
    theirs = [[dtw_ndim.distance(x, y, inner_dist="euclidean") for y in b] for x in a]
    np.testing.assert_allclose(dtw_matrix(a, b), theirs, rtol=1e-12)
    np.testing.assert_allclose(dtw_matrix(a, b, np.float32), theirs, rtol=2e-6)


@pytest.mark.parametrize(
    ("a", "b", "distance"),
    [
        ([[0.0, 0.0]], [[3.0, 4.0]], 5.0),  # the Euclidean distance, not its square
        ([[0.0], [0.0], [0.0]], [[1.0]], 3.0),  # the one posture is compared with all three
        ([[0.0], [1.0], [2.0]], [[0.0], [0.0], [1.0], [2.0]], 0.0),  # waiting costs nothing
        ([[0.0], [1.0], [2.0]], [[0.0], [2.0]], 1.0),  # the middle one has to go to either
        ([[1.0]] * 50, [[1.2]] * 50, 10.0),  # no normalisation by length: the threshold of the paper
        ([[0.0], [4.0]], [[4.0], [0.0]], 8.0),  # ends are compared with ends
    ],
)
def test_distances_done_by_hand(a, b, distance):
    assert dtw(a, b) == pytest.approx(distance, abs=1e-12)
    assert dtw_reference(np.array(a), np.array(b)) == pytest.approx(distance, abs=1e-12)


@pytest.mark.parametrize("n_joints", [1, 2, 7, 8, 9, 16, 26])
def test_any_number_of_joints_counts(n_joints):
    rng = np.random.default_rng(n_joints)
    a, b = walks(rng, [5, 12, 7], n_joints), walks(rng, [9, 4], n_joints)
    expected = [[dtw_reference(x, y) for y in b] for x in a]
    np.testing.assert_allclose(dtw_matrix(a, b), expected, rtol=1e-12)


def test_joints_that_are_always_zero_change_no_bit():
    rng = np.random.default_rng(1)
    a, b = walks(rng, [20, 31], 5), walks(rng, [17], 5)
    wider = dtw_matrix([np.pad(x, ((0, 0), (0, 3))) for x in a], [np.pad(x, ((0, 0), (0, 3))) for x in b])
    np.testing.assert_array_equal(dtw_matrix(a, b), wider)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_threads_change_no_bit(dtype, monkeypatch):
    rng = np.random.default_rng(2)
    a, b = walks(rng, rng.integers(5, 40, 300)), walks(rng, [30, 9, 21])
    serial = dtw_matrix(a, b, dtype), dtw_matrix(a, dtype=dtype)
    monkeypatch.setattr(dtw_module, "SERIAL_CELLS", 0)
    np.testing.assert_array_equal(dtw_matrix(a, b, dtype), serial[0])
    np.testing.assert_array_equal(dtw_matrix(a, dtype=dtype), serial[1])


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_company_and_order_change_no_bit(dtype):
    rng = np.random.default_rng(3)
    a, b = walks(rng, rng.integers(5, 40, 150)), walks(rng, [30, 9, 21])
    together = dtw_matrix(a, b, dtype)
    order = rng.permutation(len(a))
    np.testing.assert_array_equal(dtw_matrix([a[k] for k in order], b, dtype), together[order])
    np.testing.assert_array_equal(np.concatenate([dtw_matrix(a[:7], b, dtype), dtw_matrix(a[7:], b, dtype)]), together)
    np.testing.assert_array_equal(dtw_matrix(b, a, dtype).T, together)
    np.testing.assert_array_equal(dtw_matrix(a, dtype=dtype)[:, :3], dtw_matrix(a, a[:3], dtype))


def test_a_set_against_itself_is_symmetric_with_zeros_on_the_diagonal():
    a = walks(np.random.default_rng(4), [30] * 70 + [12] * 20)
    distances = dtw_matrix(a)
    np.testing.assert_array_equal(distances, distances.T)
    np.testing.assert_array_equal(np.diag(distances), 0.0)
    assert (distances + np.eye(90) > 0).all()


def test_one_array_is_the_list_of_its_trajectories():
    a = np.random.default_rng(5).normal(size=(20, 15, 8))
    np.testing.assert_array_equal(dtw_matrix(a, a[:2]), dtw_matrix(list(a), list(a[:2])))
    np.testing.assert_array_equal(dtw_matrix(a[::2, ::3], a[:2]), dtw_matrix(list(a[::2, ::3]), list(a[:2])))


def test_integers_and_float32_are_read_exactly():
    a, b = np.array([[0], [3]]), np.array([[1.5], [2.5]], dtype=np.float32)
    assert dtw(a, b) == 2.0


def test_an_empty_set_has_no_distances():
    some = walks(np.random.default_rng(6), [4, 5])
    assert dtw_matrix([], some).shape == (0, 2)
    assert dtw_matrix(some, []).shape == (2, 0)


@pytest.mark.parametrize(
    ("a", "b", "text"),
    [
        ([1.0, 2.0], [[1.0]], r"`a` should be an array of numbers of shape \(n_steps, n_joints\), .* shape \(2,\)"),
        ([[1.0]], [["x"]], r"`b` should be an array of numbers"),
        ("a", 1, r"`a` should be an array of numbers of shape \(n_steps, n_joints\), but has shape \(\)"),
        ([[1.0]], None, r"`b` should be an array of numbers"),
        ([[1.0]], [[1.0], [2.0, 3.0]], r"`b` should be an array of numbers"),
        ([[1.0]], np.zeros((0, 1)), r"`b` should have at least one posture and one joint, but has shape \(0, 1\)"),
        ([[1.0]], [[1.0], [np.nan]], r"`b` should hold finite values .* but is nan at step 1, joint 0"),
        ([[1.0, np.inf]], [[1.0, 0.0]], r"`a` should hold finite values .* but is inf at step 0, joint 1"),
        ([[1.0]], [[1.0, 2.0]], r"`b` should have the joints of `a`, 1 columns, but has 2"),
    ],
)
def test_a_fault_names_the_argument_and_the_place(a, b, text):
    with pytest.raises(ShapeError, match=text):
        dtw(a, b)


@pytest.mark.parametrize(
    ("a", "text"),
    [
        (np.zeros((4, 8)), r"`list_a` should be a list of .* but has shape \(4, 8\)"),
        ([np.zeros((4, 8)), np.zeros((4, 7))], r"`list_a\[1\]` should have the joints of `list_a\[0\]`, 8 .* has 7"),
        ([np.zeros((4, 8)), np.full((4, 8), np.nan)], r"`list_a\[1\]` should hold finite values"),
        ([np.zeros((4, 8)), np.zeros((0, 8))], r"`list_a\[1\]` should have at least one posture"),
    ],
)
def test_a_fault_in_a_set_names_the_trajectory(a, text):
    with pytest.raises(ShapeError, match=text):
        dtw_matrix(a)


@pytest.mark.parametrize("a", [None, 3, {"a": 1}])
def test_what_is_no_set_is_refused(a):
    with pytest.raises(ShapeError, match=r"`list_a` should be a list of .* but is "):
        dtw_matrix(a)


def test_other_types_of_number_are_refused():
    with pytest.raises(SettingsError, match="`dtype` should be float32 or float64, but is 'angle'"):
        dtw_matrix(np.zeros((1, 2, 8)), dtype="angle")
    with pytest.raises(SettingsError, match="`dtype` should be float32 or float64, but is int64"):
        dtw_matrix(np.zeros((1, 2, 8)), dtype=np.int64)


def test_importing_the_measures_loads_no_compiler():
    code = "import sys, creative_nao.measures; print([m for m in ('numba', 'torch', 'mujoco') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_a_forked_process_can_still_measure(monkeypatch):
    """Threads do not survive a fork; a child that started them again would be ended by their library."""
    monkeypatch.setattr(dtw_module, "_threads_started_in", 1)
    monkeypatch.setattr(dtw_module, "SERIAL_CELLS", 0)

    monkeypatch.setattr(_dtw_kernels, "fill_parallel", None)
    assert dtw([[0.0]], [[2.0]]) == 2.0


@pytest.mark.slow
def test_it_works_where_no_folder_can_be_written(tmp_path):
    """Without a place for compiled code numba raises at import; the kernel is then compiled in memory."""
    code = (
        "import numba.core.caching as c\n"
        "(getattr(c, 'CacheImpl', None) or c._CacheImpl)._locator_classes = []\n"
        "from creative_nao.measures import dtw\n"
        "print(dtw([[0.0]], [[2.0]]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout == "2.0\n", done.stderr


def test_masked_arrays_are_refused():
    """What a mask hides is not known; the number under it would be compared."""
    from creative_nao.demonstrations import Demonstrations
    from creative_nao.measures import mean_pairwise_distance
    from creative_nao.measures.dtw import dtw_pairs

    one, gap = np.zeros((3, 8)), np.ma.masked_array(np.zeros((3, 8)), mask=np.eye(3, 8, dtype=bool))
    for call in (
        lambda: dtw(gap, one),
        lambda: dtw(one, gap),
        lambda: dtw_matrix([one, gap]),
        lambda: dtw_matrix(np.ma.stack([one, gap])),
        lambda: dtw_pairs(np.ma.stack([one, gap]), [0], [1]),
        lambda: mean_pairwise_distance([one, gap]),
        lambda: Demonstrations(("a",), [gap]),
    ):
        with pytest.raises(ShapeError, match=r"has a mask|MaskedArray"):
            call()
