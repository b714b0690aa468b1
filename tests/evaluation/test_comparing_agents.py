"""Comparisons over tasks: as rliable defines them, against scipy and sums by hand."""

import numpy as np
import pytest
from scipy import stats

from creative_nao.errors import ShapeError
from creative_nao.evaluation.statistics import (
    compare,
    estimate,
    estimate_over_tasks,
    iqm,
    performance_profile,
    probability_of_improvement,
    profile_band,
    resample,
)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_the_interquartile_mean_is_scipy_s_trimmed_mean(rng):
    """As rliable defines it: trim_mean(scores, 0.25) over all runs and tasks."""
    for shape in ((10, 12), (3, 5), (7, 1), (1, 1)):
        values = rng.normal(size=shape)
        assert iqm(values) == pytest.approx(stats.trim_mean(values, 0.25, axis=None), abs=1e-14)


def test_the_probability_of_improvement_is_mann_and_whitney_s_u_per_pair(rng):
    """Agarwal et al. 2021, as rliable computes it: mean over tasks of U / (n * m), ties counting half."""
    ours, theirs = rng.integers(0, 6, size=(8, 4)).astype(float), rng.integers(0, 6, size=(5, 4)).astype(float)
    per_task = [stats.mannwhitneyu(ours[:, t], theirs[:, t], alternative="greater")[0] / 40 for t in range(4)]
    assert probability_of_improvement(ours, theirs) == pytest.approx(np.mean(per_task), abs=1e-14)
    assert probability_of_improvement(theirs, ours) == pytest.approx(1.0 - np.mean(per_task), abs=1e-14)


def test_an_equal_agent_improves_half_the_time_and_a_better_one_always(rng):
    values = rng.normal(size=(6, 3))
    assert probability_of_improvement(values, values) == 0.5
    found = compare(values + 100.0, values, rng=rng)
    assert found == {"mean": 1.0, "low": 1.0, "high": 1.0}


def test_an_interval_of_a_comparison_holds_it_and_follows_the_seed(rng):
    ours, theirs = rng.normal(0.5, size=(10, 4)), rng.normal(size=(10, 4))
    found = [compare(ours, theirs, rng=np.random.default_rng(seed)) for seed in (0, 0, 1)]
    assert found[0] == found[1] != found[2]
    assert 0.0 <= found[0]["low"] < found[0]["mean"] < found[0]["high"] <= 1.0


def test_other_tasks_are_compared_with_no_one(rng):
    with pytest.raises(ShapeError, match=r"equal tasks, but have \(2, 3\) and \(2, 4\)"):
        compare(np.zeros((2, 3)), np.zeros((2, 4)), rng=rng)


def test_a_stratified_sample_never_takes_a_run_from_another_task(rng):
    values = np.array([[0.0, 10.0], [1.0, 11.0]])
    samples = resample(values, 4000, rng)
    assert set(np.unique(samples[..., 0])) == {0.0, 1.0}
    assert set(np.unique(samples[..., 1])) == {10.0, 11.0}
    # By hand: each task's mean is 0, 1/2 or 1 above its lower run with probability 1/4, 1/2, 1/4.
    shares = [np.mean(samples[..., 0].mean(axis=1) == mean) for mean in (0.0, 0.5, 1.0)]
    assert shares == pytest.approx([0.25, 0.5, 0.25], abs=0.03)


def test_a_profile_is_counted_by_hand():
    values = np.array([[0.1, 0.6], [0.3, 0.9]])
    assert performance_profile(values, np.array([0.0, 0.1, 0.5, 0.9])).tolist() == [1.0, 0.75, 0.5, 0.0]


def test_a_profile_lies_in_its_band_and_falls(rng):
    values, thresholds = rng.uniform(size=(10, 5)), np.linspace(0.0, 1.0, 11)
    profile = performance_profile(values, thresholds)
    low, high = profile_band(values, thresholds, rng=rng)
    assert (np.diff(profile) <= 0.0).all()
    assert ((low <= profile) & (profile <= high)).all()


def test_an_interval_for_other_tasks_is_wider_where_tasks_differ(rng):
    values = rng.normal(size=(10, 6)) * 0.1 + np.arange(6.0)
    narrow, wide = estimate(values, rng=rng), estimate_over_tasks(values, rng=rng)
    assert wide["mean"] == narrow["mean"]
    assert wide["high"] - wide["low"] > 5.0 * (narrow["high"] - narrow["low"])


def test_a_single_task_says_nothing_of_others(rng):
    assert estimate_over_tasks(np.array([[1.0], [2.0]]), rng=rng)["low"] is None
