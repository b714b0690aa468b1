import numpy as np
import pytest

from creative_nao import train
from creative_nao.errors import SettingsError
from creative_nao.model import NetworkSettings, TrainingSettings
from creative_nao.model.config import candidates, closed_loop_ratios

TINY = NetworkSettings(layer_sizes=(8, 4), time_constants=(2, 5), n_softmax_units=5)


def ratios(start=0, stop=100, **settings):
    return closed_loop_ratios(TrainingSettings(**settings), start, stop)


def test_a_constant_ratio_is_constant():
    assert ratios(closed_loop_ratio=0.3).tolist() == [0.3] * 100


def test_an_annealed_ratio_rises_from_open_loop_and_stays():
    found = ratios(closed_loop_ratio=0.8, schedule="annealed", anneal_epochs=40)

    np.testing.assert_allclose(found[:40], 0.8 * np.arange(40) / 40)
    assert (found[40:] == 0.8).all()


def test_a_random_ratio_fills_the_range_and_follows_the_seed():
    found = ratios(0, 5000, closed_loop_ratio=0.5, schedule="random", seed=1)

    assert 0 <= found.min() < 0.01
    assert 0.49 < found.max() <= 0.5
    assert found.mean() == pytest.approx(0.25, abs=0.01)
    assert np.array_equal(found, ratios(0, 5000, closed_loop_ratio=0.5, schedule="random", seed=1))
    assert not np.array_equal(found, ratios(0, 5000, closed_loop_ratio=0.5, schedule="random", seed=2))


@pytest.mark.parametrize("schedule", ["constant", "annealed", "random"])
def test_an_interruption_does_not_change_the_ratios(schedule):
    settings = {"schedule": schedule, "closed_loop_ratio": 1.0, "anneal_epochs": 50}

    assert np.array_equal(ratios(30, 90, **settings), ratios(0, 120, **settings)[30:90])


def test_only_epochs_near_the_ratio_asked_for_can_be_the_best():
    training = TrainingSettings(closed_loop_ratio=0.5, schedule="annealed")

    assert candidates(training, np.array([0.0, 0.2, 0.46, 0.5])).tolist() == [False, False, True, True]
    assert candidates(TrainingSettings(closed_loop_ratio=0.0), np.zeros(3)).all()


@pytest.mark.parametrize("schedule", ["annealed", "random"])
def test_the_best_epoch_of_a_changing_ratio_is_one_of_the_candidates(waves, schedule):
    settings = {"schedule": schedule, "closed_loop_ratio": 1.0, "anneal_epochs": 60, "n_epochs": 100}
    memory = train(waves, network=TINY, **settings)
    allowed = candidates(memory.training, closed_loop_ratios(memory.training, 0, 100))

    assert allowed[memory.best_epoch - 1]
    assert memory.best_loss == pytest.approx(memory.loss_history[allowed].min(), rel=1e-6)


def test_an_unknown_schedule_is_named(waves):
    with pytest.raises(SettingsError, match="`schedule` should be `constant`, `annealed` or `random`, but is 'linear'"):
        train(waves, schedule="linear")
