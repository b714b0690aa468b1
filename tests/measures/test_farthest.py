import itertools

import numpy as np
import pytest

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures import dtw_matrix, farthest_points, is_appropriate, reward_scale


def test_each_pick_is_the_farthest_from_all_that_is_known(taught, blends):
    """The definition, computed anew for every pick from the full matrix."""
    found = farthest_points(blends, taught, n_actions=12)
    everything = [*taught.trajectories, *blends]
    distances = dtw_matrix(everything)[3:]
    allowed = is_appropriate(blends, taught)
    known = [0, 1, 2]
    for pick, reward in zip(found.indices, found.rewards, strict=True):
        nearest = np.where(allowed, distances[:, known].min(axis=1), -1.0)
        assert nearest[pick] == nearest.max()
        assert reward == pytest.approx(nearest[pick] / reward_scale(taught), rel=1e-12)
        known.append(3 + int(pick))


def test_rewards_never_rise_and_nothing_is_picked_twice(taught, blends):
    found = farthest_points(blends, taught)
    assert len(set(found.indices.tolist())) == len(found.indices) == 30
    assert (np.diff(found.rewards) <= 0).all()
    assert found.total == found.rewards.sum()


def test_only_what_the_mask_allows_is_picked(taught, blends):
    mask = np.zeros(200, dtype=bool)
    mask[[20, 30, 40]] = True
    assert sorted(farthest_points(blends, taught, appropriate=mask).indices.tolist()) == [20, 30, 40]


def test_where_nothing_is_appropriate_nothing_is_picked(taught):
    assert farthest_points(np.zeros((4, 40, 8)), taught).indices.tolist() == []


def test_known_actions_earn_nothing(taught):
    found = farthest_points(taught.trajectories * 2, taught, n_actions=4)
    assert found.indices.tolist() == [0, 1, 2, 3]
    assert found.rewards.tolist() == [0.0] * 4


def test_a_list_is_searched_as_the_array(taught, blends):
    one, other = farthest_points(list(blends), taught, 5), farthest_points(blends, taught, 5)
    np.testing.assert_array_equal(one.indices, other.indices)
    np.testing.assert_array_equal(one.rewards, other.rewards)


def test_greedy_reaches_at_least_half_of_the_best_three(taught, blends):
    """Gonzalez's bound for the smallest distance among the chosen, checked against every set of three."""
    few = blends[is_appropriate(blends, taught)][:14]
    distances = dtw_matrix([*taught.trajectories, *few])
    best = max(
        min(
            distances[np.ix_([0, 1, 2], others)].min(), *(distances[i, j] for i, j in itertools.combinations(others, 2))
        )
        for others in itertools.combinations(range(3, 17), 3)
    )
    assert farthest_points(few, taught, 3).rewards[-1] * reward_scale(taught) >= best / 2


def test_settings_are_checked_by_name(taught, blends):
    with pytest.raises(SettingsError, match="`n_actions` should be at least 1, but is 0"):
        farthest_points(blends, taught, n_actions=0)
    with pytest.raises(ShapeError, match=r"`appropriate` should be a mask of shape \(200,\)"):
        farthest_points(blends, taught, appropriate=np.ones(3, dtype=bool))
