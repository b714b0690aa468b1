"""One training epoch as compiled code with hand-derived gradients: the fast twin of `mtrnn.py` and `loss.py`.

Forward and backward pass of backpropagation through time over all actions at once, and the step of Adam.
`tests/model/test_fused.py` holds both against torch.

Names follow the equations: x is P_I, y the activations of P_F, P_M, P_S (Eq. 3), u their internal states (Eq. 2), o
the predicted code; da_* is the derivative of the loss with respect to the summed input of a neuron.
"""

from __future__ import annotations

import math

import numpy as np

from creative_nao.model.kernels import F, add_product, compiled, exp32, tanh32


@compiled()
def _softmax_groups(a, n_units, out):
    """Write the softmax of every group of `n_units` values of each row to `out`; return the groups' log sums apart.

    The loss needs log o = a - max - log sum; the last two are returned per group so that no logarithm per unit is
    taken.
    """
    n_rows, n_codes = a.shape
    n_groups = n_codes // n_units
    log_sums = np.empty((n_rows, n_groups), np.float32)
    for n in range(n_rows):
        for g in range(n_groups):
            first = g * n_units
            top = a[n, first]
            for j in range(1, n_units):
                top = max(top, a[n, first + j])
            log_sums[n, g] = top
            for j in range(n_units):
                out[n, first + j] = a[n, first + j] - top
        row = out[n]
        for i in range(n_codes):
            row[i] = exp32(row[i])
        for g in range(n_groups):
            first = g * n_units
            total = F(0)
            for j in range(n_units):
                total += row[first + j]
            inverse = F(1) / total
            for j in range(n_units):
                row[first + j] *= inverse
            log_sums[n, g] += F(math.log(total))
    return log_sums


@compiled()
def loss_and_gradient(
    w_in, w_out, w_hidden, w_pb, b_out, b_hidden, rho, mask, rate, codes, lengths, ratio, n_units,
    g_in, g_out, g_hidden, g_pb, g_bout, g_bhidden, g_rho,
):  # fmt: skip
    """Return the loss of Eq. 4 and write its gradient into the g_ arrays.

    Args:
        w_in, w_out, w_hidden, w_pb, b_out, b_hidden, rho: Parameters, shapes as in `parameters.parameter_shapes`,
            float32.
        mask: (n_hidden, n_hidden), zero where layers are not neighbours.
        rate: 1 / time constant of every hidden neuron, (n_hidden,).
        codes: Target codes, (n_actions, longest, n_codes), positive.
        lengths: Number of steps of each action, (n_actions,).
        ratio: Closed-loop ratio.
        n_units: Softmax units per joint.
        g_in, g_out, g_hidden, g_pb, g_bout, g_bhidden, g_rho: Where the gradient goes, shaped like the parameters.
    """
    n_actions, n_steps, n_codes = codes.shape
    n_hidden, n_fast = w_hidden.shape[0], w_in.shape[1]
    open_share = F(1) - ratio

    pb = np.tanh(rho)
    drive = np.zeros((n_actions, n_hidden), np.float32)
    for n in range(n_actions):
        drive[n] = b_hidden
    add_product(pb, w_pb, drive)

    # Forward. y[t] and x[t] are what tick t + 1 reads; o[0] is unused.
    x = np.empty((n_steps, n_actions, n_codes), np.float32)
    o = np.empty((n_steps, n_actions, n_codes), np.float32)
    y = np.zeros((n_steps, n_actions, n_hidden), np.float32)
    u = np.zeros((n_actions, n_hidden), np.float32)
    a_out = np.empty((n_actions, n_codes), np.float32)
    a_hidden = np.empty((n_actions, n_hidden), np.float32)
    a_fast = np.empty((n_actions, n_fast), np.float32)
    loss = 0.0
    for n in range(n_actions):
        x[0, n] = codes[n, 0]
    for t in range(1, n_steps):
        for n in range(n_actions):
            a_out[n] = b_out
            a_hidden[n] = drive[n]
        a_fast[:] = F(0)
        add_product(y[t - 1, :, :n_fast], w_out, a_out)
        add_product(y[t - 1], w_hidden, a_hidden)
        add_product(x[t - 1], w_in, a_fast)
        log_sums = _softmax_groups(a_out, n_units, o[t])
        for n in range(n_actions):
            if t < lengths[n]:
                for i in range(n_codes):  # the part of -sum target log o without the sums' logarithms
                    loss -= codes[n, t, i] * a_out[n, i]
                for g in range(log_sums.shape[1]):
                    weight = F(0)
                    for j in range(n_units):
                        weight += codes[n, t, g * n_units + j]
                    loss += weight * log_sums[n, g]
            for i in range(n_codes):
                x[t, n, i] = ratio * o[t, n, i] + open_share * codes[n, t, i]
            for i in range(n_fast):
                a_hidden[n, i] += a_fast[n, i]
            for i in range(n_hidden):
                u[n, i] = (F(1) - rate[i]) * u[n, i] + rate[i] * a_hidden[n, i]
            for i in range(n_hidden):
                y[t, n, i] = tanh32(u[n, i])

    # Backward. Transposed weights once, so that the same product with contiguous rows serves.
    w_in_t, w_out_t = np.ascontiguousarray(w_in.T), np.ascontiguousarray(w_out.T)
    w_hidden_t = np.ascontiguousarray(w_hidden.T)
    da_out = np.zeros((n_steps, n_actions, n_codes), np.float32)
    da_hidden = np.zeros((n_steps, n_actions, n_hidden), np.float32)
    da_fast = np.zeros((n_steps, n_actions, n_fast), np.float32)
    du = np.zeros((n_actions, n_hidden), np.float32)
    dy = np.zeros((n_actions, n_hidden), np.float32)
    dx = np.zeros((n_actions, n_codes), np.float32)
    dy_fast = np.zeros((n_actions, n_fast), np.float32)
    for t in range(n_steps - 1, 0, -1):
        for n in range(n_actions):
            for i in range(n_hidden):
                v = du[n, i] + dy[n, i] * (F(1) - y[t, n, i] * y[t, n, i])
                da_hidden[t, n, i] = v * rate[i]
                du[n, i] = v * (F(1) - rate[i])
            for i in range(n_fast):
                da_fast[t, n, i] = da_hidden[t, n, i]
            for g in range(n_codes // n_units):
                first = g * n_units
                inner = F(0)
                for j in range(n_units):
                    inner += dx[n, first + j] * o[t, n, first + j]
                for j in range(n_units):
                    i = first + j
                    da_out[t, n, i] = ratio * o[t, n, i] * (dx[n, i] - inner)
            if t < lengths[n]:
                for g in range(n_codes // n_units):
                    first = g * n_units
                    weight = F(0)
                    for j in range(n_units):
                        weight += codes[n, t, first + j]
                    for j in range(n_units):
                        i = first + j
                        da_out[t, n, i] += weight * o[t, n, i] - codes[n, t, i]
        dy[:] = F(0)
        dy_fast[:] = F(0)
        dx[:] = F(0)
        add_product(da_hidden[t], w_hidden_t, dy)
        add_product(da_out[t], w_out_t, dy_fast)
        add_product(da_fast[t], w_in_t, dx)
        for n in range(n_actions):
            for i in range(n_fast):
                dy[n, i] += dy_fast[n, i]

    # All weight gradients in one product each: rows are (tick, action) pairs.
    n_rows = (n_steps - 1) * n_actions
    y_before = y[:-1].reshape(n_rows, n_hidden)
    g_in[:] = F(0)
    g_out[:] = F(0)
    g_hidden[:] = F(0)
    rows_out, rows_hidden = da_out[1:].reshape(n_rows, n_codes), da_hidden[1:].reshape(n_rows, n_hidden)
    add_product(np.ascontiguousarray(x[:-1].reshape(n_rows, n_codes).T), da_fast[1:].reshape(n_rows, n_fast), g_in)
    y_before_t = np.ascontiguousarray(y_before.T)
    add_product(y_before_t[:n_fast], rows_out, g_out)
    add_product(y_before_t, rows_hidden, g_hidden)
    g_hidden *= mask
    g_bout[:] = F(0)
    g_drive = np.zeros((n_actions, n_hidden), np.float32)
    for r in range(n_rows):
        for i in range(n_codes):
            g_bout[i] += rows_out[r, i]
        for i in range(n_hidden):
            g_drive[r % n_actions, i] += rows_hidden[r, i]
    g_bhidden[:] = F(0)
    for n in range(n_actions):
        for i in range(n_hidden):
            g_bhidden[i] += g_drive[n, i]
    g_pb[:] = F(0)
    add_product(np.ascontiguousarray(pb.T), g_drive, g_pb)
    g_rho[:] = F(0)
    add_product(g_drive, np.ascontiguousarray(w_pb.T), g_rho)
    for n in range(n_actions):
        for j in range(rho.shape[1]):
            g_rho[n, j] *= F(1) - pb[n, j] * pb[n, j]
    return loss


@compiled()
def adam_step(vector, gradient, first, second, epoch, learning_rate):
    """Move `vector` one step of Adam (betas 0.9 and 0.999, epsilon 1e-8); `epoch` counts from 1."""
    correction1 = 1.0 - 0.9**epoch
    correction2 = math.sqrt(1.0 - 0.999**epoch)
    step = F(learning_rate / correction1)
    inverse = F(1.0 / correction2)
    for i in range(vector.size):
        first[i] = F(0.9) * first[i] + F(0.1) * gradient[i]
        second[i] = F(0.999) * second[i] + F(0.001) * gradient[i] * gradient[i]
        vector[i] -= step * first[i] / (np.sqrt(second[i]) * inverse + F(1e-8))
