"""Training epochs as compiled code with hand-derived gradients: what `network.py` says in torch, many times faster.

Forward and backward pass of backpropagation through time over all actions at once, and the step of Adam;
`tests/model/test_compiled_training.py` compares both with torch. `CompiledNetwork` is what training calls;
`matmul.Layout` says where each number lies.

Names follow the equations: a is the summed input of a unit, x = P_I and y the activations of P_F, P_M, P_S (Eq. 3) lie
side by side in z, u are internal states (Eq. 2), o the predicted code; d_ is a derivative of the loss. Row
t n_actions + n is action n at tick t: z is what the next tick reads, da belongs to the sums that made the tick.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from creative_nao.model.config import NetworkSettings, TrainingState
from creative_nao.model.matmul import PANEL, Packing, aligned, multiply_panel, multiply_panels
from creative_nao.model.simd import (
    F,
    at_least,
    compiled,
    exp32,
    load8,
    load16,
    log32,
    spread8,
    spread16,
    square_root,
    store,
    sum_of_lanes,
    tanh32,
    transpose8,
)

# pyright: reportOperatorIssue=false, reportCallIssue=false, reportArgumentType=false

ROWS_AT_ONCE = 96  # of z and da in the weight gradient: what they touch stays in the nearest cache


class Workspace(NamedTuple):
    """Arrays of an engine, all flat float32; rows are `layout.row` apart unless said."""

    target: np.ndarray  # target codes, rows of `n_codes`, zero past an action's end: they add nothing to the loss
    weight: np.ndarray  # sum of the target code of each joint, rows of `n_joints`: 1, or 0 past the end
    entropy: np.ndarray  # sum of target log target of each joint, rows of `n_joints`
    rate: np.ndarray  # 1 / time constant of each column
    real: np.ndarray  # 1 where the packed vector holds a parameter, else 0
    z: np.ndarray
    da: np.ndarray
    o: np.ndarray  # predicted codes, rows of `n_codes`
    a: np.ndarray  # summed inputs of one tick, in the backward pass the derivative of the loss with respect to z
    u: np.ndarray  # internal states, in the backward pass their derivatives
    start: np.ndarray  # what a sum begins with: bias and drive of the PB units; a row for each action
    d_start: np.ndarray
    pb: np.ndarray
    zeros: np.ndarray  # one row
    w_back: np.ndarray  # the panels of the transposed weight matrix
    gradient: np.ndarray  # packed like the parameters


@compiled(inline="always")
def _clear(array):
    """Write zeros; assigning to a slice would take longer to compile."""
    for i in range(0, array.size, 16):
        store(spread16(F(0)), array, i)


@compiled()
def _prepare(lay, work, vector):
    """Compute PB activations (Eq. 1), what each sum begins with, and the transposed weights."""
    for n in range(lay.n_actions):
        for j in range(lay.n_pb):
            work.pb[n * lay.n_pb + j] = tanh32(vector[lay.rho + n * lay.n_pb + j])
        for c in range(0, lay.width, 16):
            total = load16(vector, lay.bias + c)
            for j in range(lay.n_pb):
                total = total + load16(vector, lay.w_pb + j * lay.width + c) * work.pb[n * lay.n_pb + j]
            store(total, work.start, n * lay.row + c)
    for panel in range(lay.low.size):
        for pre in range(lay.low[panel], lay.high[panel], 8):  # first of eight presynaptic units, and so `post`
            other, source = pre // PANEL, lay.place[panel] + (pre - lay.low[panel]) * PANEL
            target = lay.place[other] + pre % PANEL - lay.low[other] * PANEL
            begin, end = max(panel * PANEL, lay.low[other]), min((panel + 1) * PANEL, lay.high[other])
            for post in range(begin, end, 8):
                transpose8(vector, source + post % PANEL, PANEL, work.w_back, target + post * PANEL, PANEL)


@compiled()
def _predict(lay, work, t, ratio):
    """Turn the sums of tick t into the predicted codes (Eq. 3), their loss (Eq. 4) and the next input (Eq. 5)."""
    step, n_codes, open_share = lay.n_joints, lay.n_codes, F(1) - ratio
    loss = spread8(F(0))
    for n in range(lay.n_actions):
        row = t * lay.n_actions + n
        for first in range(0, step, 8):  # eight joints; the softmax units of one are `step` columns apart
            a, z, code = n * lay.row + first, row * lay.row + first, row * n_codes + first
            top = load8(work.a, a)
            expected = load8(work.target, code) * top
            for c in range(step, n_codes, step):
                value = load8(work.a, a + c)
                top = at_least(top, value)
                expected = expected + load8(work.target, code + c) * value
            total = spread8(F(0))
            for c in range(0, n_codes, step):
                power = exp32(load8(work.a, a + c) - top)
                store(power, work.a, a + c)
                total = total + power
            weight = load8(work.weight, row * step + first)
            loss = loss + (load8(work.entropy, row * step + first) + weight * (top + log32(total)) - expected)
            inverse = spread8(F(1)) / total
            for c in range(0, n_codes, step):
                o, target = load8(work.a, a + c) * inverse, load8(work.target, code + c)
                store(o, work.o, code + c)
                store(o * ratio + target * open_share, work.z, z + c)
                store(o * weight - target, work.da, z + c)
    return sum_of_lanes(loss)


@compiled()
def _forward(lay, work, vector, ratio):
    """Run the network over all ticks and return the loss; leaves the loss's own part of `da` of the outputs."""
    n_steps = work.target.size // (lay.n_actions * lay.n_codes)
    for n in range(lay.n_actions):
        for c in range(0, lay.n_codes, 8):
            store(load8(work.target, n * lay.n_codes + c), work.z, n * lay.row + c)
    _clear(work.u)
    loss = 0.0
    for t in range(1, n_steps):
        before = (t - 1) * lay.n_actions * lay.row
        multiply_panels(lay, 0, work.z, before, vector, work.start, lay.row, work.a)
        loss += _predict(lay, work, t, ratio)
        for n in range(lay.n_actions):
            for c in range(lay.first_hidden, lay.width, 16):
                rate, at = load16(work.rate, c), n * lay.row + c
                u = (F(1) - rate) * load16(work.u, at) + rate * load16(work.a, at)  # Eq. 2
                store(u, work.u, at)
                store(tanh32(u), work.z, (t * lay.n_actions + n) * lay.row + c)
    return loss


@compiled()
def _backward_codes(lay, work, t, ratio):
    """Add to `da` of tick t the derivative by the prediction that is the next input, through the softmax."""
    step = lay.n_joints
    for n in range(lay.n_actions):
        row = t * lay.n_actions + n
        for first in range(0, step, 8):
            dx, z, code = n * lay.row + first, row * lay.row + first, row * lay.n_codes + first
            inner = spread8(F(0))
            for c in range(0, lay.n_codes, step):
                inner = inner + load8(work.a, dx + c) * load8(work.o, code + c)
            for c in range(0, lay.n_codes, step):
                through = load8(work.o, code + c) * (load8(work.a, dx + c) - inner) * ratio
                store(load8(work.da, z + c) + through, work.da, z + c)


@compiled()
def _backward(lay, work, ratio):
    """Run back through the ticks: fills `da`, and in `d_start` its sum over the ticks."""
    n_steps = work.target.size // (lay.n_actions * lay.n_codes)
    _clear(work.a)
    _clear(work.u)
    _clear(work.d_start)
    feeds_back = ratio != F(0)
    first_panel = 0 if feeds_back else lay.first_hidden // PANEL  # an open loop needs no derivative of its input
    for t in range(n_steps - 1, 0, -1):
        if feeds_back:
            _backward_codes(lay, work, t, ratio)
        for n in range(lay.n_actions):
            row = t * lay.n_actions + n
            for c in range(lay.first_hidden, lay.width, 16):
                rate, at = load16(work.rate, c), n * lay.row + c
                y = load16(work.z, row * lay.row + c)
                du = load16(work.u, at) + load16(work.a, at) * (F(1) - y * y)
                da = du * rate
                store(da, work.da, row * lay.row + c)
                store(du - da, work.u, at)
            for c in range(0, lay.width, 16):
                at = n * lay.row + c
                store(load16(work.d_start, at) + load16(work.da, row * lay.row + c), work.d_start, at)
        if t > 1:
            da_at = t * lay.n_actions * lay.row
            multiply_panels(lay, first_panel, work.da, da_at, work.w_back, work.zeros, 0, work.a)


@compiled()
def _weight_gradient(lay, work):
    """Compute the weight gradient: activations times derivatives of summed inputs, over all ticks and actions."""
    n_rows = work.target.size // lay.n_codes - lay.n_actions
    for first in range(0, n_rows, ROWS_AT_ONCE):
        count = min(ROWS_AT_ONCE, n_rows - first)
        for p in range(lay.low.size):
            start, start_row = (work.zeros, 0) if first == 0 else (work.gradient, PANEL)
            multiply_panel(
                work.z, first * lay.row + lay.low[p], 1, lay.row,
                work.da, (first + lay.n_actions) * lay.row + p * PANEL, lay.row, count,
                start, 0 if first == 0 else lay.place[p], start_row,
                work.gradient, lay.place[p], PANEL, lay.high[p] - lay.low[p],
            )  # fmt: skip


@compiled()
def _bias_gradient(lay, work, vector):
    """Compute the gradient of biases, PB weights and rho from `d_start`."""
    for c in range(0, lay.width, 16):
        total = load16(work.d_start, c)
        for n in range(1, lay.n_actions):
            total = total + load16(work.d_start, n * lay.row + c)
        store(total, work.gradient, lay.bias + c)
        for j in range(lay.n_pb):
            total = load16(work.d_start, c) * work.pb[j]
            for n in range(1, lay.n_actions):
                total = total + load16(work.d_start, n * lay.row + c) * work.pb[n * lay.n_pb + j]
            store(total, work.gradient, lay.w_pb + j * lay.width + c)
    for n in range(lay.n_actions):
        for j in range(lay.n_pb):
            total = spread16(F(0))
            for c in range(0, lay.width, 16):
                total = total + load16(work.d_start, n * lay.row + c) * load16(vector, lay.w_pb + j * lay.width + c)
            pb = work.pb[n * lay.n_pb + j]
            work.gradient[lay.rho + n * lay.n_pb + j] = sum_of_lanes(total) * (F(1) - pb * pb)


@compiled()
def loss_and_gradient(lay, work, vector, ratio):
    """Return the loss of Eq. 4 for packed parameters and leave its gradient in `work.gradient`.

    Elements of the gradient that stand for no parameter have no meaning.
    """
    _prepare(lay, work, vector)
    loss = _forward(lay, work, vector, ratio)
    _backward(lay, work, ratio)
    _weight_gradient(lay, work)
    _bias_gradient(lay, work, vector)
    return loss


@compiled()
def adam_step(vector, gradient, real, first, second, epoch, learning_rate):
    """Move `vector` one step of Adam (betas 0.9 and 0.999, epsilon 1e-8); `epoch` counts from 1.

    All arrays have the same length, a multiple of 16; the gradient counts where `real` is 1, not where it is 0.
    """
    step = F(learning_rate / (1.0 - 0.9**epoch))
    inverse = F(1.0 / math.sqrt(1.0 - 0.999**epoch))
    for i in range(0, vector.size, 16):
        g = load16(gradient, i) * load16(real, i)
        m = load16(first, i) * F(0.9) + g * F(0.1)
        v = load16(second, i) * F(0.999) + g * g * F(0.001)
        store(m, first, i)
        store(v, second, i)
        store(load16(vector, i) - m * step / (square_root(v) * inverse + F(1e-8)), vector, i)


@compiled()
def run_epochs(lay, work, vector, first, second, best, ratios, allowed, losses, epoch, best_loss, learning_rate):
    """Train as `CompiledNetwork.run_epochs` says, on packed vectors that are changed in place.

    An epoch's loss is that of the parameters before its step. Where it is not finite, the epoch changes nothing.
    """
    best_epoch = 0
    for i in range(ratios.size):
        loss = loss_and_gradient(lay, work, vector, ratios[i])
        if not math.isfinite(loss):
            return i, best_epoch
        losses[i] = loss
        if allowed[i] and loss < best_loss:
            best_loss, best_epoch = loss, i + 1
            for k in range(0, vector.size, 16):
                store(load16(vector, k), best, k)
        adam_step(vector, work.gradient, work.real, first, second, epoch + i + 1, learning_rate)
    return ratios.size, best_epoch


class CompiledNetwork:
    """A network's sizes and the actions it learns, prepared for compiled epochs.

    One instance serves one thread at a time: it owns the memory that the epochs work in.

    Args:
        settings: Sizes and time constants.
        codes: Target codes, (n_actions, longest, n_codes) positive, from `encoding.target_codes`.
        lengths: Steps of each action, (n_actions,).
    """

    def __init__(self, settings: NetworkSettings, codes: np.ndarray, lengths: np.ndarray) -> None:
        n_actions, n_steps, n_codes = codes.shape
        self._packing = Packing(settings, n_codes, n_actions)
        self.layout = lay = self._packing.layout
        target = aligned(n_steps, n_actions, lay.n_codes)
        counts = np.arange(n_steps)[:, None] < lengths[None, :]
        target[:, :, self._packing.code_columns] = codes.transpose(1, 0, 2) * counts[:, :, None]
        units = target.reshape(n_steps, n_actions, settings.n_softmax_units, lay.n_joints).astype(np.float64)
        entropy = (units * np.log(np.where(units > 0, units, 1))).sum(axis=2)
        rows, few = n_steps * n_actions * lay.row, n_actions * lay.row
        self._work = Workspace(
            target=target.ravel(),
            weight=_copied(units.sum(axis=2)),
            entropy=_copied(entropy),
            rate=_copied(self._packing.rate),
            real=self._packing.real,
            o=aligned(n_steps * n_actions * lay.n_codes),
            pb=aligned(n_actions * lay.n_pb),
            zeros=aligned(lay.width),
            w_back=aligned(lay.bias),
            gradient=aligned(lay.size),
            **{name: aligned(rows) for name in ("z", "da")},
            **{name: aligned(few) for name in ("a", "u", "start", "d_start")},
        )

    def loss_and_gradient(self, vector: np.ndarray, ratio: float) -> tuple[float, np.ndarray]:
        """Return the loss of Eq. 4 at a closed-loop ratio, and its gradient.

        Parameters and gradient are flat as in `config.parameter_shapes`, float32; the gradient is zero where layers
        are not neighbours.
        """
        loss = loss_and_gradient(self.layout, self._work, self._packing.pack(vector), np.float32(ratio))
        return loss, self._packing.unpack(self._work.gradient, np.zeros_like(vector))

    def run_epochs(
        self, state: TrainingState, ratios: np.ndarray, allowed: np.ndarray, learning_rate: float
    ) -> tuple[list[np.ndarray], np.ndarray, int]:
        """Train for one epoch per ratio, or until the loss is not finite.

        Args:
            state: Where training stands; it is not changed.
            ratios: Closed-loop ratio of each epoch.
            allowed: Whether each epoch may be the best, bool.
            learning_rate: Step size of Adam.

        Returns:
            The four vectors of a state afterwards, the losses of the epochs done, and which of these is the best,
            counted from 1 (0: none is better than before).
        """
        packed = [self._packing.pack(vector) for vector in state.vectors]
        losses = np.empty(len(ratios))
        n_done, best_epoch = run_epochs(
            self.layout, self._work, *packed, np.ascontiguousarray(ratios, np.float32), allowed, losses,
            state.epoch, float(state.best_loss), float(learning_rate),
        )  # fmt: skip
        new = [self._packing.unpack(p, vector) for p, vector in zip(packed, state.vectors, strict=True)]
        return new, losses[:n_done], best_epoch


def _copied(values: np.ndarray) -> np.ndarray:
    copy = aligned(values.size)
    copy[:] = values.ravel()
    return copy
