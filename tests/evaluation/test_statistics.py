"""The intervals hold what they promise, the seed reaches the resampling, and few runs are not flattered."""

import numpy as np
import pytest

from creative_nao.errors import ShapeError
from creative_nao.evaluation.statistics import estimate, expanded_tail, iqm, mean, resample, student_quantile


def rng(seed=0):
    return np.random.default_rng(seed)


@pytest.mark.parametrize(
    ("probability", "degrees", "expected"),
    # From the table of Student's t in any handbook.
    [
        (0.975, 1, 12.706),
        (0.975, 2, 4.303),
        (0.975, 4, 2.776),
        (0.975, 9, 2.262),
        (0.95, 7, 1.895),
        (0.975, 120, 1.980),
    ],
)
def test_student_quantile_matches_the_table(probability, degrees, expected):
    assert student_quantile(probability, degrees) == pytest.approx(expected, abs=5e-4)


def test_the_expanded_tail_tends_to_the_plain_one_with_many_runs():
    assert expanded_tail(5) == pytest.approx(0.00095, abs=5e-5)
    assert expanded_tail(100_000) == pytest.approx(0.025, abs=1e-4)


@pytest.mark.parametrize("n_runs", [5, 8, 20])
def test_intervals_hold_the_truth_in_about_95_of_100_cases(n_runs):
    generator = rng(n_runs)
    n_cases = 400
    held = 0
    for _ in range(n_cases):
        found = estimate(generator.normal(3.0, 2.0, n_runs), rng=generator, n_resamples=2_000)
        held += found["low"] <= 3.0 <= found["high"]
    assert 0.91 <= held / n_cases <= 0.985


def test_a_plain_percentile_interval_of_five_runs_would_be_too_narrow():
    """Why the percentiles are expanded: the plain ones hold the truth in far fewer cases."""
    generator = rng(1)
    held = 0
    for _ in range(400):
        values = generator.normal(3.0, 2.0, (5, 1))
        low, high = np.quantile(mean(resample(values, 2_000, generator)), [0.025, 0.975])
        held += low <= 3.0 <= high
    assert held / 400 < 0.89


def test_the_seed_reaches_the_resampling():
    values = rng().normal(size=(6, 2))
    one, same, other = (estimate(values, rng=rng(seed), n_resamples=50) for seed in (1, 1, 2))
    assert one == same
    assert (one["low"], one["high"]) != (other["low"], other["high"])
    assert one["mean"] == other["mean"]


def test_runs_are_drawn_within_their_task():
    values = np.array([[0.0, 100.0], [1.0, 101.0], [2.0, 102.0]])
    drawn = resample(values, 200, rng())
    assert drawn.shape == (200, 3, 2)
    assert set(np.unique(drawn[..., 0])) == {0.0, 1.0, 2.0}
    assert set(np.unique(drawn[..., 1])) == {100.0, 101.0, 102.0}
    assert not np.array_equal(drawn[..., 0] + 100.0, drawn[..., 1])  # separately


def test_stratified_intervals_ignore_the_spread_between_tasks():
    values = np.array([[0.0, 100.0]] * 5)
    found = estimate(values, rng=rng())
    assert found == {"mean": 50.0, "low": 50.0, "high": 50.0}


def test_an_interval_holds_its_mean_and_stays_in_the_range_of_the_runs():
    values = np.array([1.0, 1.0, 1.0, 9.0])
    found = estimate(values, rng=rng())
    assert 1.0 <= found["low"] <= found["mean"] == 3.0 <= found["high"] <= 9.0


def test_one_run_has_no_interval():
    found = estimate(np.array([4.0]), rng=rng())
    assert found == {"mean": 4.0, "low": None, "high": None}


def test_iqm_leaves_out_a_quarter_at_either_end():
    values = np.array([[-1e9, 1.0], [2.0, 3.0], [4.0, 5.0], [6.0, 1e9]])
    assert iqm(values) == pytest.approx(np.mean([2.0, 3.0, 4.0, 5.0]))
    assert iqm(np.stack([values, values + 1.0])) == pytest.approx([3.5, 4.5])


def test_iqm_of_few_values_leaves_out_none():
    assert iqm(np.array([[1.0], [2.0], [6.0]])) == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        (np.zeros((0, 2)), r"`values` should have shape \(runs, tasks\), each at least 1, but has \(0, 2\)"),
        (np.zeros((2, 2, 2)), r"but has \(2, 2, 2\)"),
        (np.array([1.0, np.nan]), "`values` should be finite, but holds nan"),
    ],
)
def test_values_that_are_no_runs_are_named(values, text):
    with pytest.raises(ShapeError, match=text):
        estimate(values, rng=rng())
