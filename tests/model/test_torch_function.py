"""The compiled loss and gradient, wrapped here as a torch function, beside torch's own."""

import numpy as np
import pytest
import torch

from creative_nao.model.compiled_training import CompiledNetwork
from creative_nao.model.config import NetworkSettings
from creative_nao.model.network import PBMTRNN, kl_divergence

SMALL = NetworkSettings(layer_sizes=(7, 4), time_constants=(2, 5), n_softmax_units=5)


class FusedLoss(torch.autograd.Function):
    """Computes the gradient together with the loss, by the compiled engine."""

    @staticmethod
    def forward(ctx, compiled, ratio, *parameters):
        vector = np.concatenate([p.detach().numpy().ravel() for p in parameters])
        loss, gradient = compiled.loss_and_gradient(vector, ratio)
        pieces = torch.from_numpy(gradient).split([p.numel() for p in parameters])
        ctx.save_for_backward(*(piece.view_as(p) for piece, p in zip(pieces, parameters, strict=True)))
        return torch.tensor(loss, dtype=torch.float32)

    @staticmethod
    def backward(ctx, outer):
        return None, None, *(outer * gradient for gradient in ctx.saved_tensors)


def fused_loss(network, codes, lengths, ratio):
    """Return what `kl_divergence(network(codes, ratio), codes, lengths)` returns (Eq. 1-5)."""
    compiled = CompiledNetwork(network.settings, codes.numpy(), lengths.numpy())
    return FusedLoss.apply(compiled, ratio, *(getattr(network, name) for name in network.shapes))


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
