"""The selectable readings of the distance: each against all paths of small trajectories, tried one by one."""

import doctest
import functools
import itertools

import numpy as np
import pytest
from dtw_variants import dtw_variant_matrix

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures import dtw_matrix


@functools.cache
def paths(n, m):
    """Every warping path from (0, 0) to (n - 1, m - 1)."""
    if (n, m) == (1, 1):
        return [[(0, 0)]]
    before = [(n - 1, m), (n, m - 1), (n - 1, m - 1)]
    return [[*path, (n - 1, m - 1)] for i, j in before if i and j for path in paths(i, j)]


def brute_force(a, b, dependent, window, normalise, squared):
    if not dependent:
        columns = range(a.shape[1])
        return sum(brute_force(a[:, [k]], b[:, [k]], True, window, normalise, squared) for k in columns)
    widest = np.inf if window is None else max(window, abs(len(a) - len(b)))
    found = []
    for path in paths(len(a), len(b)):
        if max(abs(i - j) for i, j in path) <= widest:
            costs = [float(np.sum((a[i] - b[j]) ** 2)) for i, j in path]
            found.append((sum(costs if squared else np.sqrt(costs)), len(path)))
    cost, length = min(found)
    return cost / length if normalise else cost


SETTINGS = [
    {"dependent": dependent, "window": window, "normalise": normalise, "squared": squared}
    for dependent, window, normalise, squared in itertools.product(
        (True, False), (None, 0, 1, 2), (False, True), (False, True)
    )
]


@pytest.fixture
def small():
    rng = np.random.default_rng(1)
    lengths = [(1, 1), (4, 4), (3, 5), (5, 2), (1, 4)]
    return [(rng.normal(size=(n, 3)), rng.normal(size=(m, 3))) for n, m in lengths]


@pytest.mark.parametrize("settings", SETTINGS, ids=lambda s: ",".join(f"{k}={v}" for k, v in s.items()))
def test_every_reading_is_the_best_of_all_paths(settings, small):
    for a, b in small:
        assert dtw_variant_matrix([a], [b], **settings)[0, 0] == pytest.approx(brute_force(a, b, **settings), rel=1e-12)


def test_of_equally_cheap_paths_the_shortest_one_counts():
    """From 0, 0 to 0, 0, 0 every path is free; with a last step of 1 all cost 1 and the shortest has three pairs."""
    a, b = np.array([[0.0], [0.0], [1.0]]), np.zeros((3, 1))
    assert dtw_variant_matrix([a], [b], normalise=True)[0, 0] == pytest.approx(1 / 3)


def test_the_defaults_are_the_project_definition(demonstrations):
    several = list(demonstrations.trajectories)
    assert np.array_equal(dtw_variant_matrix(several, several), dtw_matrix(several, several))
    open_window = dtw_variant_matrix(several, several, window=50)  # the other kernel, the same question
    assert np.allclose(open_window, dtw_matrix(several, several), rtol=1e-12, atol=1e-12)


def test_restrictions_never_make_two_actions_closer(demonstrations):
    several = list(demonstrations.trajectories)
    free = dtw_matrix(several, several)
    narrow = [dtw_variant_matrix(several, several, window=width) for width in (0, 2, 5, 20)]
    assert all(np.all(wide <= tight + 1e-9) for tight, wide in itertools.pairwise(narrow))
    assert np.all(free <= narrow[-1] + 1e-9)
    assert np.any(narrow[0] > free + 1.0)


def test_an_array_and_a_list_give_the_same_bits(demonstrations):
    several = list(demonstrations.trajectories)
    for settings in ({"dependent": False}, {"window": 5}, {"normalise": True}, {"squared": True}):
        as_list = dtw_variant_matrix(several, several, **settings)
        assert np.array_equal(dtw_variant_matrix(np.array(several), several, **settings), as_list)
        assert not np.allclose(as_list, dtw_matrix(several, several), rtol=1e-3)


def test_no_trajectories_give_an_empty_matrix():
    assert dtw_variant_matrix([], [np.zeros((2, 1))], squared=True).shape == (0, 1)


@pytest.mark.parametrize(
    ("a", "b", "settings", "error", "text"),
    [
        ([np.zeros((2, 1))], [np.zeros((2, 1))], {"window": -1}, SettingsError, "`window` should be 0 or more"),
        ([np.zeros((2, 1))], [np.zeros((2, 2))], {"squared": True}, ShapeError, "joints of `a`, 1 columns, but has 2"),
        ([np.zeros((0, 1))], [np.zeros((2, 1))], {"squared": True}, ShapeError, r"`a\[0\]` should have shape"),
        ([np.zeros((2, 1))], [np.full((2, 1), np.nan)], {"squared": True}, ShapeError, r"`b\[0\]`.*finite.*nan"),
        ([np.zeros(3)], [np.zeros((2, 1))], {"squared": True}, ShapeError, r"`a\[0\]` should have shape"),
    ],
)
def test_mistakes_are_named(a, b, settings, error, text):
    with pytest.raises(error, match=text):
        dtw_variant_matrix(a, b, **settings)


def test_the_example_says_what_happens():
    finder = doctest.DocTestFinder().find(dtw_variant_matrix, globs={"dtw_variant_matrix": dtw_variant_matrix})
    results = [doctest.DocTestRunner().run(test) for test in finder]
    assert [(result.attempted, result.failed) for result in results] == [(1, 0)]
