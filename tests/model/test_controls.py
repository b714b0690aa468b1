"""Controls: memories that mix the basic actions, behind the interface of a memory."""

import numpy as np
import pytest

from creative_nao import pb_map
from creative_nao.errors import SettingsError
from creative_nao.model import controls as module
from creative_nao.model import load_memory, reproduction
from creative_nao.model.controls import CONTROLS, aligned, control_memory
from creative_nao.testing import check_memory


@pytest.fixture(scope="module")
def memory():
    return load_memory("half/0")


@pytest.fixture
def short_training(monkeypatch):
    monkeypatch.setattr(module, "N_STEPS", 300)


@pytest.mark.parametrize("kind", CONTROLS)
def test_a_control_is_a_memory(memory, kind, short_training):
    check_memory(control_memory(memory, kind, seed=3))


def test_a_blend_gives_every_action_at_its_own_point_and_stays_in_the_hull_of_all(memory):
    control = control_memory(memory, "interpolation")
    assert max(reproduction(control)) < 0.2  # the first posture is the mean one
    assert max(reproduction(control_memory(memory, "splines"))) < 10.0

    every = np.array(memory.demonstrations.trajectories)
    moves = control.generate(np.random.default_rng(1).uniform(-1, 1, (50, 2)))[:, 1:]
    assert (moves >= every.min(axis=0)[1:] - 1e-9).all()
    assert (moves <= every.max(axis=0)[1:] + 1e-9).all()
    midway = control.generate(memory.pb[:2].mean(axis=0, keepdims=True))[0]
    two = np.mean(memory.demonstrations.trajectories[:2], axis=0)
    others = [np.abs(midway - one).mean() for one in memory.demonstrations.trajectories[2:]]
    assert np.abs(midway - two).mean() < min(others)


def test_actions_of_unequal_length_keep_their_durations_and_rest_at_their_end(waves):
    from creative_nao.model import NetworkSettings, TrainingSettings, train_network

    network = NetworkSettings(layer_sizes=(8, 4), time_constants=(2, 5), n_softmax_units=5)
    small = train_network(waves, TrainingSettings(n_epochs=200), network)
    first, second = control_memory(small, "interpolation").generate(small.pb)

    assert aligned(waves).shape == (2, 20, 2)
    np.testing.assert_allclose(first[1:], waves.trajectories[0][1:], atol=1e-6)
    np.testing.assert_allclose(second[1:15], waves.trajectories[1][1:], atol=0.02)
    np.testing.assert_allclose(second[15:], np.repeat(waves.trajectories[1][-1:], 5, axis=0), atol=1e-6)


def test_joints_of_splines_follow_different_actions(memory):
    """Somewhere one arm is nearer to one action and the other arm to another; of an interpolation that is the blend."""
    points = np.random.default_rng(2).uniform(-1, 1, (200, 2))
    shares = []
    for kind in ("interpolation", "splines"):
        moves = control_memory(memory, kind).generate(points)
        basic = aligned(memory.demonstrations)
        gaps = np.abs(moves[:, None] - basic[None]).mean(axis=2)  # (point, action, joint)
        nearest = gaps.argmin(axis=1)
        shares.append(float((nearest != nearest[:, :1]).any(axis=1).mean()))
    assert shares[1] > shares[0]


@pytest.mark.slow
def test_the_autoencoder_gives_every_action_back(memory):
    assert max(reproduction(control_memory(memory, "vae"))) < 10.0


def test_the_seed_decides_what_the_autoencoder_learns(memory, short_training):
    one, same, other = (control_memory(memory, "vae", seed=seed) for seed in (0, 0, 1))

    assert np.array_equal(one.pb, same.pb)
    assert not np.array_equal(one.pb, other.pb)


def test_the_slopes_of_the_autoencoder_are_those_of_its_loss():
    rng = np.random.default_rng(0)
    data = rng.normal(size=(3, 5))
    sizes = ((4, 5), (4, 4), (4, 2), (5, 4))
    layers = [value for n in sizes for value in (rng.normal(size=n), rng.normal(size=n[0]))]

    def loss():
        latent = module._encode(layers, data)[1]
        centre, log_variance = np.split(latent, 2, axis=1)
        drawn = centre + np.random.default_rng(9).standard_normal(centre.shape) * np.exp(0.5 * log_variance)
        told = np.tanh(drawn @ layers[4].T + layers[5]) @ layers[6].T + layers[7]
        divergence = 0.5 * (centre**2 + np.exp(log_variance) - 1 - log_variance).sum(axis=1).mean()
        return ((told - data) ** 2).mean() + module.KL_WEIGHT * divergence

    for value, slope in zip(layers, module._slopes(layers, data, np.random.default_rng(9)), strict=True):
        place = (0,) * value.ndim
        was = value[place]
        value[place] = was + 1e-6
        above = loss()
        value[place] = was - 1e-6
        below = loss()
        value[place] = was
        assert slope[place] == pytest.approx((above - below) / 2e-6, rel=1e-4, abs=1e-8)


def test_an_unknown_control_is_refused_and_a_control_can_be_mapped(memory):
    with pytest.raises(SettingsError, match="`control` should be one of interpolation, splines, vae, but is 'gan'"):
        control_memory(memory, "gan")
    with pytest.raises(SettingsError, match="`memory` should be of the class Memory"):
        control_memory(None, "vae")
    scored = pb_map(control_memory(memory, "interpolation"), resolution=20)
    assert scored.share_pct("learned") > 0
