"""A network that learns beside the page: watched, stopped, gone on with, and forgotten when nobody holds it."""

import threading
import time

import numpy as np
import pytest

from creative_nao.demonstrations import Demonstrations, load_demonstrations
from creative_nao.errors import NotFoundError, SettingsError
from creative_nao.explorer import training as explorer_training
from creative_nao.explorer.training import MAX_EPOCHS, Trainer, TrainingSessions
from creative_nao.model import TrainingSettings, train
from creative_nao.model.training import CHUNK_EPOCHS


@pytest.fixture(scope="module")
def demonstrations():
    whole = load_demonstrations()
    return Demonstrations(whole.names[:2], [one[:12] for one in whole.trajectories[:2]], whole.dt_s, whole.joints)


def ended(trainer, seconds=120):
    deadline = time.monotonic() + seconds
    while trainer.progress.busy:
        assert time.monotonic() < deadline, trainer.progress
        time.sleep(0.01)
    return trainer.progress


def test_stopped_and_gone_on_it_learns_the_bits_of_an_uninterrupted_training(demonstrations):
    trainer = Trainer(demonstrations, TrainingSettings(seed=3), threading.Semaphore(1))
    trainer.learn(100_000)
    while trainer.progress.epoch < CHUNK_EPOCHS:
        time.sleep(0.005)
    trainer.stop()
    progress = ended(trainer)
    assert progress.phase == "stopped"
    assert 0 < progress.epoch < 100_000
    assert progress.epoch % CHUNK_EPOCHS == 0
    further = progress.epoch + 300
    trainer.learn(further)
    progress = ended(trainer)
    assert (progress.phase, progress.epoch, progress.n_epochs) == ("finished", further, further)
    straight = train(demonstrations, seed=3, n_epochs=further)
    assert all(
        np.array_equal(progress.memory.parameters[name], straight.parameters[name]) for name in straight.parameters
    )
    assert progress.memory.training == straight.training
    assert progress.curve[-1].tolist() == [further, pytest.approx(straight.loss_history[-1])]


def test_it_waits_for_its_turn_and_can_leave_the_queue(demonstrations):
    concurrency_limit = threading.Semaphore(1)
    with concurrency_limit:
        trainer = Trainer(demonstrations, TrainingSettings(), concurrency_limit)
        trainer.learn(200)
        time.sleep(0.15)
        assert trainer.progress.phase == "waiting"
        with pytest.raises(SettingsError, match="learning already"):
            trainer.learn(300)
        trainer.stop()
        assert ended(trainer).phase == "stopped"
    trainer.learn(200)
    assert ended(trainer).phase == "finished"


def test_a_loss_that_is_not_finite_is_told(demonstrations):
    trainer = Trainer(demonstrations, TrainingSettings(learning_rate=1e30), threading.Semaphore(1))
    trainer.learn(300)
    progress = ended(trainer)
    assert progress.phase == "failed"
    assert "finite" in progress.failure


def test_what_cannot_be_learned_is_refused(demonstrations):
    trainer = Trainer(demonstrations, TrainingSettings(), threading.Semaphore(1))
    for n in (0, MAX_EPOCHS + 1):
        with pytest.raises(SettingsError, match=f"at most 300,000, but is {n:,}"):
            trainer.learn(n)
    still = Demonstrations(("a",), [np.tile([0.5, -0.5, 0.5, 0.5, 0.5, 0.5, 0.5, -0.5], (5, 1))])
    with pytest.raises(SettingsError, match="never moves"):
        Trainer(still, TrainingSettings(), threading.Semaphore(1))


def test_a_trainer_that_no_page_asks_for_is_stopped_and_forgotten(demonstrations, monkeypatch):
    sessions = TrainingSessions()
    trainer = Trainer(demonstrations, TrainingSettings(), sessions.concurrency_limit)
    name = sessions.add(trainer)
    with pytest.raises(NotFoundError, match="is gone"):
        sessions.get("no such name")
    trainer.learn(MAX_EPOCHS)
    sessions.sweep()
    assert sessions.get(name) is trainer
    assert trainer.progress.busy
    monkeypatch.setattr(explorer_training, "PATIENCE_S", -1.0)
    sessions.sweep()
    assert len(sessions) == 0
    assert ended(trainer).phase == "stopped"


def test_there_is_a_most_of_trainers(demonstrations, monkeypatch):
    monkeypatch.setattr(explorer_training, "MAX_TRAINERS", 1)
    sessions = TrainingSessions()
    sessions.add(Trainer(demonstrations, TrainingSettings(), sessions.concurrency_limit))
    with pytest.raises(SettingsError, match="1 memories are being taught"):
        sessions.add(Trainer(demonstrations, TrainingSettings(), sessions.concurrency_limit))


def test_what_is_learned_is_told_and_can_be_explored(demonstrations):
    trainer = Trainer(demonstrations, TrainingSettings(), threading.Semaphore(1))
    with pytest.raises(SettingsError, match="nothing has been learned yet"):
        trainer.loaded()
    trainer.learn(300)
    ended(trainer)
    told = trainer.as_json()
    assert told["phase"] == "finished"
    assert told["epoch"] == told["curve"][-1][0] == 300
    assert len(told["distances"]) == len(told["names"]) == 2
    assert told["map"]["n"] == explorer_training.WATCHED_RESOLUTION
    assert trainer.loaded() is trainer.loaded()
