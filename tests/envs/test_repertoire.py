import numpy as np
import pytest

from creative_nao.envs.archive import Repertoire
from creative_nao.measures import dtw, dtw_matrix


@pytest.fixture
def repertoire(demonstrations):
    return Repertoire(demonstrations)


def test_the_unit_of_the_reward_is_the_mean_distance_of_the_basic_actions(repertoire, demonstrations):
    distances = dtw_matrix(demonstrations.trajectories)

    assert repertoire.scale == pytest.approx(distances[np.triu_indices(6, 1)].mean())


def test_a_basic_action_is_nothing_new(repertoire, demonstrations):
    novelty = repertoire.compare(demonstrations.trajectories[4])

    assert (novelty.distance, novelty.nearest, repertoire.reward(novelty)) == (0.0, 4, 0.0)


def test_what_was_accepted_is_known(repertoire, demonstrations):
    new = demonstrations.trajectories[0] + 0.1
    novelty = repertoire.compare(new)
    repertoire.accept(new)
    again = repertoire.compare(new)

    assert repertoire.reward(novelty) > 0
    assert again.known_distance == 0.0
    assert again.distance == novelty.distance  # to the basic actions it is as far as before


def test_the_measures_of_two_actions_by_hand(repertoire, demonstrations):
    first, second = demonstrations.trajectories[0] + 0.1, demonstrations.trajectories[1] - 0.05
    for trajectory in (first, second):
        repertoire.accept(trajectory)
    to_basic = dtw_matrix([first, second], demonstrations.trajectories).min(axis=1)

    assert repertoire.measures(n_tried=4) == {
        "appropriateness_pct": 50.0,
        "novelty": pytest.approx(to_basic.mean()),
        "diversity": pytest.approx(dtw(first, second)),
    }


def test_measures_that_do_not_exist_are_none(repertoire, demonstrations):
    assert repertoire.measures(3) == {"appropriateness_pct": 0.0, "novelty": None, "diversity": None}

    repertoire.accept(demonstrations.trajectories[0])
    assert repertoire.measures(3)["novelty"] == 0.0
    assert repertoire.measures(3)["diversity"] is None
