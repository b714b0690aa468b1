import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.model.encoding import SoftmaxEncoding


def test_eq6_by_hand():
    """Three references at -1, 0, 1, sigma 0.5 of the squared spacing 1: exponents -2, 0, -2 at angle 0."""
    weights = np.exp([-2.0, 0.0, -2.0])
    encoding = SoftmaxEncoding([-1.0], [1.0], n_units=3, sigma=0.5)

    np.testing.assert_allclose(encoding.encode(np.array([0.0])), weights / weights.sum(), rtol=1e-12)


def test_sigma_in_rad2_is_the_paper_read_literally():
    """The same angle with references 2 rad apart: exponents -(2^2) / 0.5 = -8."""
    weights = np.exp([-8.0, 0.0, -8.0])
    encoding = SoftmaxEncoding([-2.0], [2.0], n_units=3, sigma=0.5, sigma_unit="rad2")

    np.testing.assert_allclose(encoding.encode(np.array([0.0])), weights / weights.sum(), rtol=1e-12)


@given(arrays(np.float64, (3, 8), elements=st.floats(-1.0, 1.0)))
def test_a_code_is_a_distribution_for_each_joint(angles):
    codes = SoftmaxEncoding(-np.ones(8), np.ones(8)).encode(angles)

    assert codes.shape == (3, 80)
    assert (codes >= 0).all()
    np.testing.assert_allclose(codes.reshape(3, 8, 10).sum(axis=-1), 1.0, rtol=1e-12)


def test_decoding_errs_by_less_than_a_fiftieth_of_the_range():
    """With ten units over 2 rad the error is largest at the ends of the range: 0.03 rad."""
    encoding = SoftmaxEncoding([-1.0], [1.0])
    angles = np.linspace(-1, 1, 1001)[:, None]

    error = np.abs(encoding.decode(encoding.encode(angles)) - angles)

    assert 0.025 < error.max() < 0.035
    assert np.sqrt(np.mean(error**2)) < 0.007


def test_rad2_decodes_much_worse():
    encoding = SoftmaxEncoding([-1.0], [1.0], sigma_unit="rad2")
    ends = np.array([[-1.0], [1.0]])

    assert np.abs(encoding.decode(encoding.encode(ends)) - ends).max() > 0.3


def test_a_wrong_number_of_joints_is_named():
    with pytest.raises(ShapeError, match=r"`angles` should have shape \(\.\.\., 2\), but has \(5, 3\)"):
        SoftmaxEncoding([0, 0], [1, 1]).encode(np.zeros((5, 3)))


@pytest.mark.parametrize("sigma_unit", ["spacing2", "rad2"])
@pytest.mark.parametrize("span", [0.0, 1e-10])
def test_a_joint_without_range_has_an_even_code_and_keeps_its_angle(sigma_unit, span):
    encoding = SoftmaxEncoding([0.0, 0.5], [1.0, 0.5 + span], sigma_unit=sigma_unit)
    code = encoding.encode([[0.2, 0.5], [0.9, 1.7]]).reshape(2, 2, 10)

    assert np.array_equal(code[:, 1], np.full((2, 10), 0.1))
    np.testing.assert_allclose(encoding.decode(code.reshape(2, 20))[:, 1], 0.5 + span / 2, rtol=1e-15)
    with pytest.raises(SettingsError, match="`high` should be at least `low`"):
        SoftmaxEncoding([0.0, 0.5], [1.0, 0.4])
