"""The compiled epoch as a torch function: called like the reference, many times faster."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from creative_nao.errors import ShapeError
from creative_nao.model.compiled_network import CompiledNetwork
from creative_nao.model.mtrnn import PBMTRNN


class _FusedLoss(torch.autograd.Function):
    """Computes the gradient together with the loss: going forward alone would hardly be cheaper."""

    @staticmethod
    def forward(ctx: Any, compiled: CompiledNetwork, ratio: float, *parameters: Tensor) -> Tensor:
        vector = np.concatenate([p.detach().numpy().ravel() for p in parameters])
        loss, gradient = compiled.loss_and_gradient(vector, ratio)
        pieces = torch.from_numpy(gradient).split([p.numel() for p in parameters])
        ctx.save_for_backward(*(piece.view_as(p) for piece, p in zip(pieces, parameters, strict=True)))
        return torch.tensor(loss, dtype=torch.float32)

    @staticmethod
    def backward(ctx: Any, *outer: Any) -> tuple[Tensor | None, ...]:
        return None, None, *(outer[0] * gradient for gradient in ctx.saved_tensors)


def fused_loss(network: PBMTRNN, codes: Tensor, lengths: Tensor, ratio: float) -> Tensor:
    """Return what `kl_divergence(network(codes, ratio), codes, lengths)` returns, by the compiled engine (Eq. 1-5).

    Its `.backward()` fills the gradients of the same parameters. It can be called once per result and not be
    differentiated twice; codes and lengths get no gradient. For long training use `train`, which keeps whole runs of
    epochs in compiled code.

    Args:
        network: The readable network; its parameters are read, and it must be on the CPU in float32.
        codes: Target codes, (n_actions, n_steps, n_codes), positive.
        lengths: Number of steps of each action, (n_actions,); later steps do not count.
        ratio: Closed-loop ratio in [0, 1] (Eq. 5).

    Returns:
        The loss, a scalar float32 tensor.

    Raises:
        ShapeError: If `codes` or `lengths` does not fit the network.

    Example:
        >>> from creative_nao.model import NetworkSettings
        >>> settings = NetworkSettings(layer_sizes=(5,), time_constants=(2,), n_softmax_units=2)
        >>> network = PBMTRNN(settings, n_codes=2, n_actions=1)
        >>> loss = fused_loss(network, torch.full((1, 4, 2), 0.5), torch.tensor([4]), ratio=0.0)
        >>> loss.backward()
        >>> tuple(network.rho.grad.shape)
        (1, 2)
    """
    n_actions, n_codes = network.shapes["rho"][0], network.shapes["b_out"][0]
    if codes.ndim != 3 or codes.shape[0] != n_actions or codes.shape[2] != n_codes:
        raise ShapeError(
            f"`codes` should have shape ({n_actions}, n_steps, {n_codes}) for this network, "
            f"but has {tuple(codes.shape)}"
        )
    if lengths.shape != (n_actions,):
        raise ShapeError(f"`lengths` should have shape ({n_actions},), one per action, but has {tuple(lengths.shape)}")
    compiled = CompiledNetwork(network.settings, codes.detach().numpy(), lengths.numpy())
    loss = _FusedLoss.apply(compiled, float(ratio), *(getattr(network, name) for name in network.shapes))
    assert isinstance(loss, Tensor)
    return loss
