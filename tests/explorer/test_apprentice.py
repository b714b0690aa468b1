"""A network that learns beside the page: watched, stopped, gone on with, and forgotten when nobody holds it."""

import threading
import time

import numpy as np
import pytest

from creative_nao.demonstrations import Demonstrations, load_demonstrations
from creative_nao.errors import SettingsError
from creative_nao.explorer.teach_training import MAX_EPOCHS, Apprentice, School
from creative_nao.model import TrainingSettings, train
from creative_nao.model.training import CHUNK_EPOCHS


@pytest.fixture(scope="module")
def demonstrations():
    whole = load_demonstrations()
    return Demonstrations(whole.names[:2], [one[:12] for one in whole.trajectories[:2]], whole.dt_s, whole.joints)


def ended(apprentice, seconds=120):
    deadline = time.monotonic() + seconds
    while apprentice.look.busy:
        assert time.monotonic() < deadline, apprentice.look
        time.sleep(0.01)
    return apprentice.look


def test_stopped_and_gone_on_it_learns_the_bits_of_an_uninterrupted_training(demonstrations):
    apprentice = Apprentice(demonstrations, TrainingSettings(seed=3), threading.Semaphore(1))
    apprentice.learn(100_000)
    while apprentice.look.epoch < CHUNK_EPOCHS:
        time.sleep(0.005)
    apprentice.stop()
    look = ended(apprentice)
    assert look.phase == "stopped"
    assert 0 < look.epoch < 100_000
    assert look.epoch % CHUNK_EPOCHS == 0
    further = look.epoch + 300
    apprentice.learn(further)
    look = ended(apprentice)
    assert (look.phase, look.epoch, look.n_epochs) == ("finished", further, further)
    straight = train(demonstrations, seed=3, n_epochs=further)
    assert all(np.array_equal(look.memory.parameters[name], straight.parameters[name]) for name in straight.parameters)
    assert look.memory.training == straight.training
    assert look.curve[-1].tolist() == [further, pytest.approx(straight.loss_history[-1])]


def test_it_waits_for_its_turn_and_can_leave_the_queue(demonstrations):
    turnstile = threading.Semaphore(1)
    with turnstile:
        apprentice = Apprentice(demonstrations, TrainingSettings(), turnstile)
        apprentice.learn(200)
        time.sleep(0.15)
        assert apprentice.look.phase == "waiting"
        with pytest.raises(SettingsError, match="learning already"):
            apprentice.learn(300)
        apprentice.stop()
        assert ended(apprentice).phase == "stopped"
    apprentice.learn(200)
    assert ended(apprentice).phase == "finished"


def test_a_loss_that_is_not_finite_is_told(demonstrations):
    apprentice = Apprentice(demonstrations, TrainingSettings(learning_rate=1e30), threading.Semaphore(1))
    apprentice.learn(300)
    look = ended(apprentice)
    assert look.phase == "failed"
    assert "finite" in look.failure


def test_what_cannot_be_learned_is_refused(demonstrations):
    apprentice = Apprentice(demonstrations, TrainingSettings(), threading.Semaphore(1))
    for n in (0, MAX_EPOCHS + 1):
        with pytest.raises(SettingsError, match=f"at most 300,000, but is {n:,}"):
            apprentice.learn(n)
    still = Demonstrations(("a",), [np.tile([0.5, -0.5, 0.5, 0.5, 0.5, 0.5, 0.5, -0.5], (5, 1))])
    with pytest.raises(SettingsError, match="never moves"):
        Apprentice(still, TrainingSettings(), threading.Semaphore(1))


def test_the_school_forgets_and_stops_whom_no_tab_holds(demonstrations):
    school = School()
    apprentice = Apprentice(demonstrations, TrainingSettings(), school.turnstile)
    key = school.enrol(apprentice)
    assert school.hold("no such name") is None
    assert school.hold(key).apprentice is apprentice
    apprentice.learn(MAX_EPOCHS)
    school.let_go(key)
    assert len(school) == 1
    assert apprentice.look.busy
    school.let_go(key)
    assert len(school) == 0
    assert ended(apprentice).phase == "stopped"
    school.let_go(key)  # twice does no harm
