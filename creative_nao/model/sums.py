"""Weighted sums of what senders say, in one fixed order: what makes generated movements equal to the last bit.

Both go through the senders in ascending order, one multiply-add after the other, four at a time.
"""

from __future__ import annotations

from creative_nao.model.kernels import compiled


@compiled()
def add_inputs(weights, first, last, senders, out):
    """Add the weighted rows of `senders` from `first` to `last` to `out`, (lanes,): one receiver in every lane."""
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
def add_outputs(weights, senders, first, last, out):
    """Add what `senders[first:last]` send to all receivers, `out`; `weights` has senders in rows."""
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
