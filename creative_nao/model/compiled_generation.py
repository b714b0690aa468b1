"""Compiled closed-loop generation (Eq. 1-3, 5 at ratio 1, 7), of a batch of PB points or of single ones.

A batch uses SIMD over its points, a single point over the postsynaptic units. Every weighted sum adds its inputs in
ascending order, one multiply-add after the other, in both: a point has the same bits in each of them and in any batch.

A batch may carry derivatives (forward mode). Each row of a matrix then holds the values of all points, followed by
their derivatives by the first unknown, by the second, and so on: the same matrix product computes them all. A PB-MTRNN
has two unknowns and hundreds of angles, so this costs three generations; backpropagation would have to keep every tick.
"""

from __future__ import annotations

import numpy as np

from creative_nao.model.matmul import PANEL, multiply_panel
from creative_nao.model.simd import F, at_least, compiled, exp32, load16, multiply_add, spread16, store, tanh32

# pyright: reportCallIssue=false, reportOperatorIssue=false, reportArgumentType=false


@compiled()
def _add_products(weights, first_weight, n_presynaptic, inputs, first_input, n_inputs, start, out, first, n_units):
    """Compute out[i, :] = start[i, :] + sum over k of w_ik inputs[k, :] for `n_units` rows from row `first` on.

    A unit has a row of `n_presynaptic` weights; the sum takes `n_inputs` of them, with those rows of `inputs`.
    """
    width = out.shape[1]
    for column in range(0, width, PANEL):
        place = first * width + column
        multiply_panel(
            weights, first_weight, n_presynaptic, 1, inputs, first_input * width + column, width, n_inputs,
            start, place, width, out, place, width, n_units,
        )  # fmt: skip


@compiled()
def _decode(code, n_points, references, angles):
    """Turn the summed inputs of P_O into codes in place and decode the angles of one tick (Eq. 3, 7).

    The derivative of a code c by an unknown is c (a' - sum_k c_k a'_k), a' being that of the summed input.
    """
    n_joints, n_units = references.shape
    width = code.shape[1]
    for joint in range(n_joints):
        first, end = joint * n_units * width, (joint + 1) * n_units * width
        for point in range(0, n_points, 16):
            top = load16(code, first + point)
            for i in range(first + width + point, end, width):
                top = at_least(top, load16(code, i))
            total = spread16(F(0))
            for i in range(first + point, end, width):
                power = exp32(load16(code, i) - top)
                store(power, code, i)
                total = total + power
            inverse = spread16(F(1)) / total
            angle = spread16(F(0))
            for unit in range(n_units):
                i = first + unit * width + point
                share = load16(code, i) * inverse
                store(share, code, i)
                angle = angle + share * references[joint, unit]
            store(angle, angles, joint * width + point)
            for shift in range(n_points, width - point, n_points):
                mean, slope = spread16(F(0)), spread16(F(0))
                for i in range(first + point, end, width):
                    mean = mean + load16(code, i) * load16(code, i + shift)
                for unit in range(n_units):
                    i = first + unit * width + point
                    change = load16(code, i) * (load16(code, i + shift) - mean)
                    store(change, code, i + shift)
                    slope = slope + change * references[joint, unit]
                store(slope, angles, joint * width + point + shift)


@compiled()
def _update_states(a, rate, n_points, u, y):
    """Move the internal states u towards the summed inputs and compute the activations y (Eq. 2, 3)."""
    width = a.shape[1]
    for unit in range(rate.size):
        end = (unit + 1) * width
        for i in range(unit * width, unit * width + n_points, 16):
            state = multiply_add(F(1) - rate[unit], load16(u, i), rate[unit] * load16(a, i))
            activation = tanh32(state)
            store(state, u, i)
            store(activation, y, i)
            for k in range(i + n_points, end, n_points):
                change = multiply_add(F(1) - rate[unit], load16(u, k), rate[unit] * load16(a, k))
                store(change, u, k)
                store((F(1) - activation * activation) * change, y, k)


@compiled()
def generate_batch(net, n_points, pb, code0, u, angles):
    """Run the network in closed loop for a batch of points, with derivatives where the rows have room for them.

    Args:
        net: Weights, biases, layer bounds, rates and reference angles; a row for each postsynaptic unit.
        n_points: Columns that hold values, a multiple of 16; all columns together, `width`, are one of `matmul.PANEL`.
        pb: PB values, (1 or n_steps, n_pb, width); with one row they are constant. Row t drives the states of tick t.
        code0: Code of the initial posture, (n_codes,).
        u: Internal states at tick 0, (n_hidden, width); changed.
        angles: Where the joint angles go, (n_steps, n_joints, width); row 0 is not written.
    """
    w_in, w_out, w_hidden, w_pb, b_out, b_hidden, starts, rate, references = net
    n_steps, _, width = angles.shape
    n_codes, n_hidden, n_fast, n_layers = code0.size, rate.size, starts[1], starts.size - 1
    x, code, bias = np.zeros((n_codes, width), F), np.zeros((n_codes, width), F), np.zeros((n_codes, width), F)
    y, a = np.zeros((n_hidden, width), F), np.zeros((n_hidden, width), F)
    drive, bias_hidden = np.zeros((n_hidden, width), F), np.zeros((n_hidden, width), F)
    for i in range(n_codes):
        for point in range(n_points):
            x[i, point], bias[i, point] = code0[i], b_out[i]
    for i in range(n_hidden):
        for point in range(n_points):
            bias_hidden[i, point] = b_hidden[i]
    _update_states(u, np.zeros(n_hidden, F), n_points, u, y)  # at rate 0 the states stay as they are
    for t in range(1, n_steps):
        if t == 1 or pb.shape[0] > 1:
            n_pb = pb.shape[1]
            _add_products(w_pb, 0, n_pb, pb[min(t, pb.shape[0] - 1)], 0, n_pb, bias_hidden, drive, 0, n_hidden)
        _add_products(w_out, 0, n_fast, y, 0, n_fast, bias, code, 0, n_codes)
        _add_products(w_in, 0, n_codes, x, 0, n_codes, drive, a, 0, n_fast)
        for layer in range(n_layers):  # reads the layer itself and its neighbours
            low, high = starts[max(layer - 1, 0)], starts[min(layer + 2, n_layers)]
            first, size = starts[layer], starts[layer + 1] - starts[layer]
            start = a if layer == 0 else drive  # P_F has added its input already
            _add_products(w_hidden, first * n_hidden + low, n_hidden, y, low, high - low, start, a, first, size)
        _decode(code, n_points, references, angles[t])
        _update_states(a, rate, n_points, u, y)
        x, code = code, x  # closed loop: the prediction is the next input


@compiled()
def _add_outgoing(weights, activations, first, last, out):
    """Add the weighted `activations[first:last]` to `out`; a row of `weights` belongs to a presynaptic unit."""
    n_out = out.shape[0]
    full = first + (last - first) // 4 * 4
    for k in range(first, full, 4):
        w0, w1, w2, w3 = weights[k], weights[k + 1], weights[k + 2], weights[k + 3]
        s0, s1, s2, s3 = activations[k], activations[k + 1], activations[k + 2], activations[k + 3]
        for i in range(n_out):
            out[i] = out[i] + w0[i] * s0 + w1[i] * s1 + w2[i] * s2 + w3[i] * s3
    for k in range(full, last):
        w, s = weights[k], activations[k]
        for i in range(n_out):
            out[i] += w[i] * s


@compiled()
def _tick(w_in, w_out, w_hidden, b_out, starts, rate, references, drive, x, u, y, code, total, angles):
    """Run one point for one tick: x is what the network reads, `code` what it reads next, u and y are its state."""
    n_codes, n_hidden, n_fast, n_layers = x.shape[0], rate.shape[0], starts[1], starts.shape[0] - 1
    n_joints, n_units = references.shape
    code[:] = b_out
    _add_outgoing(w_out, y, 0, n_fast, code)
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
    _add_outgoing(w_in, x, 0, n_codes, total[:n_fast])
    for layer in range(n_layers):  # drives the layer itself and its neighbours
        low, high = starts[max(layer - 1, 0)], starts[min(layer + 2, n_layers)]
        _add_outgoing(w_hidden[:, low:high], y, starts[layer], starts[layer + 1], total[low:high])
    for i in range(n_hidden):
        u[i] = multiply_add(F(1) - rate[i], u[i], rate[i] * total[i])
    for i in range(n_hidden):
        y[i] = tanh32(u[i])


@compiled()
def advance(net, pb, first, codes, states, activities, angles):
    """Run single points one after the other in closed loop; writes `angles`, (n, n_ticks, n_joints), from `first` on.

    `net` has a row for each presynaptic unit; `pb` is (n, 1 or n_ticks, n_pb), constant with one row; the next input,
    u and y of each point are changed.
    """
    w_in, w_out, w_hidden, w_pb, b_out, b_hidden, starts, rate, references = net
    code = np.empty(codes.shape[1], F)
    drive, total = np.empty(rate.shape[0], F), np.empty(rate.shape[0], F)
    for point in range(angles.shape[0]):
        x, u, y = codes[point].copy(), states[point], activities[point]
        for t in range(first, angles.shape[1]):
            if t == first or pb.shape[1] > 1:
                drive[:] = b_hidden
                _add_outgoing(w_pb, pb[point, min(t, pb.shape[1] - 1)], 0, pb.shape[2], drive)
            _tick(w_in, w_out, w_hidden, b_out, starts, rate, references, drive, x, u, y, code, total, angles[point, t])
            x, code = code, x
        codes[point, :] = x
