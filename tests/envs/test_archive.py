"""The repertoire archive: its kernel gives the bits of the measures, and what is accepted is known."""

from types import SimpleNamespace

import numpy as np
import pytest

from creative_nao.envs.archive import RepertoireArchive
from creative_nao.envs.episode_batch import EpisodeBatch
from creative_nao.measures import dtw, dtw_matrix, reward_scale
from creative_nao.measures.outcome import is_fluctuating, is_non_moving

ZERO = np.zeros(1, np.int64)


def movements(n, n_steps, n_joints, seed=0):
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.normal(0, 0.1, (n, n_steps, n_joints)), axis=1)


@pytest.mark.parametrize("n_joints", [2, 8, 11])
@pytest.mark.parametrize("n_steps", [1, 2, 20, 51])
def test_distances_have_the_bits_of_the_measures(n_joints, n_steps):
    known, new = movements(13, n_steps, n_joints), movements(4, n_steps, n_joints, 1)
    archive = RepertoireArchive(1, 6, n_steps, n_joints)
    demonstrations = _taught(known[:6])
    archive.set_basic_actions(0, demonstrations, 1.0)
    for one in known[6:]:
        archive.accept(ZERO, np.ones(1, bool), one[None], archive.compare(ZERO, one[None]))

    found = archive.compare(np.zeros(4, np.int64), new)

    assert np.array_equal(found[:, :13], dtw_matrix(new, known))
    assert np.isinf(found[:, 13:]).all()


def test_basic_actions_may_differ_in_length(waves):
    archive = RepertoireArchive(1, 2, 20, 2)
    archive.set_basic_actions(0, waves, 1.0)
    new = movements(1, 20, 2)

    assert np.array_equal(archive.compare(ZERO, new)[:, :2], dtw_matrix(new, waves.trajectories))


def test_robots_side_by_side_know_only_their_own(demonstrations):
    archive = RepertoireArchive(3, 6, 50, 8)
    for robot in range(3):
        archive.set_basic_actions(robot, demonstrations, 1.0)
    new = movements(3, 50, 8)
    robots = np.arange(3)
    archive.accept(robots, np.array([True, False, True]), new, archive.compare(robots, new))

    distances = archive.compare(robots, new)
    assert archive.sizes.tolist() == [7, 6, 7]
    assert distances.min(axis=1)[[0, 2]].tolist() == [0, 0]
    assert distances.min(axis=1)[1] > 0


def test_more_fits_than_there_was_room_for(demonstrations):
    archive = RepertoireArchive(1, 6, 50, 8)
    archive.set_basic_actions(0, demonstrations, 1.0)
    new = movements(100, 50, 8)
    for one in new:
        archive.accept(ZERO, np.ones(1, bool), one[None], archive.compare(ZERO, one[None]))

    assert np.array_equal(np.stack(archive.accepted(0)), new)
    assert np.array_equal(archive.compare(ZERO, new[:1])[0, 6:106], dtw_matrix(new[:1], new)[0])
    expected = dtw_matrix(new)[np.triu_indices(100, 1)].mean()
    assert archive.measures(0, 100)["diversity"] == pytest.approx(expected, rel=1e-12)


def test_outcomes_are_those_of_the_measures(demonstrations):
    """On movements around both lines: some too fast, some that hardly move."""
    taught = demonstrations
    size = np.geomspace(1e-3, 3.0, 40)[:, None, None]
    new = taught.trajectories[0][:1] + size * (taught.trajectories[0] - taught.trajectories[0][:1])
    batch = EpisodeBatch(Scripted(demonstrations, new), 40)
    scored = batch.step(np.arange(40), np.zeros((40, 2)))[3]["outcome"]
    fast, still = is_fluctuating(new, taught), is_non_moving(new, taught)

    assert 0 < fast.sum() < 40
    assert 0 < still.sum() < 40
    assert np.array_equal(scored == "fluctuating", fast)
    assert np.array_equal(scored == "non_moving", still & ~fast)


@pytest.fixture
def archive(demonstrations):
    archive = RepertoireArchive(1, 6, 50, 8)
    archive.set_basic_actions(0, demonstrations, reward_scale(demonstrations))
    return archive


def add(archive, trajectory):
    archive.accept(ZERO, np.ones(1, bool), trajectory[None], archive.compare(ZERO, trajectory[None]))


def test_what_was_accepted_is_known(archive, demonstrations):
    basic, new = demonstrations.trajectories[4], demonstrations.trajectories[0] + 0.1
    before = archive.compare(ZERO, new[None])[0]
    add(archive, new)
    after, of_basic = archive.compare(np.zeros(2, np.int64), np.stack([new, basic]))

    assert of_basic.argmin() == 4
    assert of_basic.min() == 0.0
    assert before.min() > 0.0
    assert np.array_equal(after[:7], [*before[:6], 0.0])  # to the basic actions it is as far as before
    assert np.array_equal(archive.accepted(0), [new])


def test_the_measures_of_two_actions_by_hand(archive, demonstrations):
    first, second = demonstrations.trajectories[0] + 0.1, demonstrations.trajectories[1] - 0.05
    for trajectory in (first, second):
        add(archive, trajectory)
    to_basic = dtw_matrix([first, second], demonstrations.trajectories).min(axis=1)

    assert archive.measures(0, n_tried=4) == {
        "appropriateness_pct": 50.0,
        "novelty": pytest.approx(to_basic.mean()),
        "diversity": pytest.approx(dtw(first, second)),
    }


def test_measures_that_do_not_exist_are_none(archive, demonstrations):
    assert archive.measures(0, 3) == {"appropriateness_pct": 0.0, "novelty": None, "diversity": None}

    add(archive, demonstrations.trajectories[0])
    assert archive.measures(0, 3)["novelty"] == 0.0
    assert archive.measures(0, 3)["diversity"] is None


class Scripted:
    """A memory that generates the same movements whatever the PB."""

    def __init__(self, demonstrations, movements):
        self.pb, self.demonstrations = np.zeros((demonstrations.n_actions, 2)), demonstrations
        self._movements = movements

    def generate(self, pb, n_steps=None):
        return self._movements[: len(pb)]


def _taught(trajectories):
    return SimpleNamespace(n_actions=len(trajectories), trajectories=list(trajectories))
