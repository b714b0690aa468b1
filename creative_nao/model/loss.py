"""What training minimises: the divergence of the predicted from the taught codes (Eq. 4)."""

from __future__ import annotations

import torch
from torch import Tensor


def kl_divergence(log_predicted: Tensor, target: Tensor, lengths: Tensor) -> Tensor:
    """Return the Kullback-Leibler divergence from target to prediction, summed over steps, units and actions (Eq. 4).

    Args:
        log_predicted: Shape (n_actions, n_steps - 1, n_codes), for steps 1 to n_steps - 1.
        target: Codes of all steps, shape (n_actions, n_steps, n_codes); step 0 is given, not predicted.
        lengths: Number of steps of each action, shape (n_actions,); later steps do not count.
    """
    taught = target[:, 1:]
    steps = torch.arange(1, target.shape[1], device=target.device)
    counts = (steps < lengths[:, None])[..., None]
    return torch.where(counts, taught * (taught.log() - log_predicted), 0.0).sum()
