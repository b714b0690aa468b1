"""The compiled heart of generation: one block of PB points in lanes, closed loop, tick by tick."""

from __future__ import annotations

import numpy as np

from creative_nao.model.kernels import F, compiled, exp32, tanh32


@compiled()
def _add_inputs(weights, first, last, senders, out):
    """Add the weighted rows of `senders` from `first` to `last` to `out`, four at a time, in ascending order."""
    n_lanes = out.shape[0]
    full = first + (last - first) // 4 * 4
    for k in range(first, full, 4):
        w0, w1, w2, w3 = weights[k], weights[k + 1], weights[k + 2], weights[k + 3]
        s0, s1, s2, s3 = senders[k], senders[k + 1], senders[k + 2], senders[k + 3]
        for lane in range(n_lanes):
            out[lane] = out[lane] + w0 * s0[lane] + w1 * s1[lane] + w2 * s2[lane] + w3 * s3[lane]
    for k in range(full, last):
        w, s = weights[k], senders[k]
        for lane in range(n_lanes):
            out[lane] += w * s[lane]


@compiled()
def _softmax_and_angle(a, references, angle):
    """Turn one joint's summed inputs, (n_units, lanes), into its code in place and decode its angle (Eq. 3, 7)."""
    n_units, n_lanes = a.shape
    top = a[0].copy()
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


@compiled()
def generate_lanes(
    w_in, w_out, w_hidden, w_pb, b_out, b_hidden, n_fast, first, last, rate, pb, code0, references, angles
):
    """Run the network in closed loop for every lane.

    Args:
        w_in, w_out, w_hidden, w_pb: Weights with receivers in rows (transposed), float32.
        b_out, b_hidden: Biases.
        n_fast: Neurons in P_F, the layer that input and output talk to.
        first, last: For each hidden neuron, the block of hidden neurons it hears.
        rate: 1 / time constant of each hidden neuron.
        pb: PB values, (1 or n_steps, n_pb, lanes); with one row it is constant. Row t drives the states of tick t.
        code0: Code of the initial posture, (n_codes,).
        references: Reference angles, (n_joints, n_units).
        angles: Where the joint angles go, (n_steps, n_joints, lanes); row 0 is not written.
    """
    n_steps, n_joints, n_lanes = angles.shape
    n_codes, n_hidden, n_pb = code0.shape[0], rate.shape[0], pb.shape[1]
    n_units = n_codes // n_joints
    x = np.empty((n_codes, n_lanes), np.float32)
    for i in range(n_codes):
        x[i, :] = code0[i]
    y = np.zeros((n_hidden, n_lanes), np.float32)
    u = np.zeros((n_hidden, n_lanes), np.float32)
    drive = np.empty((n_hidden, n_lanes), np.float32)
    code = np.empty((n_codes, n_lanes), np.float32)
    total = np.empty(n_lanes, np.float32)
    for t in range(1, n_steps):
        if t == 1 or pb.shape[0] > 1:
            point = pb[min(t, pb.shape[0] - 1)]
            for i in range(n_hidden):
                drive[i, :] = b_hidden[i]
                _add_inputs(w_pb[i], 0, n_pb, point, drive[i])
        for i in range(n_codes):
            code[i, :] = b_out[i]
            _add_inputs(w_out[i], 0, n_fast, y, code[i])
        for j in range(n_joints):
            _softmax_and_angle(code[j * n_units : (j + 1) * n_units], references[j], angles[t, j])
        for i in range(n_hidden):  # reads x and y of the tick before
            state, constant = u[i], drive[i]
            for lane in range(n_lanes):
                total[lane] = constant[lane]
            if i < n_fast:
                _add_inputs(w_in[i], 0, n_codes, x, total)
            _add_inputs(w_hidden[i], first[i], last[i], y, total)
            for lane in range(n_lanes):
                state[lane] = (F(1) - rate[i]) * state[lane] + rate[i] * total[lane]
        for i in range(n_hidden):
            activation, state = y[i], u[i]
            for lane in range(n_lanes):
                activation[lane] = tanh32(state[lane])
        x, code = code, x  # closed loop: the prediction is the next input


@compiled()
def _add_outputs(weights, senders, first, last, out):
    """Add what `senders[first:last]` send to all of `out`; `weights` has senders in rows. Order as in `_add_inputs`."""
    n_out = out.shape[0]
    full = first + (last - first) // 4 * 4
    for k in range(first, full, 4):
        w0, w1, w2, w3 = weights[k], weights[k + 1], weights[k + 2], weights[k + 3]
        s0, s1, s2, s3 = senders[k], senders[k + 1], senders[k + 2], senders[k + 3]
        for i in range(n_out):
            out[i] = out[i] + w0[i] * s0 + w1[i] * s1 + w2[i] * s2 + w3[i] * s3
    for k in range(full, last):
        w, s = weights[k], senders[k]
        for i in range(n_out):
            out[i] += w[i] * s


@compiled()
def generate_one(w_in, w_out, w_hidden, w_pb, b_out, b_hidden, starts, rate, pb, code0, references, angles):
    """Run the network in closed loop for one point: SIMD over receiving neurons instead of lanes, the same bits.

    Every neuron adds its inputs one after the other in the order of `generate_lanes`, so the results are equal to the
    last bit.

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
    n_steps, n_joints = angles.shape
    n_codes, n_hidden, n_fast, n_layers = code0.shape[0], rate.shape[0], starts[1], starts.shape[0] - 1
    n_units = n_codes // n_joints
    x = code0.copy()
    code = np.empty(n_codes, np.float32)
    y = np.zeros(n_hidden, np.float32)
    u = np.zeros(n_hidden, np.float32)
    drive = np.empty(n_hidden, np.float32)
    total = np.empty(n_hidden, np.float32)
    for t in range(1, n_steps):
        if t == 1 or pb.shape[0] > 1:
            drive[:] = b_hidden
            _add_outputs(w_pb, pb[min(t, pb.shape[0] - 1)], 0, pb.shape[1], drive)
        code[:] = b_out
        _add_outputs(w_out, y, 0, n_fast, code)
        for j in range(n_joints):
            a, reference = code[j * n_units : (j + 1) * n_units], references[j]
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
            angles[t, j] = angle
        total[:] = drive
        _add_outputs(w_in, x, 0, n_codes, total[:n_fast])
        for layer in range(n_layers):  # the layer that sends; it reaches its own and the neighbouring layers
            low, high = starts[max(layer - 1, 0)], starts[min(layer + 2, n_layers)]
            _add_outputs(w_hidden[:, low:high], y, starts[layer], starts[layer + 1], total[low:high])
        for i in range(n_hidden):
            u[i] = (F(1) - rate[i]) * u[i] + rate[i] * total[i]
        for i in range(n_hidden):
            y[i] = tanh32(u[i])
        x, code = code, x
