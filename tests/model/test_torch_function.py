"""The compiled loss as a torch function."""

import numpy as np
import pytest
import torch

from creative_nao.errors import ShapeError
from creative_nao.model.config import NetworkSettings
from creative_nao.model.network import PBMTRNN, fused_loss, kl_divergence

SMALL = NetworkSettings(layer_sizes=(7, 4), time_constants=(2, 5), n_softmax_units=5)


@pytest.fixture
def problem():
    rng = np.random.default_rng(0)
    raw = np.exp(rng.normal(size=(3, 12, 2, 5)))
    codes = (raw / raw.sum(axis=-1, keepdims=True)).reshape(3, 12, 10).astype(np.float32)
    return PBMTRNN(SMALL, 10, 3, seed=2), torch.from_numpy(codes), torch.tensor([12, 7, 9])


@pytest.mark.parametrize("ratio", [0.0, 0.5, 1.0])
def test_it_fills_the_gradients_that_the_reference_fills(problem, ratio):
    network, codes, lengths = problem
    reference = 3 * kl_divergence(network(codes, ratio), codes, lengths)
    reference.backward()
    expected = {name: p.grad.clone() for name, p in network.named_parameters()}
    network.zero_grad()

    loss = 3 * fused_loss(network, codes, lengths, ratio)
    loss.backward()

    assert loss.item() == pytest.approx(reference.item(), rel=1e-5)
    for name, p in network.named_parameters():
        assert (p.grad - expected[name]).abs().max() <= 1e-5 * expected[name].abs().max(), name


def test_an_optimizer_learns_with_it(problem):
    network, codes, lengths = problem
    optimizer = torch.optim.Adam(network.parameters(), lr=0.01)
    losses = []
    for _ in range(30):
        optimizer.zero_grad()
        loss = fused_loss(network, codes, lengths, 0.5)
        loss.backward()
        optimizer.step()
        losses.append(loss.item())

    assert losses[-1] < 0.9 * losses[0]


def test_frozen_parameters_get_no_gradient(problem):
    network, codes, lengths = problem
    network.w_in.requires_grad_(False)

    fused_loss(network, codes, lengths, 0.5).backward()

    assert network.w_in.grad is None
    assert network.rho.grad is not None


def test_what_does_not_fit_the_network_is_named(problem):
    network, codes, lengths = problem

    with pytest.raises(ShapeError, match=r"`codes` should have shape \(3, n_steps, 10\).* but has \(2, 12, 10\)"):
        fused_loss(network, codes[:2], lengths, 0.5)
    with pytest.raises(ShapeError, match=r"`lengths` should have shape \(3,\), one per action, but has \(2,\)"):
        fused_loss(network, codes, lengths[:2], 0.5)
