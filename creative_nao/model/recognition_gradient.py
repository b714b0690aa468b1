"""The compiled heart of recognition: closed loop and, beside it, how every angle changes with what is sought.

Forward mode: the derivative with respect to each unknown runs along as further lanes of the same sums. A PB-MTRNN has
two unknowns and hundreds of angles, so this costs three generations; backpropagation would have to keep every tick.

Also here:
- How far a generated movement is from a target, and which way to change PB and initial state to come closer.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from creative_nao.model.config import NetworkSettings
from creative_nao.model.encoding import SoftmaxEncoding
from creative_nao.model.generation import ClosedLoopGenerator
from creative_nao.model.simd import F, add_inputs, compiled, exp32, multiply_add, tanh32

# pyright: reportCallIssue=false


@compiled()
def _softmax_and_angle(a, n_lanes, references, angle, slope):
    """Turn one joint's sums and their derivatives, (n_units, blocks * lanes), into code and angle in place (Eq. 3, 7).

    The derivative of softmax c by an unknown is c (a' - sum_k c_k a'_k).
    """
    n_units = a.shape[0]
    n_unknown = slope.shape[0]
    top = a[0, :n_lanes].copy()
    for j in range(1, n_units):
        row = a[j]
        for lane in range(n_lanes):
            top[lane] = max(top[lane], row[lane])
    total = np.zeros(n_lanes, np.float32)
    for j in range(n_units):
        row = a[j]
        for lane in range(n_lanes):
            row[lane] = exp32(row[lane] - top[lane])
            total[lane] += row[lane]
    for lane in range(n_lanes):
        total[lane] = F(1) / total[lane]
        angle[lane] = F(0)
    for j in range(n_units):
        row, reference = a[j], references[j]
        for lane in range(n_lanes):
            row[lane] *= total[lane]
            angle[lane] += row[lane] * reference
    for k in range(n_unknown):
        change = slope[k]
        total[:] = F(0)
        change[:] = F(0)
        for j in range(n_units):
            code, row = a[j, :n_lanes], a[j, (k + 1) * n_lanes : (k + 2) * n_lanes]
            for lane in range(n_lanes):
                total[lane] += code[lane] * row[lane]
        for j in range(n_units):
            code, row, reference = a[j, :n_lanes], a[j, (k + 1) * n_lanes : (k + 2) * n_lanes], references[j]
            for lane in range(n_lanes):
                row[lane] = code[lane] * (row[lane] - total[lane])
                change[lane] += row[lane] * reference


@compiled()
def generate_with_slopes(
    w_in, w_out, w_hidden, w_pb, b_out, b_hidden, n_fast, first, last, rate, pb, state0, first_state, code0,
    references, angles, slopes,
):  # fmt: skip
    """Run the network in closed loop for every lane and differentiate its angles.

    The unknowns are the PB values and, when `slopes` has room for more, the initial internal states of the neurons from
    `first_state` on.

    Args:
        w_in, w_out, w_hidden, w_pb: Weights with receivers in rows (transposed), float32.
        b_out, b_hidden: Biases.
        n_fast: Neurons in P_F, the layer that input and output talk to.
        first, last: For each hidden neuron, the block of hidden neurons it hears.
        rate: 1 / time constant of each hidden neuron.
        pb: PB values, (n_pb, lanes).
        state0: Internal states u at tick 0, (n_hidden, lanes).
        first_state: The neuron whose initial state is the first unknown after the PB values.
        code0: Code of the initial posture, (n_codes,).
        references: Reference angles, (n_joints, n_units).
        angles: Where the joint angles go, (n_steps, n_joints, lanes); row 0 is not written.
        slopes: Where their derivatives go, (n_steps, n_joints, n_unknown, lanes); row 0 is not written.
    """
    n_steps, n_joints, n_lanes = angles.shape
    n_codes, n_hidden, n_pb = code0.shape[0], rate.shape[0], pb.shape[0]
    n_units, n_unknown = n_codes // n_joints, slopes.shape[2]
    width = (1 + n_unknown) * n_lanes  # the values first, then their derivatives by each unknown
    x = np.zeros((n_codes, width), np.float32)
    y = np.zeros((n_hidden, width), np.float32)
    u = np.zeros((n_hidden, width), np.float32)
    drive = np.zeros((n_hidden, width), np.float32)
    code = np.empty((n_codes, width), np.float32)
    total = np.empty(width, np.float32)
    for i in range(n_codes):
        x[i, :n_lanes] = code0[i]
    for i in range(n_hidden):
        u[i, :n_lanes] = state0[i]
        drive[i, :n_lanes] = b_hidden[i]
        add_inputs(w_pb[i], 0, n_pb, pb, drive[i, :n_lanes])
        for k in range(n_pb):
            drive[i, (k + 1) * n_lanes : (k + 2) * n_lanes] = w_pb[i, k]
    for k in range(n_pb, n_unknown):
        u[first_state + k - n_pb, (k + 1) * n_lanes : (k + 2) * n_lanes] = F(1)
    for t in range(n_steps):
        for i in range(n_hidden):
            activation, state = y[i], u[i]
            for lane in range(n_lanes):
                activation[lane] = tanh32(state[lane])
            for k in range(1, n_unknown + 1):
                change, state_change = y[i, k * n_lanes : (k + 1) * n_lanes], u[i, k * n_lanes : (k + 1) * n_lanes]
                for lane in range(n_lanes):
                    change[lane] = (F(1) - activation[lane] * activation[lane]) * state_change[lane]
        if t == n_steps - 1:
            break
        for i in range(n_codes):
            row = code[i]
            row[:n_lanes] = b_out[i]
            row[n_lanes:] = F(0)
            add_inputs(w_out[i], 0, n_fast, y, row)
        for j in range(n_joints):
            _softmax_and_angle(
                code[j * n_units : (j + 1) * n_units], n_lanes, references[j], angles[t + 1, j], slopes[t + 1, j]
            )
        for i in range(n_hidden):  # reads x and y of the tick before
            state, constant = u[i], drive[i]
            for lane in range(width):
                total[lane] = constant[lane]
            if i < n_fast:
                add_inputs(w_in[i], 0, n_codes, x, total)
            add_inputs(w_hidden[i], first[i], last[i], y, total)
            for lane in range(width):
                state[lane] = multiply_add(F(1) - rate[i], state[lane], rate[i] * total[lane])
        x, code = code, x  # closed loop: the prediction is the next input


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
