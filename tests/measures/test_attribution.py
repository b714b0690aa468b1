import itertools

import numpy as np
import pytest

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures import Attribution, attribution


def test_a_basic_action_is_attributed_to_itself(demonstrations):
    for place, trajectory in enumerate(demonstrations.trajectories):
        found = attribution(trajectory, demonstrations)
        assert (found.nearest == place).all()
        assert not found.distance.any()
        assert [(s.first, s.end, s.action, s.distance) for s in found.stretches()] == [(0, 50, place, 0.0)]


@pytest.mark.parametrize("cut", [20, 25, 30])
def test_two_actions_in_a_row_are_read_as_two(demonstrations, cut):
    """Every ordered pair of different basic actions, joined in the middle."""
    for one, other in itertools.permutations(range(6), 2):
        joined = np.concatenate([demonstrations.trajectories[one][:cut], demonstrations.trajectories[other][cut:]])
        stretches = attribution(joined, demonstrations).stretches()
        assert [(s.action, s.first) for s in stretches] == [(one, 0), (other, cut)]


def test_away_from_the_seam_every_tick_is_attributed_right_by_itself(demonstrations):
    jab, uppercut = demonstrations.trajectories[0], demonstrations.trajectories[5]
    found = attribution(np.concatenate([jab[:25], uppercut[25:]]), demonstrations)

    assert (found.nearest[:23] == 0).all()
    assert (found.nearest[27:] == 5).all()


def test_a_slower_performance_is_still_the_same_action(demonstrations):
    """Half speed: every posture twice. The warp of the window takes it up."""
    found = attribution(np.repeat(demonstrations.trajectories[2], 2, axis=0), demonstrations)

    assert (found.nearest == 2).all()
    assert not found.distance.any()


def test_a_constant_offset_is_the_distance(taught):
    """A posture 0.5 rad away in a joint that no action moves is 0.5 rad away from every place of every action."""
    away = taught.trajectories[1].copy()
    away[:, 7] += 0.5
    found = attribution(away, taught, window_s=0.5)

    assert (found.nearest == 1).all()
    np.testing.assert_allclose(found.distance, 0.5)


def subsequence_dtw(window, action):
    """The definition, over every stretch of the action, in plain Python."""
    best = np.inf
    for begin, end in itertools.combinations(range(len(action) + 1), 2):
        stretch = action[begin:end]
        total = {}
        for i, j in itertools.product(range(len(window)), range(len(stretch))):
            before = [total[p] for p in ((i - 1, j), (i, j - 1), (i - 1, j - 1)) if p in total]
            total[i, j] = np.linalg.norm(window[i] - stretch[j]) + min(before, default=0.0)
        best = min(best, total[len(window) - 1, len(stretch) - 1])
    return best / len(window)


def test_it_is_what_the_definition_says(waves):
    """Actions of different lengths, windows of three ticks."""
    trajectory = np.random.default_rng(0).normal(size=(6, 2))
    found = attribution(trajectory, waves, window_s=0.3)

    of_windows = np.array([[subsequence_dtw(trajectory[s : s + 3], a) for a in waves.trajectories] for s in range(4)])
    for t in range(6):
        inside = of_windows[max(0, t - 2) : t + 1]
        np.testing.assert_allclose(found.distances[t], inside.min(axis=0))


def test_a_short_trajectory_is_one_window(taught):
    found = attribution(taught.trajectories[2][:3], taught)

    assert found.window_steps == 3
    assert found.distances.shape == (3, 3)
    assert (found.distances == found.distances[0]).all()


def test_a_change_has_to_be_worth_its_cost():
    distances = np.array([[0.0, 1.0]] * 5 + [[1.0, 0.6]] * 2 + [[0.0, 1.0]] * 5)
    found = Attribution(distances, window_steps=3, dt_s=0.1)

    assert [(s.first, s.end, s.action) for s in found.stretches(0.3)] == [(0, 5, 0), (5, 7, 1), (7, 12, 0)]
    assert [(s.first, s.end, s.action) for s in found.stretches(0.5)] == [(0, 12, 0)]
    assert found.stretches(0.5)[0].distance == pytest.approx(2 / 12)


def test_without_a_cost_the_stretches_are_the_nearest(demonstrations):
    trajectory = np.mean(demonstrations.trajectories[:3], axis=0)
    found = attribution(trajectory, demonstrations)
    named = np.concatenate([[s.action] * (s.end - s.first) for s in found.stretches(0.0)])

    np.testing.assert_allclose(found.distances[np.arange(50), named], found.distance)
    assert (found.margin >= 0).all()


@pytest.mark.parametrize(
    ("trajectory", "message"),
    [
        (np.zeros((9, 7)), r"`trajectory` should have shape \(n_steps, 8\), .* but has \(9, 7\)"),
        (np.zeros((0, 8)), r"but has \(0, 8\)"),
        (np.full((9, 8), np.inf), "`trajectory` should hold finite values"),
        ("a", "`trajectory` should be an array of numbers, but is 'a'"),
    ],
)
def test_a_bad_trajectory_is_named(taught, trajectory, message):
    with pytest.raises(ShapeError, match=message):
        attribution(trajectory, taught)


def test_bad_settings_are_named(taught):
    with pytest.raises(SettingsError, match=r"`window_s` should be at least two ticks, 0.2 s, but is 0.1"):
        attribution(taught.trajectories[0], taught, window_s=0.1)
    with pytest.raises(SettingsError, match="`switch_cost` should be at least 0, but is -1"):
        attribution(taught.trajectories[0], taught).stretches(-1)
