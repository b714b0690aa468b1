"""How far a generated movement is from a target, and which way to change PB and initial state to come closer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from creative_nao.model.config import NetworkSettings
from creative_nao.model.encoding import SoftmaxEncoding
from creative_nao.model.generation import ClosedLoopGenerator

PAD = 16
"""Lanes are filled up to a multiple of this: one 512-bit register of float32."""
BLOCK = 32
"""Points differentiated side by side; with their derivatives they still fit a fast cache."""


class NormalEquations(NamedTuple):
    """The squared error of n points and its quadratic approximation (Gauss-Newton).

    Attributes:
        error: Mean squared difference of the angles from the target [rad^2], shape (n,).
        curvature: J^T J, J the derivative of the angles by the unknowns over ticks and joints, (n, k, k).
        downhill: J^T (target - angles), shape (n, k).
    """

    error: np.ndarray
    curvature: np.ndarray
    downhill: np.ndarray


class DifferentiableGenerator:
    """A network prepared for generation together with its derivatives, and from any initial state.

    An unknown is a row of PB values, followed, if the initial state is sought, by the internal states at tick 0 of the
    neurons of the slowest layer: the only ones that remember it for long.

    Args:
        settings: Sizes and time constants.
        parameters: By name, shapes as in `parameters.parameter_shapes`, float32.
        encoding: The joints' softmax code.
        initial_posture: Joint angles at tick 0 [rad], shape (n_joints,).
    """

    def __init__(
        self,
        settings: NetworkSettings,
        parameters: dict[str, np.ndarray],
        encoding: SoftmaxEncoding,
        initial_posture: np.ndarray,
    ) -> None:
        self.from_pb = ClosedLoopGenerator(settings, parameters, encoding, initial_posture)
        """Generates from PB values alone, without derivatives: (n, n_pb) into (n, n_steps, n_joints) [rad]."""
        starts = self.from_pb.starts
        layer = np.repeat(np.arange(len(settings.layer_sizes)), settings.layer_sizes)
        # A neuron hears the contiguous block from the first neuron of the layer before to the last of the layer after.
        heard = starts[np.maximum(layer - 1, 0)], starts[np.minimum(layer + 2, len(starts) - 1)]
        weights, biases = self.from_pb.to_receiver, self.from_pb.biases
        self._network = (*weights, *biases, settings.layer_sizes[0], *heard, self.from_pb.rate)
        self._n_hidden, self._slow = settings.n_hidden, int(starts[-2])
        self._references, self._initial_code = self.from_pb.references, self.from_pb.initial_code

    @property
    def n_slow(self) -> int:
        """Neurons of the slowest layer."""
        return self._n_hidden - self._slow

    def initial_state(self, slow: np.ndarray) -> np.ndarray:
        """Return the internal state of all hidden neurons [no unit] at tick 0, `slow` in the slowest layer, else 0."""
        return np.concatenate([np.zeros(self._slow), slow])

    def trajectories(self, unknowns: np.ndarray, n_pb: int, n_steps: int) -> np.ndarray:
        """Generate from PB and initial state: (n, k) unknowns into (n, n_steps, n_joints) [rad]."""
        if unknowns.shape[1] == n_pb:
            return self.from_pb(unknowns, n_steps)
        blocks = [self._block(unknowns[k : k + BLOCK], n_pb, n_steps)[0] for k in range(0, len(unknowns), BLOCK)]
        found = np.concatenate(blocks, axis=-1).transpose(2, 0, 1).astype(np.float64)
        found[:, 0] = self.from_pb.initial_posture
        return found

    def normal_equations(self, unknowns: np.ndarray, n_pb: int, target: np.ndarray) -> NormalEquations:
        """Compare what each point generates with `target`, (n_steps, n_joints) [rad]; tick 0 is given, not compared."""
        n, k = unknowns.shape
        found = NormalEquations(np.empty(n), np.empty((n, k, k)), np.empty((n, k)))
        for start in range(0, n, BLOCK):
            part = slice(start, min(start + BLOCK, n))
            angles, slopes = self._block(unknowns[part], n_pb, len(target))
            rest = (target[1:, :, None] - angles[1:]).reshape(-1, angles.shape[-1]).T  # (lanes, angles)
            jacobian = slopes[1:].reshape(-1, k, angles.shape[-1]).transpose(2, 0, 1).astype(np.float64)
            found.error[part] = (rest**2).mean(axis=1)
            found.curvature[part] = jacobian.transpose(0, 2, 1) @ jacobian
            found.downhill[part] = (rest[:, None, :] @ jacobian)[:, 0]
        return found

    def _block(self, unknowns: np.ndarray, n_pb: int, n_steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Return angles (n_steps, n_joints, n) and slopes (n_steps, n_joints, n_unknown, n), float32."""
        from creative_nao.model.recognition_kernel import generate_with_slopes

        n, n_unknown = unknowns.shape
        lanes = -(-n // PAD) * PAD
        pb = np.zeros((n_pb, lanes), np.float32)
        pb[:, :n] = unknowns[:, :n_pb].T
        state0 = np.zeros((self._n_hidden, lanes), np.float32)
        if n_unknown > n_pb:
            state0[self._slow :, :n] = unknowns[:, n_pb:].T
        angles = np.zeros((n_steps, len(self._references), lanes), np.float32)
        slopes = np.zeros((n_steps, len(self._references), n_unknown, lanes), np.float32)
        generate_with_slopes(
            *self._network, pb, state0, self._slow, self._initial_code, self._references, angles, slopes,
        )  # fmt: skip
        return angles[..., :n], slopes[..., :n]
