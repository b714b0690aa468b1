import threading

import numpy as np
import pytest

from creative_nao import load_memory, train
from creative_nao.demonstrations import Demonstrations
from creative_nao.errors import FileFormatError, SettingsError, TrainingError
from creative_nao.model import NetworkSettings, TrainingSettings, train_network

TINY = NetworkSettings(layer_sizes=(8, 4), time_constants=(2, 5), n_softmax_units=5)


def bits(memory):
    return np.concatenate([array.ravel() for array in memory.parameters.values()])


def test_training_lowers_the_loss(waves):
    memory = train(waves, n_epochs=2000, network=TINY)

    assert memory.loss_history.shape == (2000,)
    assert memory.loss_history[-1] < 0.3 * memory.loss_history[0]
    assert memory.best_loss == pytest.approx(memory.loss_history.min())


def test_one_seed_one_memory(waves):
    first, again, other = (train(waves, n_epochs=50, network=TINY, seed=seed) for seed in (1, 1, 2))

    assert np.array_equal(bits(first), bits(again))
    assert np.array_equal(first.loss_history, again.loss_history)
    assert not np.array_equal(bits(first), bits(other))


def test_seeds_side_by_side_equal_seeds_alone(waves):
    together = train(waves, seeds=[0, 1, 2], n_epochs=40, network=TINY)

    assert [
        np.array_equal(bits(m), bits(train(waves, seed=s, n_epochs=40, network=TINY))) for s, m in enumerate(together)
    ] == [True] * 3


@pytest.mark.parametrize("ratio", [0.0, 0.5, 1.0])
def test_both_engines_learn_the_same(waves, ratio):
    fused, reference = (
        train(waves, n_epochs=30, network=TINY, closed_loop_ratio=ratio, engine=engine)
        for engine in ("fused", "reference")
    )

    np.testing.assert_allclose(fused.loss_history, reference.loss_history, rtol=1e-4)
    np.testing.assert_allclose(bits(fused), bits(reference), atol=2e-4)


def test_the_best_epoch_is_kept_not_the_last(waves):
    """With a large learning rate the loss goes up and down; the memory has the weights of its lowest point."""
    memory = train(waves, n_epochs=300, network=TINY, learning_rate=0.1)

    assert memory.best_epoch == 1 + int(memory.loss_history.argmin())
    assert memory.best_loss < memory.loss_history[-1]


@pytest.mark.parametrize("engine", ["fused", pytest.param("reference", marks=pytest.mark.slow)])
def test_a_resumed_run_has_the_bits_of_an_uninterrupted_one(waves, tmp_path, engine):
    settings = TrainingSettings(n_epochs=250, seed=4, engine=engine)
    whole = train_network(waves, settings, TINY)
    stop = threading.Event()

    def interrupt(_, state):
        if state.epoch >= 100:
            stop.set()

    with pytest.raises(KeyboardInterrupt):
        train_network(waves, settings, TINY, checkpoint=tmp_path / "c", progress=interrupt, stop=stop)
    resumed = train_network(waves, settings, TINY, checkpoint=tmp_path / "c", resume=True)

    assert np.array_equal(bits(resumed), bits(whole))
    assert np.array_equal(resumed.loss_history, whole.loss_history)
    assert resumed.best_epoch == whole.best_epoch


def test_a_checkpoint_of_other_settings_is_refused_by_name(waves, tmp_path):
    path = tmp_path / "c"
    stop = threading.Event()
    stop_at_once = lambda *_: stop.set()  # noqa: E731
    with pytest.raises(KeyboardInterrupt):
        train_network(waves, TrainingSettings(n_epochs=300), TINY, checkpoint=path, progress=stop_at_once, stop=stop)

    with pytest.raises(SettingsError, match=r"made with seed=0, but seed=1 is asked for"):
        train_network(waves, TrainingSettings(n_epochs=300, seed=1), TINY, checkpoint=path, resume=True)
    other = NetworkSettings(layer_sizes=(9, 4), time_constants=(2, 5), n_softmax_units=5)
    with pytest.raises(SettingsError, match=r"layer_sizes=\(8, 4\), but layer_sizes=\(9, 4\)"):
        train_network(waves, TrainingSettings(n_epochs=300), other, checkpoint=path, resume=True)
    torn = path.read_bytes()[:-100]
    path.write_bytes(torn)
    with pytest.raises(FileFormatError, match="is torn"):
        train_network(waves, TrainingSettings(n_epochs=300), TINY, checkpoint=path, resume=True)


def test_divergence_is_an_error_that_says_where(waves):
    with pytest.raises(TrainingError, match=r"no longer finite at epoch \d+ \(learning rate 1e\+30\)"):
        train(waves, n_epochs=50, network=TINY, learning_rate=1e30)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"closed_loop_ratio": 1.5}, "`closed_loop_ratio` should be at most 1, but is 1.5"),
        ({"n_epochs": 0}, "`n_epochs` should be at least 1, but is 0"),
        ({"learning_rate": float("nan")}, "`learning_rate` should be a finite number, but is nan"),
        ({"engine": "gpu"}, "`engine` should be `fused` or `reference`"),
        ({"epochs": 3}, "no key `epochs`.* there are: .*n_epochs"),
    ],
)
def test_bad_settings_are_named(waves, settings, message):
    with pytest.raises(SettingsError, match=message):
        train(waves, **settings)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"layer_sizes": (4, 0, 3)}, "`layer_sizes`, entry 2 should be at least 1, but is 0"),
        ({"time_constants": (2.0,)}, "`time_constants` should be one per layer, 3"),
        ({"time_constants": (0.5, 1, 1)}, "`time_constants`, entry 1 should be at least 1"),
        ({"n_softmax_units": 1}, "`n_softmax_units` should be at least 2"),
        ({"sigma": 0.0}, "`sigma` should be at least 1e-06, but is 0.0"),
    ],
)
def test_bad_sizes_are_named(settings, message):
    with pytest.raises(SettingsError, match=message):
        NetworkSettings(**settings)


@pytest.mark.parametrize("engine", ["fused", "reference"])
def test_a_joint_that_never_moves_is_learned_as_still(waves, engine, tmp_path):
    still = [t * np.array([1.0, 0.0]) + np.array([0.0, 0.5]) for t in waves.trajectories]
    demos = Demonstrations(waves.names, still, waves.dt_s, waves.joints)
    trained = train(demos, n_epochs=3, network=NetworkSettings(layer_sizes=(6,), time_constants=(2.0,)), engine=engine)
    memory = load_memory(trained.save(tmp_path / "still.safetensors"))
    made = memory.generate(np.random.default_rng(0).uniform(-1, 1, (20, 2)))

    assert np.isfinite(made).all()
    assert np.ptp(made[..., 0]) > 1e-3
    assert np.abs(made[..., 1] - 0.5).max() < 1e-6
    with pytest.raises(SettingsError, match="should move, but RShoulderPitch, RElbowRoll never moves"):
        train(Demonstrations(("a",), [np.tile([0.5, 0.5], (5, 1))], waves.dt_s, waves.joints), n_epochs=1)
