"""Closed-loop generation that can be stopped between ticks and go on with another PB value (Eq. 1-3, 5 at ratio 1, 7).

The network's state is carried from call to call. With the PB held constant the bits are those of `Memory.generate`, and
with a PB that jumps those of a PB given for every tick at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from creative_nao.errors import ShapeError
from creative_nao.model.compiled_generation import unfold_tick
from creative_nao.model.generation import ClosedLoopGenerator
from creative_nao.model.memory import Memory
from creative_nao.model.simd import add_outputs, compiled


@dataclass(eq=False)
class Unfolding:
    """Where n movements stand.

    Attributes:
        tick: Postures given out so far.
        code: What the network reads next: the code of its last prediction, (n, n_codes) float32.
        state: Internal states u of all hidden neurons, (n, n_hidden) float32.
        activity: Their activations y = tanh(u), the layers P_F, P_M, P_S one after the other, (n, n_hidden) float32.
    """

    tick: int
    code: np.ndarray
    state: np.ndarray
    activity: np.ndarray

    def __len__(self) -> int:
        return len(self.code)


class Stepper:
    """Lets movements of one memory unfold a few ticks at a time.

    Args:
        memory: The memory.

    Attributes:
        n_slow: Neurons of the slowest layer, P_S: the last of `Unfolding.activity`.
    """

    def __init__(self, memory: Memory) -> None:
        generator = ClosedLoopGenerator(
            memory.network, memory.parameters, memory.encoding, memory.demonstrations.initial_posture
        )
        self._weights = (*generator.from_sender, *generator.biases, generator.starts, generator.rate)
        self._references = generator.references
        self._posture, self._code = generator.initial_posture, generator.initial_code
        self._n_pb, self._n_hidden = memory.network.n_pb, memory.network.n_hidden
        self.n_slow = memory.network.layer_sizes[-1]

    def begin(self, n: int) -> Unfolding:
        """Return n movements of which nothing has unfolded yet."""
        return Unfolding(
            0,
            np.repeat(self._code[None], n, axis=0),
            np.zeros((n, self._n_hidden), np.float32),
            np.zeros((n, self._n_hidden), np.float32),
        )

    def advance(self, unfolding: Unfolding, pb: np.ndarray, n_ticks: int) -> np.ndarray:
        """Let movements unfold; `unfolding` then stands `n_ticks` later.

        Args:
            unfolding: Where they stand.
            pb: PB value of each in [-1, 1] during these ticks, (n, n_pb).
            n_ticks: Postures to give out, at least 1; the very first is the initial posture itself.

        Returns:
            Joint angles [rad], (n, n_ticks, n_joints), float64.

        Raises:
            ShapeError: If `pb` is not (n, n_pb) or leaves [-1, 1].
        """
        points = np.asarray(pb, np.float64)
        if points.shape != (len(unfolding), self._n_pb) or not (np.abs(points) <= 1).all():
            raise ShapeError(
                f"`pb` should have shape ({len(unfolding)}, {self._n_pb}) and lie in [-1, 1], but is {points!r:.80}"
            )
        angles = np.zeros((len(unfolding), n_ticks, len(self._references)), np.float32)
        first = 1 if unfolding.tick == 0 else 0
        _advance(
            *self._weights, points.astype(np.float32), self._references, first,
            unfolding.code, unfolding.state, unfolding.activity, angles,
        )  # fmt: skip
        out = angles.astype(np.float64)
        if first:
            out[:, 0] = self._posture
        unfolding.tick += n_ticks
        return out


@compiled()
def _advance(w_in, w_out, w_hidden, w_pb, b_out, b_hidden, starts, rate, pb, references, first, xs, us, ys, angles):
    """Run every movement from posture `first` of `angles` on: the ticks of `lanes.generate_one`, the state kept."""
    n_points, n_ticks, _ = angles.shape
    code = np.empty(xs.shape[1], np.float32)
    drive = np.empty(rate.shape[0], np.float32)
    total = np.empty(rate.shape[0], np.float32)
    for point in range(n_points):
        x, u, y = xs[point], us[point], ys[point]
        drive[:] = b_hidden
        add_outputs(w_pb, pb[point], 0, pb.shape[1], drive)
        for t in range(first, n_ticks):
            code[:] = b_out
            unfold_tick(w_in, w_out, w_hidden, starts, rate, references, drive, x, u, y, code, total, angles[point, t])
            x[:] = code
