import numpy as np
import pytest

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures import diversity, dtw_matrix, is_appropriate, novelty, reward_scale, score, table


def test_copies_of_a_basic_action_have_neither_novelty_nor_diversity(taught):
    copies = [taught.trajectories[1]] * 40
    for measure in (novelty(copies, taught), diversity(copies, taught)):
        assert (measure.mean, measure.std, measure.n_samples) == (0.0, 0.0, 30)


def test_novelty_of_all_is_the_mean_smallest_distance_of_the_appropriate(taught, blends):
    """As many are drawn as there are: every draw is the whole set."""
    scores = score(blends, taught)
    found = novelty(blends, taught, n_samples=200)
    assert found.n_samples == scores.appropriate.sum() < 200
    assert found.values == pytest.approx(np.full(30, scores.novelty[scores.appropriate].mean()))


def test_diversity_of_all_is_the_mean_over_pairs(taught, blends):
    appropriate = blends[is_appropriate(blends, taught)]
    distances = dtw_matrix(appropriate)
    mean = distances.sum() / (len(distances) * (len(distances) - 1))
    assert diversity(blends, taught, n_samples=200, n_draws=1).mean == pytest.approx(mean)
    assert diversity(appropriate, n_samples=200, n_draws=1).mean == pytest.approx(mean)


def test_without_basic_actions_diversity_draws_from_all(taught, blends):
    assert diversity(blends, n_samples=200).n_samples == 200
    assert diversity(blends, taught, n_samples=200).n_samples < 200


def test_only_appropriate_actions_are_drawn(taught, blends):
    """Noise that is filtered out changes nothing but the places of the others."""
    noise = 100 * np.random.default_rng(0).normal(size=(300, 40, 8))
    mixed = np.concatenate([blends, noise])
    assert novelty(mixed, taught, n_samples=200).mean == novelty(blends, taught, n_samples=200).mean


def test_a_seed_and_its_generator_draw_the_same_and_another_seed_does_not(taught, blends):
    first = novelty(blends, taught, rng=3)
    np.testing.assert_array_equal(first.values, novelty(blends, taught, rng=np.random.default_rng(3)).values)
    assert not np.array_equal(first.values, novelty(blends, taught, rng=4).values)
    np.testing.assert_array_equal(diversity(blends, rng=3).values, diversity(blends, rng=3).values)
    assert not np.array_equal(diversity(blends, rng=3).values, diversity(blends, rng=4).values)


def test_mean_and_spread_are_those_of_the_values(taught, blends):
    found = novelty(blends, taught, n_samples=10, n_draws=12)
    assert (len(found.values), found.n_samples) == (12, 10)
    assert found.mean == pytest.approx(np.mean(found.values))
    assert found.std == pytest.approx(np.std(found.values, ddof=1))
    assert found.std > 0


def test_no_action_is_drawn_twice_in_a_sample(blends, taught):
    """Thirty-one different actions, thirty drawn: a repetition would put a distance of zero into the mean."""
    apart = np.arange(31)[:, None, None] * np.ones((1, 5, 1))
    found = diversity(apart, n_samples=31, n_draws=5)
    pairs = np.abs(np.subtract.outer(np.arange(31), np.arange(31)))[np.triu_indices(31, 1)]
    assert found.values == pytest.approx(np.full(5, 5 * pairs.mean()))


def test_measures_without_an_action_to_draw_are_an_error_that_counts_them(taught):
    rest = np.zeros((4, 40, 8))
    with pytest.raises(ShapeError, match="at least 1 appropriate actions to draw from, but 0 of 4 are appropriate"):
        novelty(rest, taught)
    with pytest.raises(ShapeError, match="at least 2 appropriate actions to draw from, but 1 of 1 are appropriate"):
        diversity(taught.trajectories[:1], taught)


def test_numbers_of_samples_are_checked_by_name(taught, blends):
    with pytest.raises(SettingsError, match="`n_draws` should be at least 1, but is 0"):
        novelty(blends, taught, n_draws=0)
    with pytest.raises(SettingsError, match="`n_samples` should be at least 2 for this measure, but is 1"):
        diversity(blends, taught, n_samples=1)


def test_a_mask_of_another_length_is_refused(taught, blends):
    with pytest.raises(ShapeError, match=r"`appropriate` should be a mask of shape \(200,\).* shape \(199,\)"):
        novelty(blends, taught, appropriate=np.ones(199, dtype=bool))


def test_the_reward_scale_is_the_mean_distance_of_the_basic_actions(taught):
    distances = dtw_matrix(taught.trajectories)
    assert reward_scale(taught) == pytest.approx((distances[0, 1] + distances[0, 2] + distances[1, 2]) / 3)


def test_the_table_joins_the_measures(taught, blends):
    scores = score(blends, taught)
    rng = np.random.default_rng(5)
    found = table(blends, taught, rng=5)
    assert found.learned_pct + found.unlearned_pct == pytest.approx(found.appropriate_pct)
    assert found.appropriate_pct == 100.0 * scores.appropriate.mean()
    assert found.appropriate_pct + found.fluctuating_pct + found.non_moving_pct == pytest.approx(100.0)
    assert found.novelty is not None
    assert found.diversity is not None
    np.testing.assert_array_equal(found.novelty.values, novelty(blends, taught, rng=rng).values)
    np.testing.assert_array_equal(found.diversity.values, diversity(blends, taught, rng=rng).values)


def test_a_table_of_rest_has_no_novelty(taught):
    found = table(np.zeros((4, 40, 8)), taught)
    assert (found.novelty, found.diversity, found.non_moving_pct, found.n_trajectories) == (None, None, 100.0, 4)
