import numpy as np
import pytest

from creative_nao.exchange.motion import monotone_cubic, n_ticks, resample


def wave(frequency_hz, rate_hz, seconds=30.0):
    times = np.arange(round(seconds * rate_hz)) / rate_hz
    return times, np.sin(2 * np.pi * frequency_hz * times)[:, None]


def kept(frequency_hz, rate_hz, dt_s=0.15):
    """Share of a sine's size that is left after resampling, ends left out."""
    got = resample(*wave(frequency_hz, rate_hz), dt_s)[3:-3, 0]
    expected = np.sin(2 * np.pi * frequency_hz * (np.arange(len(got)) + 3) * dt_s)
    return got.std() / expected.std()


def test_a_recording_at_the_tick_is_taken_as_it_is():
    angles = np.random.default_rng(0).normal(size=(50, 8))
    times = 12.3 + np.arange(50) * 0.15
    np.testing.assert_array_equal(resample(times, angles, 0.15), angles)


@pytest.mark.parametrize(("n", "dt_s"), [(50, 0.15), (50, 0.1), (1000, 0.07), (3, 1 / 3)])
def test_the_last_tick_is_not_lost_to_rounding(n, dt_s):
    assert n_ticks((n - 1) * dt_s, dt_s) == n
    assert n_ticks((n - 1) * dt_s + 0.4 * dt_s, dt_s) == n


def test_a_swing_is_kept_and_a_tremor_is_not_turned_into_another_movement():
    """The figures in the module's text."""
    assert kept(1.5, 50) == pytest.approx(0.98, abs=0.005)
    assert kept(10.0, 50) < 0.30 < kept(8.0, 20)


def test_between_sparse_samples_no_posture_is_overshot():
    times = np.array([0.0, 0.5, 0.7, 1.5, 2.0])
    angles = np.array([[0.0], [1.0], [1.0], [-1.0], [0.5]])
    fine = monotone_cubic(times, angles, np.linspace(0, 2, 401))[:, 0]
    assert fine.min() == pytest.approx(-1.0)
    assert fine.max() == pytest.approx(1.0)
    np.testing.assert_allclose(monotone_cubic(times, angles, times), angles)
    assert (np.diff(fine[:100]) >= 0).all()
    assert np.ptp(fine[100:140]) < 1e-12  # held postures stay held


def test_a_straight_line_stays_straight_at_any_rate():
    times = np.sort(np.random.default_rng(1).uniform(0, 6, 200))
    got = resample(times, times[:, None] * [1.0, -2.0], 0.15)[2:-2]
    np.testing.assert_allclose(np.diff(got, axis=0), np.full((len(got) - 1, 2), [0.15, -0.3]), rtol=0.02)


def test_the_first_tick_is_the_first_sample():
    times, angles = wave(0.5, 10, 3.0)
    assert resample(times, angles, 0.05)[0, 0] == angles[0, 0]
