import numpy as np
import pytest

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures import (
    OUTCOMES,
    Criteria,
    diversity,
    dtw,
    farthest_points,
    is_appropriate,
    novelty,
    reward_scale,
    score,
    table,
)


def test_copies_of_the_basic_actions_are_learned_and_not_new(taught):
    scores = score(taught.trajectories, taught)
    assert scores.outcome.tolist() == ["learned"] * 3
    assert scores.novelty.tolist() == [0.0] * 3
    assert scores.nearest.tolist() == [0, 1, 2]


def test_noise_is_fluctuating_and_rest_is_non_moving(taught):
    noise = np.random.default_rng(0).normal(size=(1, 40, 8))
    scores = score(np.concatenate([noise, np.zeros((1, 40, 8))]), taught)
    assert scores.outcome.tolist() == ["fluctuating", "non_moving"]
    assert not scores.appropriate.any()


def test_the_threshold_parts_learned_from_unlearned(taught, blends):
    scores = score(blends, taught)
    chosen = scores.appropriate
    assert set(scores.outcome) == set(OUTCOMES)
    np.testing.assert_array_equal(scores.outcome[chosen] == "learned", scores.novelty[chosen] <= 10.0)
    median = float(np.median(scores.novelty[chosen]))
    stricter = score(blends, taught, Criteria(learned_threshold=median))
    assert np.sum(stricter.outcome == "learned") == np.sum(scores.novelty[chosen] <= median)


def test_a_distance_equal_to_the_threshold_is_learned(taught):
    away = taught.trajectories[0].copy()
    away[:, 5] += 0.25
    novelty = float(score([away], taught).novelty[0])
    assert score([away], taught, Criteria(learned_threshold=novelty)).outcome == ["learned"]
    assert score([away], taught, Criteria(learned_threshold=np.nextafter(novelty, 0))).outcome == ["unlearned"]


def test_novelty_is_the_smallest_distance(taught, blends):
    scores = score(blends[:20], taught)
    np.testing.assert_array_equal(scores.distances, [[dtw(a, b) for b in taught.trajectories] for a in blends[:20]])
    np.testing.assert_array_equal(scores.novelty, scores.distances.min(axis=1))
    np.testing.assert_array_equal(scores.nearest, scores.distances.argmin(axis=1))


def test_appropriate_means_the_same_everywhere(taught, blends):
    np.testing.assert_array_equal(score(blends, taught).appropriate, is_appropriate(blends, taught))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_map_can_be_cut_into_pieces_and_shuffled(taught, blends, dtype):
    whole = score(blends, taught, dtype=dtype)
    order = np.random.default_rng(1).permutation(len(blends))
    pieces = [score(blends[part], taught, dtype=dtype) for part in np.array_split(order, 7)]
    for field in ("outcome", "novelty", "nearest", "distances", "appropriate"):
        joined = np.concatenate([getattr(piece, field) for piece in pieces])
        np.testing.assert_array_equal(joined, getattr(whole, field)[order], err_msg=field)


def test_a_list_scores_as_the_array(taught, blends):
    as_list, as_array = score(list(blends), taught), score(blends, taught)
    np.testing.assert_array_equal(as_list.novelty, as_array.novelty)
    np.testing.assert_array_equal(as_list.outcome, as_array.outcome)


def test_lengths_may_differ_from_those_of_the_basic_actions(taught):
    slower = np.repeat(taught.trajectories[1], 2, axis=0)
    assert score([slower, slower[:31]], taught).novelty[0] == 0.0


def test_shares_add_up_to_all(taught, blends):
    scores = score(blends, taught)
    assert sum(scores.share_pct(outcome) for outcome in OUTCOMES) == pytest.approx(100.0)
    assert scores.share_pct("learned") == 100.0 * np.mean(scores.outcome == "learned")


def test_an_empty_set_has_empty_scores(taught):
    scores = score([], taught)
    assert (len(scores), scores.distances.shape) == (0, (0, 3))
    assert np.isnan(scores.share_pct("learned"))


def test_a_trajectory_of_other_joints_is_refused(taught):
    with pytest.raises(ShapeError, match=r"`trajectories\[0\]` should have shape \(n_steps, 8\)"):
        score(np.zeros((4, 40, 6)), taught)


def test_scores_are_told_in_one_line(taught, blends):
    assert repr(score(taught.trajectories, taught)) == (
        "Scores of 3 trajectories: 3 learned, 0 unlearned, 0 fluctuating, 0 non_moving; novelty 0.00 to 0.00 rad"
    )
    assert len(repr(score(blends, taught)).splitlines()) == 1
    assert repr(score([], taught)).startswith("Scores of 0 trajectories")
    assert len(repr(table(blends, taught)).splitlines()) == 1


@pytest.mark.parametrize("wrong", [None, 3, "ab", [["a", 1]], [None]])
def test_what_is_no_trajectory_is_refused(taught, wrong):
    for measure in (score, is_appropriate, novelty, farthest_points, table):
        with pytest.raises(ShapeError, match="`trajectories"):
            measure(wrong, taught)
    with pytest.raises(ShapeError):
        diversity(wrong)


@pytest.mark.parametrize("wrong", [None, 3, "half/0"])
def test_what_is_no_set_of_basic_actions_is_refused(taught, wrong):
    for measure in (score, is_appropriate, novelty, farthest_points, table):
        with pytest.raises(SettingsError, match="`demos` should be basic actions"):
            measure(taught.trajectories, wrong)
    with pytest.raises(SettingsError, match="`demos` should be basic actions"):
        reward_scale(wrong)


def test_settings_of_another_kind_are_refused(taught):
    with pytest.raises(SettingsError, match="`rng` should be a generator of NumPy or a seed, but is 'seed'"):
        novelty(taught.trajectories, taught, rng="seed")
    with pytest.raises(SettingsError, match="`n_draws` should be a whole number, but is 'many'"):
        diversity(taught.trajectories, taught, n_draws="many")
    with pytest.raises(SettingsError, match=r"`criteria` should be `Criteria\(...\)`, but is a int"):
        score(taught.trajectories, taught, criteria=3)
    with pytest.raises(SettingsError, match="`speed_factor` should be a number, but is 'fast'"):
        Criteria(speed_factor="fast")
