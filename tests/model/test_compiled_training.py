"""The compiled epoch against torch's automatic gradients."""

import numpy as np
import pytest
import torch

from creative_nao.model.compiled_training import CompiledNetwork, adam_step
from creative_nao.model.config import NetworkSettings, views
from creative_nao.model.network import PBMTRNN, kl_divergence

PAPER = NetworkSettings()
CASES = {
    "paper": (PAPER, 8, [50] * 6),
    "unequal lengths": (PAPER, 8, [50, 31, 50, 12, 2, 49]),
    "one layer": (NetworkSettings(layer_sizes=(7,), time_constants=(3.0,)), 2, [9, 9]),
    "five layers": (NetworkSettings(layer_sizes=(9, 5, 4, 3, 2), time_constants=(1, 2, 3, 5, 9)), 3, [12, 10, 11, 4]),
    "four PB units": (NetworkSettings(n_pb=4, layer_sizes=(11, 6), time_constants=(2, 6)), 5, [20]),
    "three softmax units": (NetworkSettings(n_softmax_units=3, layer_sizes=(13, 1), time_constants=(2, 4)), 9, [7] * 3),
    "layers of one neuron": (NetworkSettings(layer_sizes=(1, 1, 1), time_constants=(1, 2, 4)), 1, [6, 4]),
    "odd sizes": (NetworkSettings(layer_sizes=(13, 7, 5), time_constants=(2, 4, 8), n_pb=3), 13, [11] * 7),
    "nine actions": (NetworkSettings(layer_sizes=(40, 33), time_constants=(2, 4), n_pb=1), 8, [10] * 9),
    "two softmax units": (NetworkSettings(n_softmax_units=2, layer_sizes=(6, 3), time_constants=(2, 4)), 1, [8] * 7),
}


def make_case(name):
    settings, n_joints, lengths = CASES[name]
    rng = np.random.default_rng(0)
    n_codes = n_joints * settings.n_softmax_units
    net = PBMTRNN(settings, n_codes, len(lengths), seed=1)
    with torch.no_grad():
        net.rho += torch.from_numpy(rng.normal(size=tuple(net.rho.shape)).astype(np.float32))
        net.w_pb *= 5
    raw = np.exp(3 * rng.normal(size=(len(lengths), max(lengths), n_joints, settings.n_softmax_units)))
    codes = (raw / raw.sum(axis=-1, keepdims=True)).reshape(len(lengths), max(lengths), n_codes).astype(np.float32)
    return settings, net, codes, np.array(lengths)


@pytest.mark.parametrize("ratio", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("name", CASES)
def test_loss_and_gradient_equal_automatic_differentiation(name, ratio):
    settings, net, codes, lengths = make_case(name)
    target = torch.from_numpy(codes)
    loss = kl_divergence(net(target, ratio), target, torch.from_numpy(lengths))
    loss.backward()

    compiled = CompiledNetwork(settings, codes, lengths)
    found, gradient = compiled.loss_and_gradient(net.parameter_vector(), ratio)

    assert found == pytest.approx(loss.item(), rel=1e-5)
    for key, mine in views(gradient, net.shapes).items():
        theirs = getattr(net, key).grad.numpy()
        assert np.abs(mine - theirs).max() <= 1e-5 * np.abs(theirs).max(), key


def test_adam_equals_torch():
    rng = np.random.default_rng(0)
    vector = rng.normal(size=112).astype(np.float32)
    parameter = torch.nn.Parameter(torch.from_numpy(vector.copy()))
    optimizer = torch.optim.Adam([parameter], lr=0.001)
    first, second = np.zeros_like(vector), np.zeros_like(vector)
    for epoch in range(1, 20):
        gradient = rng.normal(size=112).astype(np.float32)
        parameter.grad = torch.from_numpy(gradient.copy())
        optimizer.step()
        adam_step(vector, gradient, np.ones_like(vector), first, second, epoch, 0.001)

    np.testing.assert_allclose(vector, parameter.detach().numpy(), rtol=2e-6, atol=1e-7)
