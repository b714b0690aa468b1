"""When a difference counts: intervals over seeds and the verdicts that follow."""

import numpy as np
import pytest

from creative_nao.evaluation.paper.claims import (
    FAILS,
    HOLDS,
    UNDECIDED,
    decide,
    decide_rates,
    difference,
    rate,
)


def compared(one, other, seed=0):
    values = {"a": np.array(one, dtype=float), "b": np.array(other, dtype=float)}
    return difference(values, "a", "b", np.random.default_rng(seed))


def test_the_probability_of_superiority_counts_pairs_and_halves_ties():
    found = compared([1, 2, 3], [2, 0])
    assert found["mean"] == 1.0
    assert found["superiority"] == pytest.approx((0 + 1 + 0.5 + 1 + 1 + 1) / 6)


def test_the_other_way_round_is_the_mirror_image():
    one, other = np.random.default_rng(1).normal(size=(2, 12))
    there, back = compared(one, other), compared(other, one, seed=1)
    assert there["mean"] == pytest.approx(-back["mean"])
    assert (there["low"], there["high"]) == (
        pytest.approx(-back["high"], abs=0.05),
        pytest.approx(-back["low"], abs=0.05),
    )
    assert there["superiority"] == pytest.approx(1 - back["superiority"])


def test_with_one_network_on_a_side_there_is_no_interval_and_no_verdict():
    found = compared([5.0], [1.0, 1.1, 0.9])
    assert (found["low"], found["high"]) == (None, None)
    assert decide([found]) == UNDECIDED


def test_the_interval_is_at_least_that_of_welch():
    """By hand: variances 1 and 1, three a side, so 2.776 * sqrt(2 / 3) with 4 degrees of freedom."""
    found = compared([9, 10, 11], [0, 1, 2])
    margin = 2.7764451 * np.sqrt(2 / 3)
    assert found["low"] <= 9 - margin + 1e-6
    assert found["high"] >= 9 + margin - 1e-6


def test_equal_networks_have_an_interval_of_no_width():
    found = compared([6, 6, 6], [5, 5, 5])
    assert (found["low"], found["mean"], found["high"]) == (1, 1, 1)


@pytest.mark.parametrize("n_seeds", [2, 3, 8])
def test_chance_alone_is_rarely_called_a_difference(n_seeds):
    rng = np.random.default_rng(2)
    wrong = [compared(*rng.normal(size=(2, n_seeds)), seed=k)["low"] > 0 for k in range(300)]
    assert np.mean(wrong) < 0.045  # 2.5 % are expected; three standard errors above


@pytest.mark.parametrize(
    ("intervals", "verdict"),
    [
        ([(1, 3), (0.1, 2)], HOLDS),
        ([(1, 3), (-0.1, 2)], UNDECIDED),
        ([(1, 3), (-2, -0.1)], FAILS),
        ([(-3, 3), (-2, -0.1)], FAILS),
        ([], UNDECIDED),
    ],
)
def test_an_order_holds_only_if_all_its_differences_do(intervals, verdict):
    assert decide([{"low": low, "high": high} for low, high in intervals]) == verdict


def test_wilson_by_hand():
    """8 of 10: centre (0.8 + 1.92073 / 10) / 1.384146, half width 1.95996 / 1.384146 * sqrt(0.016 + 0.0096036)."""
    found = rate("half", [True] * 8 + [False] * 2)
    assert (found["n_yes"], found["n"]) == (8, 10)
    assert (found["low"], found["high"]) == (pytest.approx(0.4902, abs=1e-4), pytest.approx(0.9433, abs=1e-4))


@pytest.mark.parametrize(
    ("counts", "verdict"),
    [
        ([(10, 10), (9, 10), (10, 10)], HOLDS),
        ([(10, 10), (6, 10), (10, 10)], UNDECIDED),
        ([(10, 10), (0, 10), (10, 10)], FAILS),
        ([(3, 3), (3, 3), (3, 3)], UNDECIDED),
        ([], UNDECIDED),
    ],
)
def test_most_networks_of_every_condition_have_to_show_it(counts, verdict):
    rates = [rate("x", [True] * yes + [False] * (n - yes)) for yes, n in counts]
    assert decide_rates(rates) == verdict
