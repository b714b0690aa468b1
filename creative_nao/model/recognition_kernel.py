"""The compiled heart of recognition: closed loop and, beside it, how every angle changes with what is sought.

Forward mode: the derivative with respect to each unknown runs along as further lanes of the same sums. A PB-MTRNN has
two unknowns and hundreds of angles, so this costs three generations; backpropagation would have to keep every tick.
"""

# pyright: reportCallIssue=false

from __future__ import annotations

import numpy as np

from creative_nao.model.kernels import F, compiled, exp32, tanh32
from creative_nao.model.sums import add_inputs
from creative_nao.model.vectors import multiply_add


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
