"""The condition `auto`, and the verdict on what comes back."""

import dataclasses
import threading

import numpy as np
import pytest

from creative_nao import errors, train
from creative_nao.demonstrations import Demonstrations
from creative_nao.joints import JOINTS
from creative_nao.model import (
    Memory,
    NetworkSettings,
    RecallReport,
    TrainingSettings,
    config,
    reproduction,
    train_network,
)
from creative_nao.model.config import AUTO, attempts
from creative_nao.model.encoding import encoding_of, target_codes
from creative_nao.model.training import train_many

TINY = NetworkSettings(layer_sizes=(8, 4), time_constants=(2, 5), n_softmax_units=5)
AUTOMATIC = TrainingSettings(condition="auto", n_epochs=700)


def gestures(seed, n_actions=6):
    """Movements of unequal length from and to a resting posture that differs by a hundredth of a radian each time."""
    rng = np.random.default_rng(seed)
    rest = np.array([1.54, -0.14, 1.22, 0.51, 1.54, 0.14, -1.22, -0.51])
    trajectories = []
    for n_steps in rng.integers(23, 61, n_actions):
        keys = rest + np.r_[[[0.0] * 8], rng.uniform(-0.4, 0.4, (4, 8)), [[0.0] * 8]]
        keys[[0, -1]] += rng.normal(0.0, 0.01, (2, 8))
        place = np.linspace(0.0, 5.0, n_steps)
        part = place % 1.0
        smooth = np.minimum(place.astype(int), 4) + np.where(place < 5.0, 10 * part**3 - 15 * part**4 + 6 * part**5, 1)
        trajectories.append(np.stack([np.interp(smooth, np.arange(6), key) for key in keys.T], axis=1))
    return Demonstrations(tuple(f"gesture_{k}" for k in range(n_actions)), trajectories, 0.15, JOINTS)


@pytest.fixture
def short_attempts(monkeypatch):
    monkeypatch.setattr(config, "FIRST_ATTEMPT_EPOCHS", 100)


def test_auto_is_cut_into_attempts_that_double_and_use_up_all_epochs():
    def lengths(n_epochs):
        return [one.n_epochs for one in attempts(dataclasses.replace(AUTOMATIC, n_epochs=n_epochs))]

    assert lengths(100_000) == [20_000, 40_000, 40_000]
    assert lengths(2_000) == [2_000]
    assert lengths(35_000) == [35_000]
    assert lengths(70_000) == [20_000, 50_000]
    assert [one.attempt for one in attempts(TrainingSettings(condition="auto"))] == [1, 2, 3]
    assert attempts(TrainingSettings(seed=3)) == (TrainingSettings(seed=3),)


def test_every_action_is_read_from_the_mean_first_posture_and_held_at_its_end(waves):
    encoding = encoding_of(waves, TINY)
    own, lengths = target_codes(encoding, waves.trajectories)
    codes, held = target_codes(encoding, waves.trajectories, "mean", "held")

    assert lengths.tolist() == [20, 15]
    assert held.tolist() == [20, 20]
    mean = encoding.encode(waves.initial_posture)
    np.testing.assert_allclose(codes[:, 0], [mean, mean], atol=1e-7)
    assert np.array_equal(codes[:, 1:], own[:, 1:])
    assert np.array_equal(codes[1, 15:], np.repeat(codes[1, 14:15], 5, axis=0))


def test_an_attempt_is_a_training_like_any_other(waves, short_attempts):
    memory = train(waves, condition="auto", n_epochs=700, seed=2, network=TINY)

    assert {name: getattr(memory.training, name) for name in AUTO} == AUTO
    again = train_network(waves, memory.training, TINY)
    assert again.parameters.keys() == memory.parameters.keys()
    assert all(np.array_equal(again.parameters[name], memory.parameters[name]) for name in again.parameters)


def test_attempts_end_with_the_first_that_gives_everything_back_and_are_recorded(waves, short_attempts, tmp_path):
    wanted = [dataclasses.replace(AUTOMATIC, seed=seed) for seed in (0, 1)]
    for one in train_many(waves, wanted, TINY, out=lambda training: tmp_path / f"{training.seed}"):
        memory = Memory.read(tmp_path / f"{one.training.seed}")
        tried, kept = memory.record["attempts"], memory.record["kept_attempt"]
        back = [max(attempt["reproduction_dtw"].values()) <= 10.0 for attempt in tried]
        assert not any(back[:-1])
        assert back[-1] or len(tried) == 3
        assert tried[kept - 1]["reproduction_dtw"] == RecallReport.of(memory).distances
        assert memory.training.attempt == kept
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0", "1"]


def test_the_best_of_attempts_that_all_fail_is_kept(waves, short_attempts, monkeypatch):
    monkeypatch.setattr(RecallReport, "missing", property(lambda self: tuple(self.distances)))
    memory = train_network(waves, AUTOMATIC, TINY)

    worst = [max(one["reproduction_dtw"].values()) for one in memory.record["attempts"]]
    assert len(worst) == 3
    assert memory.record["kept_attempt"] == 1 + int(np.argmin(worst))
    assert max(reproduction(memory)) == min(worst)


def test_auto_resumed_in_its_second_attempt_has_the_bits_of_an_uninterrupted_run(
    waves, short_attempts, monkeypatch, tmp_path
):
    monkeypatch.setattr(RecallReport, "missing", property(lambda self: tuple(self.distances)))
    whole = train_network(waves, AUTOMATIC, TINY)
    stop = threading.Event()

    def interrupt(training, _):
        if training.attempt == 2:
            stop.set()

    options = {"checkpoint": tmp_path / "c", "checkpoint_interval": 100}
    with pytest.raises(KeyboardInterrupt):
        train_network(waves, AUTOMATIC, TINY, progress=interrupt, stop=stop, **options)
    seen = set()
    resumed = train_network(
        waves, AUTOMATIC, TINY, resume=True, progress=lambda training, _: seen.add(training.attempt), **options
    )

    assert seen == {2, 3}
    assert resumed.record["attempts"] == whole.record["attempts"]
    assert all(np.array_equal(resumed.parameters[name], whole.parameters[name]) for name in whole.parameters)


def test_an_attempt_that_diverges_counts_as_failed_and_all_of_them_are_an_error(waves, short_attempts):
    with pytest.raises(errors.TrainingError, match="no longer finite"):
        train(waves, condition="auto", n_epochs=300, network=TINY, learning_rate=1e30)


def test_a_condition_is_a_ratio_by_name(waves):
    named = train(waves, condition="closed", n_epochs=1, network=TINY)

    assert named.training == TrainingSettings(closed_loop_ratio=1.0, n_epochs=1)
    with pytest.raises(errors.SettingsError, match="one of open, half, closed, auto, but is 'fast'"):
        train(waves, condition="fast")
    with pytest.raises(errors.SettingsError, match="`condition` and `closed_loop_ratio` say the same"):
        train(waves, condition="auto", closed_loop_ratio=0.5)


def test_what_does_not_come_back_is_warned_of_by_name_with_what_to_try(demonstrations):
    with pytest.warns(errors.RecallWarning, match=r"seed 7: 0 of 6 .* not: left_jab \(.*\. Try the condition auto"):
        train(demonstrations, n_epochs=1, seed=7, network=TINY)
    distances = {"wave": 3.0, "nod": 12.5}
    assert str(RecallReport(distances, TrainingSettings(**AUTO))) == (
        "1 of 2 basic actions come back within DTW 10 in closed loop; not: nod (12.5). "
        "Try more epochs or another seed, fewer actions, or a network with larger layers"
    )
    assert str(RecallReport({"wave": 3.0}, TrainingSettings())).startswith("all 1 basic actions come back")


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_auto_gives_gestures_of_unequal_length_back_to_their_end_and_beyond(seed):
    demos = gestures(seed)
    memories = train(demos, condition="auto", seeds=[0, 1, 2])

    assert [RecallReport.of(memory).missing for memory in memories] == [()] * 3
    for memory in memories:
        for generated, action in zip(memory.generate(memory.pb), demos.trajectories, strict=True):
            assert np.abs(generated[len(action) - 1 :] - action[-1]).max() < 0.2
