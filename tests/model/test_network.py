"""The readable network against the equations of the paper."""

import numpy as np
import pytest
import torch

from creative_nao.model.config import NetworkSettings
from creative_nao.model.network import PBMTRNN

SETTINGS = NetworkSettings(layer_sizes=(5, 4, 3), n_softmax_units=3)


@pytest.fixture
def network():
    net = PBMTRNN(SETTINGS, n_codes=6, n_actions=2, seed=0)
    with torch.no_grad():
        for parameter in net.parameters():
            parameter += 0.3 * torch.randn(parameter.shape, generator=torch.Generator().manual_seed(1))
    return net


@pytest.fixture
def codes():
    raw = torch.rand(2, 9, 2, 3, generator=torch.Generator().manual_seed(2))
    return raw.softmax(dim=-1).flatten(-2)


def test_closed_loop_never_reads_the_teaching_signal(network, codes):
    """Eq. 5 at ratio 1: from the second step on, the input is the network's own prediction."""
    disturbed = codes.clone()
    disturbed[:, 1:] = 1 / SETTINGS.n_softmax_units  # says nothing about any angle

    assert torch.equal(network(disturbed, 1.0), network(codes, 1.0))
    assert not torch.equal(network(disturbed, 0.0), network(codes, 0.0))  # the disturbance does matter


def test_each_joint_has_its_own_softmax(network, codes):
    predicted = network(codes, 0.5).exp().unflatten(-1, (2, 3))

    torch.testing.assert_close(predicted.sum(dim=-1), torch.ones(2, 8, 2))


def test_two_ticks_by_hand(network, codes):
    """Eq. 2 written out in numpy for the first prediction that can depend on the PB."""
    w = {name: getattr(network, name).detach().numpy().astype(np.float64) for name in network.shapes}
    rate = np.repeat(1 / np.array(SETTINGS.time_constants), SETTINGS.layer_sizes)
    from_input = np.zeros(12)
    from_input[:5] = codes[0, 0].numpy() @ w["w_in"]
    u = rate * (np.tanh(w["rho"][0]) @ w["w_pb"] + w["b_hidden"] + from_input)  # u and y of tick 0 are zero
    out = np.tanh(u)[:5] @ w["w_out"] + w["b_out"]
    expected = np.exp(out.reshape(2, 3)) / np.exp(out.reshape(2, 3)).sum(axis=1, keepdims=True)

    predicted = network(codes, 0.0)[0, 1].exp().detach().numpy()

    np.testing.assert_allclose(predicted, expected.ravel(), rtol=1e-5)


def test_only_neighbouring_layers_are_connected(network, codes):
    """P_S and P_F do not talk to each other directly: a weight between them changes nothing."""
    before = network(codes, 1.0)
    with torch.no_grad():
        network.w_hidden[:5, 9:] += 1.0
        network.w_hidden[9:, :5] += 1.0
    assert torch.equal(network(codes, 1.0), before)

    with torch.no_grad():
        network.w_hidden[:5, 5:9] += 1.0
    assert not torch.equal(network(codes, 1.0), before)


def test_a_time_constant_of_one_forgets_the_past_state(codes):
    """Eq. 2 at tau 1: u(t) does not contain u(t-1), so cutting all recurrent weights leaves no memory but the input."""
    settings = NetworkSettings(layer_sizes=(5,), time_constants=(1.0,), n_softmax_units=3)
    net = PBMTRNN(settings, n_codes=6, n_actions=2, seed=0)
    with torch.no_grad():
        net.w_hidden.zero_()
    other = codes.clone()
    other[:, 3] = codes[:, 3].flip(-1)  # is read at tick 4 and shows in the prediction of tick 5

    changed = (net(other, 0.0) != net(codes, 0.0)).any(dim=-1).any(dim=0)

    assert changed.tolist() == [False, False, False, False, True, False, False, False]


def test_slow_neurons_change_slowly():
    """The mean change of the state per tick falls with the time constant."""
    settings = NetworkSettings(layer_sizes=(20, 20, 20), time_constants=(2.0, 8.0, 32.0))
    rate = PBMTRNN(settings, 80, 1).rate

    assert rate.unique().tolist() == [1 / 32, 1 / 8, 1 / 2]


def test_the_seed_decides_the_weights():
    first, again, other = (PBMTRNN(SETTINGS, 6, 2, seed=s).parameter_vector() for s in (7, 7, 8))

    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
