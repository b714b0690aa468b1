"""The PB-MTRNN in torch, written to be read: the reference that the compiled engine is tested against (Eq. 1-5)."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from creative_nao.model.config import NetworkSettings
from creative_nao.model.parameters import initial_vector, layer_time_constants, neighbour_mask, parameter_shapes, views


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
            from_input = nn.functional.pad(x @ w["w_in"], (0, u.shape[1] - n_fast))  # only P_F hears P_I
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
