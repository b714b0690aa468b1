"""Generation that is stopped between ticks."""

import copy

import numpy as np
import pytest

from creative_nao.errors import ShapeError
from creative_nao.model import load_memory


@pytest.fixture(scope="module", params=["half/0", "tiny"])
def memory(request, tiny_memory):
    return tiny_memory if request.param == "tiny" else load_memory(request.param)


@pytest.fixture
def points():
    return np.random.default_rng(2).uniform(-1, 1, (7, 2))


@pytest.mark.parametrize("pieces", [(50,), (5,) * 10, (1, 2, 17, 30), (1,) * 50])
def test_a_pb_held_constant_gives_the_bits_of_generate(memory, points, pieces):
    generator = memory.generator
    rollout = generator.begin(7)
    found = np.concatenate([generator.advance(rollout, points, n) for n in pieces], axis=1)

    assert np.array_equal(found, memory.generate(points))
    assert rollout.tick == 50


def test_a_pb_that_jumps_gives_the_bits_of_a_path(memory, points):
    generator = memory.generator
    rollout = generator.begin(1)
    found = np.concatenate([generator.advance(rollout, point[None], 5) for point in points], axis=1)[0]
    corners = np.repeat(points, 2, axis=0)
    ticks = np.stack([np.arange(7) * 5, np.arange(7) * 5 + 4], axis=1).ravel()

    assert np.array_equal(found, memory.generate_path(corners, 35, ticks))
    assert not np.array_equal(found, memory.generate(points[:1], 35)[0])


def test_movements_side_by_side_do_not_affect_each_other(memory, points):
    generator = memory.generator
    together, alone = generator.begin(7), generator.begin(1)

    assert np.array_equal(generator.advance(together, points, 20)[3:4], generator.advance(alone, points[3:4], 20))


def test_a_copied_state_goes_on_alike(memory, points):
    generator = memory.generator
    one = generator.begin(7)
    generator.advance(one, points, 12)
    other = copy.deepcopy(one)

    assert np.array_equal(generator.advance(one, points[::-1], 9), generator.advance(other, points[::-1], 9))


@pytest.mark.parametrize("pb", [np.zeros((2, 2)), np.zeros(2), np.full((1, 2), 1.5), np.full((1, 2), np.nan)])
def test_pb_values_that_do_not_fit_are_named(memory, pb):
    generator = memory.generator
    with pytest.raises(ShapeError, match=r"`pb` should have shape \(1, 2\) and lie in \[-1, 1\]"):
        generator.advance(generator.begin(1), pb, 5)
