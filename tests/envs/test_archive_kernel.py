"""The kernel behind the rewards gives the bits of the measures."""

from types import SimpleNamespace

import numpy as np
import pytest

from creative_nao.envs.archive import RepertoireArchive
from creative_nao.envs.episode_batch import EpisodeBatch
from creative_nao.measures import dtw_matrix
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
    scored = batch.step(np.arange(40), np.zeros((40, 2))).finished_terms["outcome"]
    fast, still = is_fluctuating(new, taught), is_non_moving(new, taught)

    assert 0 < fast.sum() < 40
    assert 0 < still.sum() < 40
    assert np.array_equal(scored == "fluctuating", fast)
    assert np.array_equal(scored == "non_moving", still & ~fast)


class Scripted:
    """A memory that generates the same movements whatever the PB."""

    def __init__(self, demonstrations, movements):
        self.pb, self.demonstrations = np.zeros((demonstrations.n_actions, 2)), demonstrations
        self._movements = movements

    def generate(self, pb, n_steps=None):
        return self._movements[: len(pb)]


def _taught(trajectories):
    return SimpleNamespace(n_actions=len(trajectories), trajectories=list(trajectories))
