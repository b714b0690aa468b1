"""The compiled heart of generation: one block of PB points in lanes, closed loop, tick by tick.

Every sum goes through its senders in ascending order, one multiply-add after the other, here and wherever else points
are computed: that is what makes results equal to the last bit.
"""

from __future__ import annotations

import numpy as np

from creative_nao.model.matmul import PANEL, multiply_panel
from creative_nao.model.simd import (
    F,
    add_inputs,
    add_outputs,
    at_least,
    compiled,
    exp32,
    load16,
    multiply_add,
    spread16,
    store,
    tanh32,
)

# pyright: reportCallIssue=false, reportOperatorIssue=false, reportArgumentType=false


@compiled()
def _hear(weights, at, row, senders, low, n_heard, start, out, first, n_receivers, n_lanes):
    """Sum what receivers hear, in every lane: out[i] = start[i] + sum over k of w_ik senders[k].

    The weights of receiver `first` begin at `at`, those of the next ones `row` further each; senders are those from
    `low` on. Each sum goes through its senders in ascending order.
    """
    for lane in range(0, n_lanes, PANEL):
        place = first * n_lanes + lane
        multiply_panel(
            weights, at, row, 1, senders, low * n_lanes + lane, n_lanes, n_heard,
            start, place, n_lanes, out, place, n_lanes, n_receivers,
        )  # fmt: skip


@compiled()
def _softmax_and_angles(code, references, n_lanes, angles, row):
    """Turn summed inputs, (n_codes * lanes,), into codes in place and decode the angles of a tick (Eq. 3, 7)."""
    n_joints, n_units = references.shape
    for joint in range(n_joints):
        first = joint * n_units * n_lanes
        end = first + n_units * n_lanes
        for lane in range(0, n_lanes, 16):
            top = load16(code, first + lane)
            for i in range(first + n_lanes + lane, end, n_lanes):
                top = at_least(top, load16(code, i))
            total = spread16(F(0))
            for i in range(first + lane, end, n_lanes):
                power = exp32(load16(code, i) - top)
                store(power, code, i)
                total = total + power
            inverse = spread16(F(1)) / total
            angle = spread16(F(0))
            for unit in range(n_units):
                i = first + unit * n_lanes + lane
                share = load16(code, i) * inverse
                store(share, code, i)
                angle = angle + share * references[joint, unit]
            store(angle, angles, (row + joint) * n_lanes + lane)


@compiled()
def _change_state(a, rate, n_lanes, u, y):
    """Let the internal states follow the summed inputs and fire (Eq. 2, 3)."""
    for i in range(rate.size):
        for lane in range(i * n_lanes, (i + 1) * n_lanes, 16):
            state = multiply_add(F(1) - rate[i], load16(u, lane), rate[i] * load16(a, lane))
            store(state, u, lane)
            store(tanh32(state), y, lane)


@compiled()
def generate_lanes(w_in, w_out, w_hidden, w_pb, b_out, b_hidden, starts, rate, pb, code0, references, angles):
    """Run the network in closed loop for every lane.

    Args:
        w_in, w_out, w_hidden, w_pb: Weights with receivers in rows (transposed), float32.
        b_out, b_hidden: Biases.
        starts: First neuron of each hidden layer, and their number, (n_layers + 1,).
        rate: 1 / time constant of each hidden neuron.
        pb: PB values, (1 or n_steps, n_pb, lanes), the lanes a multiple of `product.PANEL`; with one row it is
            constant. Row t drives the states of tick t.
        code0: Code of the initial posture, (n_codes,).
        references: Reference angles, (n_joints, n_units).
        angles: Where the joint angles go, (n_steps, n_joints, lanes); row 0 is not written.
    """
    n_steps, n_joints, n_lanes = angles.shape
    n_codes, n_hidden, n_pb, n_fast, n_layers = code0.size, rate.size, pb.shape[1], starts[1], starts.size - 1
    from_x, from_fast, from_hidden = w_in.reshape(-1), w_out.reshape(-1), w_hidden.reshape(-1)
    flat_angles = angles.reshape(-1)
    x, bias = np.empty(n_codes * n_lanes, np.float32), np.empty(n_codes * n_lanes, np.float32)
    for i in range(n_codes):
        for lane in range(i * n_lanes, (i + 1) * n_lanes):
            x[lane], bias[lane] = code0[i], b_out[i]
    y, u = np.zeros(n_hidden * n_lanes, np.float32), np.zeros(n_hidden * n_lanes, np.float32)
    a, code = np.empty(n_hidden * n_lanes, np.float32), np.empty(n_codes * n_lanes, np.float32)
    drive = np.empty((n_hidden, n_lanes), np.float32)
    constant = drive.reshape(-1)
    for t in range(1, n_steps):
        if t == 1 or pb.shape[0] > 1:
            point = pb[min(t, pb.shape[0] - 1)]
            for i in range(n_hidden):
                drive[i, :] = b_hidden[i]
                add_inputs(w_pb[i], 0, n_pb, point, drive[i])
        _hear(from_fast, 0, n_fast, y, 0, n_fast, bias, code, 0, n_codes, n_lanes)
        _hear(from_x, 0, n_codes, x, 0, n_codes, constant, a, 0, n_fast, n_lanes)
        for layer in range(n_layers):
            low, high = starts[max(layer - 1, 0)], starts[min(layer + 2, n_layers)]
            first, size = starts[layer], starts[layer + 1] - starts[layer]
            begun = a if layer == 0 else constant  # P_F has heard the input already
            _hear(from_hidden, first * n_hidden + low, n_hidden, y, low, high - low, begun, a, first, size, n_lanes)
        _softmax_and_angles(code, references, n_lanes, flat_angles, t * n_joints)
        _change_state(a, rate, n_lanes, u, y)
        x, code = code, x  # closed loop: the prediction is the next input


@compiled()
def unfold_tick(w_in, w_out, w_hidden, starts, rate, references, drive, x, u, y, code, total, angles):
    """Let the network of one point go one tick on: SIMD over receiving neurons instead of lanes, the same bits.

    Args:
        w_in, w_out, w_hidden: Weights with senders in rows, float32.
        starts: First neuron of each hidden layer, and their number, (n_layers + 1,).
        rate: 1 / time constant of each hidden neuron.
        references: Reference angles, (n_joints, n_units).
        drive: Bias and PB input of each hidden neuron.
        x: Code that the network reads, (n_codes,).
        u, y: Internal states and activations, (n_hidden,); changed.
        code: Biases of P_O, (n_codes,), which the predicted code replaces: the next `x` in closed loop.
        total: Working memory, (n_hidden,).
        angles: Where the joint angles of the tick go, (n_joints,).
    """
    n_codes, n_hidden, n_fast, n_layers = x.shape[0], rate.shape[0], starts[1], starts.shape[0] - 1
    n_joints, n_units = references.shape
    add_outputs(w_out, y, 0, n_fast, code)
    for j in range(n_joints):
        a = code[j * n_units : (j + 1) * n_units]
        top = a[0]
        for k in range(1, n_units):
            top = max(top, a[k])
        for k in range(n_units):
            a[k] = a[k] - top
    for i in range(n_codes):
        code[i] = exp32(code[i])
    for j in range(n_joints):
        a, reference = code[j * n_units : (j + 1) * n_units], references[j]
        norm = F(0)
        for k in range(n_units):
            norm += a[k]
        norm = F(1) / norm
        angle = F(0)
        for k in range(n_units):
            a[k] *= norm
            angle += a[k] * reference[k]
        angles[j] = angle
    total[:] = drive
    add_outputs(w_in, x, 0, n_codes, total[:n_fast])
    for layer in range(n_layers):  # the layer that sends; it reaches its own and the neighbouring layers
        low, high = starts[max(layer - 1, 0)], starts[min(layer + 2, n_layers)]
        add_outputs(w_hidden[:, low:high], y, starts[layer], starts[layer + 1], total[low:high])
    for i in range(n_hidden):
        u[i] = multiply_add(F(1) - rate[i], u[i], rate[i] * total[i])
    for i in range(n_hidden):
        y[i] = tanh32(u[i])


@compiled()
def generate_one(w_in, w_out, w_hidden, w_pb, b_out, b_hidden, starts, rate, pb, code0, references, angles):
    """Run the network in closed loop for one point, with the bits that `generate_lanes` gives it.

    Args:
        w_in, w_out, w_hidden, w_pb: Weights with senders in rows, float32.
        b_out, b_hidden: Biases.
        starts: First neuron of each hidden layer, and their number, (n_layers + 1,).
        rate: 1 / time constant of each hidden neuron.
        pb: PB values, (1 or n_steps, n_pb).
        code0: Code of the initial posture, (n_codes,).
        references: Reference angles, (n_joints, n_units).
        angles: Where the joint angles go, (n_steps, n_joints); row 0 is not written.
    """
    n_codes, n_hidden = code0.shape[0], rate.shape[0]
    x = code0.copy()
    code = np.empty(n_codes, np.float32)
    y = np.zeros(n_hidden, np.float32)
    u = np.zeros(n_hidden, np.float32)
    drive = np.empty(n_hidden, np.float32)
    total = np.empty(n_hidden, np.float32)
    for t in range(1, angles.shape[0]):
        if t == 1 or pb.shape[0] > 1:
            drive[:] = b_hidden
            add_outputs(w_pb, pb[min(t, pb.shape[0] - 1)], 0, pb.shape[1], drive)
        code[:] = b_out
        unfold_tick(w_in, w_out, w_hidden, starts, rate, references, drive, x, u, y, code, total, angles[t])
        x, code = code, x
