"""The PB-MTRNN in torch, written to be read: the reference that compiled code is tested against (Eq. 1-5)."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor, nn

from creative_nao.model.config import (
    NetworkSettings,
    TrainingState,
    initial_vector,
    layer_time_constants,
    neighbour_mask,
    parameter_shapes,
    views,
)


class PBMTRNN(nn.Module):
    """Multiple-timescale recurrent network with parametric biases.

    P_I feeds P_F, P_F feeds P_O; P_F, P_M, P_S are recurrent and connected both ways with their neighbours; the PB
    units feed P_F, P_M and P_S. Everything at tick t reads activations of tick t-1.

    Args:
        settings: Sizes, time constants and initial values.
        n_codes: Length of one posture's softmax code: n_joints * n_softmax_units.
        n_actions: Number of actions to learn; each has a row of `rho`.
        seed: Seed of the initial weights.
    """

    def __init__(self, settings: NetworkSettings, n_codes: int, n_actions: int, seed: int = 0) -> None:
        super().__init__()
        self.settings = settings
        self.shapes = parameter_shapes(settings, n_codes, n_actions)
        for name, array in views(initial_vector(settings, n_codes, n_actions, seed), self.shapes).items():
            self.register_parameter(name, nn.Parameter(torch.from_numpy(array.copy())))
        self.mask: Tensor
        self.rate: Tensor
        self.register_buffer("mask", torch.from_numpy(neighbour_mask(settings)))
        self.register_buffer("rate", torch.from_numpy(1 / layer_time_constants(settings)))

    def forward(self, codes: Tensor, closed_loop_ratio: float = 0.0, pb: Tensor | None = None) -> Tensor:
        """Predict every next posture of `codes`.

        Args:
            codes: Softmax codes of the actions, shape (n_actions, n_steps, n_codes); the first row is always read,
                later rows are mixed into the input by `closed_loop_ratio`.
            closed_loop_ratio: Share of the prediction in the input (Eq. 5).
            pb: PB values, shape (n_actions, n_pb) in (-1, 1); default: the learned tanh(rho) (Eq. 1).

        Returns:
            Logarithms of the predicted codes for steps 1 to n_steps - 1, shape (n_actions, n_steps - 1, n_codes).
        """
        w = {name: getattr(self, name) for name in self.shapes}
        n_units = self.settings.n_softmax_units
        n_fast = self.settings.layer_sizes[0]
        pb = torch.tanh(w["rho"]) if pb is None else pb
        drive = pb @ w["w_pb"] + w["b_hidden"]  # (n_actions, n_hidden): constant during an action
        w_hidden = w["w_hidden"] * self.mask
        x = codes[:, 0]
        u = codes.new_zeros(len(codes), self.settings.n_hidden)
        y = torch.tanh(u)
        predicted = []
        for t in range(1, codes.shape[1]):
            output = y[:, :n_fast] @ w["w_out"] + w["b_out"]
            log_code = output.unflatten(-1, (-1, n_units)).log_softmax(dim=-1).flatten(-2)  # one softmax per joint (3)
            from_input = nn.functional.pad(x @ w["w_in"], (0, u.shape[1] - n_fast))  # only P_F has input from P_I
            u = (1 - self.rate) * u + self.rate * (drive + y @ w_hidden + from_input)  # Eq. 2
            y = torch.tanh(u)  # Eq. 3
            x = closed_loop_ratio * log_code.exp() + (1 - closed_loop_ratio) * codes[:, t]  # Eq. 5
            predicted.append(log_code)
        return torch.stack(predicted, dim=1)

    def parameter_vector(self) -> np.ndarray:
        """Return all parameters as one flat float32 vector in the order of `parameter_shapes`."""
        return np.concatenate([getattr(self, name).detach().numpy().ravel() for name in self.shapes])

    def load_parameter_vector(self, vector: np.ndarray) -> None:
        """Set all parameters from one flat vector."""
        with torch.no_grad():
            for name, array in views(vector, self.shapes).items():
                getattr(self, name).copy_(torch.from_numpy(np.array(array)))


def kl_divergence(log_predicted: Tensor, target: Tensor, lengths: Tensor) -> Tensor:
    """Return the Kullback-Leibler divergence from target to prediction, summed over steps, units and actions (Eq. 4).

    Args:
        log_predicted: Shape (n_actions, n_steps - 1, n_codes), for steps 1 to n_steps - 1.
        target: Codes of all steps, shape (n_actions, n_steps, n_codes); step 0 is given, not predicted.
        lengths: Number of steps of each action, shape (n_actions,); later steps do not count.
    """
    later = target[:, 1:]
    steps = torch.arange(1, target.shape[1], device=target.device)
    counts = (steps < lengths[:, None])[..., None]
    return torch.where(counts, later * (later.log() - log_predicted), 0.0).sum()


class ReferenceTraining:
    """Training epochs by torch's automatic differentiation and its Adam; made and used like `CompiledNetwork`."""

    def __init__(self, settings: NetworkSettings, codes: np.ndarray, lengths: np.ndarray) -> None:
        self._net = PBMTRNN(settings, codes.shape[2], len(codes))
        self._target, self._lengths = torch.from_numpy(codes), torch.from_numpy(lengths)

    def run_epochs(
        self, state: TrainingState, ratios: np.ndarray, allowed: np.ndarray, learning_rate: float
    ) -> tuple[list[np.ndarray], np.ndarray, int]:
        """Train for one epoch per ratio, or until the loss is not finite; see `CompiledNetwork.run_epochs`."""
        vector, first, second, best = state.vectors
        best_loss, net, shapes = state.best_loss, self._net, self._net.shapes
        net.load_parameter_vector(vector)
        adam = torch.optim.Adam(net.parameters(), lr=learning_rate, betas=(0.9, 0.999), eps=1e-8)
        for name in shapes:  # nothing is kept between calls, so that a checkpoint holds all there is
            adam.state[getattr(net, name)] = {
                "step": torch.tensor(float(state.epoch)),
                "exp_avg": torch.from_numpy(views(first, shapes)[name].copy()),
                "exp_avg_sq": torch.from_numpy(views(second, shapes)[name].copy()),
            }
        losses, best_epoch = [], 0
        for ratio, may_be_best in zip(ratios, allowed, strict=True):
            adam.zero_grad()
            loss = kl_divergence(net(self._target, float(ratio)), self._target, self._lengths)
            if not math.isfinite(loss.item()):
                break
            losses.append(loss.item())
            if may_be_best and losses[-1] < best_loss:
                best_loss, best_epoch, best = losses[-1], len(losses), net.parameter_vector()
            loss.backward()
            adam.step()
        states = [adam.state[getattr(net, name)] for name in shapes]
        moments = [np.concatenate([s[key].numpy().ravel() for s in states]) for key in ("exp_avg", "exp_avg_sq")]
        return [net.parameter_vector(), *moments, best], np.array(losses), best_epoch
