"""The compiled epoch against torch's automatic gradients."""

import numpy as np
import pytest
import torch

from creative_nao.model.config import NetworkSettings
from creative_nao.model.fused import adam_step, loss_and_gradient
from creative_nao.model.kernels import add_product, exp32, tanh32
from creative_nao.model.loss import kl_divergence
from creative_nao.model.mtrnn import PBMTRNN
from creative_nao.model.parameters import layer_time_constants, neighbour_mask, views
from creative_nao.model.targets import target_entropy

PAPER = NetworkSettings()
CASES = {
    "paper": (PAPER, 8, [50] * 6),
    "unequal lengths": (PAPER, 8, [50, 31, 50, 12, 2, 49]),
    "one layer": (NetworkSettings(layer_sizes=(7,), time_constants=(3.0,)), 2, [9, 9]),
    "five layers": (NetworkSettings(layer_sizes=(9, 5, 4, 3, 2), time_constants=(1, 2, 3, 5, 9)), 3, [12, 10, 11, 4]),
    "four PB units": (NetworkSettings(n_pb=4, layer_sizes=(11, 6), time_constants=(2, 6)), 5, [20]),
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

    vector = net.parameter_vector()
    gradient = np.full_like(vector, np.nan)
    found = target_entropy(codes, lengths) + loss_and_gradient(
        *views(vector, net.shapes).values(), neighbour_mask(settings), 1 / layer_time_constants(settings),
        codes, lengths, np.float32(ratio), settings.n_softmax_units, *views(gradient, net.shapes).values(),
    )  # fmt: skip

    assert found == pytest.approx(loss.item(), rel=1e-5)
    for key, mine in views(gradient, net.shapes).items():
        theirs = getattr(net, key).grad.numpy()
        assert np.abs(mine - theirs).max() <= 1e-5 * np.abs(theirs).max(), key


def test_adam_equals_torch():
    rng = np.random.default_rng(0)
    vector = rng.normal(size=101).astype(np.float32)
    parameter = torch.nn.Parameter(torch.from_numpy(vector.copy()))
    optimizer = torch.optim.Adam([parameter], lr=0.001)
    first, second = np.zeros_like(vector), np.zeros_like(vector)
    for epoch in range(1, 20):
        gradient = rng.normal(size=101).astype(np.float32)
        parameter.grad = torch.from_numpy(gradient.copy())
        optimizer.step()
        adam_step(vector, gradient, first, second, epoch, 0.001)

    np.testing.assert_allclose(vector, parameter.detach().numpy(), rtol=2e-6, atol=1e-7)


def test_exp_and_tanh_are_those_of_the_library():
    below_zero = np.linspace(-80, 0, 4001, dtype=np.float32)
    around = np.linspace(-12, 12, 4001, dtype=np.float32)

    exp = np.array([exp32(x) for x in below_zero])
    tanh = np.array([tanh32(x) for x in around])

    np.testing.assert_allclose(exp, np.exp(below_zero.astype(np.float64)), rtol=3e-7)
    np.testing.assert_allclose(tanh, np.tanh(around.astype(np.float64)), atol=4e-7)


@pytest.mark.parametrize(("n", "k", "m"), [(1, 1, 1), (3, 4, 5), (7, 9, 33), (6, 80, 40)])
def test_the_product_is_a_matrix_product(n, k, m):
    rng = np.random.default_rng(0)
    a, b, out = (rng.normal(size=shape).astype(np.float32) for shape in ((n, k), (k, m), (n, m)))
    expected = out + a @ b

    add_product(a, b, out)

    np.testing.assert_allclose(out, expected, rtol=1e-4, atol=1e-5)
