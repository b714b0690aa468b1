import numpy as np
import pytest

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures import dtw_matrix
from creative_nao.measures.dtw import dtw_pairs


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(9, 50, 8), (40, 13, 3), (5, 7, 17), (3, 1, 8)])
def test_a_pair_has_the_bits_it_has_in_the_matrix(shape, dtype):
    rng = np.random.default_rng(0)
    trajectories = rng.normal(size=shape)
    first, second = rng.integers(0, shape[0], (2, 70))

    np.testing.assert_array_equal(
        dtw_pairs(trajectories, first, second, dtype), dtw_matrix(trajectories, dtype=dtype)[first, second]
    )


def test_no_pairs_have_no_distances():
    assert dtw_pairs(np.zeros((2, 3, 4)), [], []).shape == (0,)


def test_whole_numbers_are_numbers():
    assert dtw_pairs(np.array([[[0], [1], [2]], [[0], [2], [2]]]), [0], [1]).tolist() == [1.0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros((2, 3)), [0], [1]), r"`trajectories` should be .* but has shape \(2, 3\)"),
        ((np.full((2, 3, 1), np.nan), [0], [1]), "finite values"),
        ((np.zeros((2, 3, 1)), [0], [2]), "`second` should hold places from 0 to 1, but is 2 at"),
        ((np.zeros((2, 3, 1)), [-1], [1]), "`first` should hold places from 0 to 1, but is -1 at"),
        ((np.zeros((2, 3, 1)), [0.5], [1]), r"`first` should be a list of places .* float64"),
        ((np.zeros((2, 3, 1)), [0, 1], [1]), "`second` should be as long as `first`, 2, but has 1 places"),
    ],
)
def test_what_does_not_fit_is_named(arguments, message):
    with pytest.raises(ShapeError, match=message):
        dtw_pairs(*arguments)


def test_other_types_of_number_are_refused():
    with pytest.raises(SettingsError, match="`dtype` should be float32 or float64, but is float16"):
        dtw_pairs(np.zeros((2, 3, 1)), [0], [1], np.float16)
