"""Compiled twin of what `outcome.py` measures of an action: the hot path of the environments, with the same bits."""

from __future__ import annotations

import numpy as np

from creative_nao.measures._dtw_kernels import compiled


@compiled()
def measure_rows(which, generated, performed, dt_s, speed_limit, too_fast, excursion):
    """Fill `too_fast` and `excursion`, both (m,), of m actions; return the first that is not finite, or -1.

    which: (m,) the row of `dt_s` [s] and `speed_limit` (n, n_joints) [rad/s] that holds for each action; generated,
    performed: (m, n_steps, n_joints) [rad]. The speed is that of the command, the excursion that of what was performed.
    """
    m, n_ticks, n_joints = generated.shape
    for k in range(m):
        row = which[k]
        too_fast[k] = False
        excursion[k] = 0.0
        for j in range(n_joints):
            change, low, high = 0.0, performed[k, 0, j], performed[k, 0, j]
            for t in range(n_ticks):
                here = performed[k, t, j]
                if not (np.isfinite(generated[k, t, j]) and np.isfinite(here)):
                    return k
                low, high = min(low, here), max(high, here)
                if t > 0:
                    change = max(change, abs(generated[k, t, j] - generated[k, t - 1, j]))
            if change / dt_s[row] > speed_limit[row, j]:
                too_fast[k] = True
            excursion[k] = max(excursion[k], high - low)
    return -1
