"""Closed-loop generation: PB points in, joint trajectories out, many at a time (Eq. 1-3, 5 at ratio 1, 7).

Points lie side by side in lanes, (unit, lane), so that one instruction serves many of them. The sum over a neuron's
inputs is taken in one fixed order in every lane: a trajectory has the same bits alone, in a batch, and for any number
of threads. That matters, because where the map is rugged the closed loop amplifies a difference in the last bit into
another movement.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from creative_nao.model.config import NetworkSettings, layer_time_constants
from creative_nao.model.encoding import SoftmaxEncoding
from creative_nao.runtime import usable_cores

LANES = 64
"""Most points side by side: a multiple of `product.PANEL`, and all activations still lie in a fast cache."""
FEW_POINTS = 2
"""Up to this many points, one at a time is faster than in lanes."""
SERIAL_BLOCKS = 8
"""Up to this many blocks of lanes, starting threads costs more than it saves."""


class ClosedLoopGenerator:
    """A trained network prepared for generation.

    Args:
        settings: Sizes and time constants.
        parameters: By name, shapes as in `parameters.parameter_shapes`, float32; copied.
        encoding: The joints' softmax code.
        initial_posture: Joint angles at tick 0 [rad], shape (n_joints,).

    Attributes:
        from_sender: Weights w_in, w_out, w_hidden and w_pb with senders in rows, float32.
        to_receiver: The same with receivers in rows.
        biases: b_out and b_hidden, float32.
        starts: First neuron of each hidden layer, and their number, (n_layers + 1,).
        rate: 1 / time constant of each hidden neuron, float32.
        references: Reference angles of the code [rad], (n_joints, n_units) float32.
        initial_posture: As given, float64.
        initial_code: Its code, (n_codes,) float32.
    """

    def __init__(
        self,
        settings: NetworkSettings,
        parameters: dict[str, np.ndarray],
        encoding: SoftmaxEncoding,
        initial_posture: np.ndarray,
    ) -> None:
        self.starts = np.concatenate([[0], np.cumsum(settings.layer_sizes)])
        self.rate = np.float32(1) / layer_time_constants(settings)
        self.from_sender = [parameters[name].copy() for name in ("w_in", "w_out", "w_hidden", "w_pb")]
        self.to_receiver = [np.ascontiguousarray(weights.T) for weights in self.from_sender]
        self.biases = parameters["b_out"].copy(), parameters["b_hidden"].copy()
        self.references = encoding.references.astype(np.float32)
        self.initial_posture = np.array(initial_posture, dtype=np.float64)
        self.initial_code = encoding.encode(self.initial_posture).astype(np.float32)

    def __call__(self, pb: np.ndarray, n_steps: int) -> np.ndarray:
        """Let the network act in its mind from each PB point.

        Args:
            pb: PB values in [-1, 1], shape (n, n_pb), or (n, n_steps, n_pb) for a PB that moves: row t drives tick t.
            n_steps: Ticks to generate, at least 1; row 0 is the initial posture itself.

        Returns:
            Joint angles [rad], shape (n, n_steps, n_joints), float64.
        """
        moving = pb if pb.ndim == 3 else pb[:, None, :]
        out = np.empty((len(pb), n_steps, len(self.references)))
        if len(pb) <= FEW_POINTS:
            for point, trajectory in zip(moving, out, strict=True):
                trajectory[:] = self._generate_one(point, n_steps)
            return out
        blocks = [slice(start, min(start + LANES, len(pb))) for start in range(0, len(pb), LANES)]
        n_threads = usable_cores()
        if len(blocks) <= SERIAL_BLOCKS or n_threads == 1:
            for block in blocks:
                out[block] = self._generate_block(moving[block], n_steps)
        else:
            with ThreadPoolExecutor(n_threads) as pool:
                for block, angles in zip(
                    blocks, pool.map(lambda b: self._generate_block(moving[b], n_steps), blocks), strict=True
                ):
                    out[block] = angles
        return out

    def _generate_one(self, pb: np.ndarray, n_steps: int) -> np.ndarray:
        from creative_nao.model.compiled_generation import generate_one

        angles = np.zeros((n_steps, len(self.references)), np.float32)
        generate_one(
            *self.from_sender, *self.biases, self.starts, self.rate,
            pb.astype(np.float32), self.initial_code, self.references, angles,
        )  # fmt: skip
        trajectory = angles.astype(np.float64)
        trajectory[0] = self.initial_posture
        return trajectory

    def _generate_block(self, pb: np.ndarray, n_steps: int) -> np.ndarray:
        from creative_nao.model.compiled_generation import PANEL, generate_lanes

        lanes = -(-len(pb) // PANEL) * PANEL
        points = np.zeros((pb.shape[1], pb.shape[2], lanes), np.float32)
        points[:, :, : len(pb)] = pb.transpose(1, 2, 0)
        angles = np.zeros((n_steps, len(self.references), lanes), np.float32)
        generate_lanes(
            *self.to_receiver, *self.biases, self.starts, self.rate,
            points, self.initial_code, self.references, angles,
        )  # fmt: skip
        trajectories = angles[:, :, : len(pb)].transpose(2, 0, 1).astype(np.float64)
        trajectories[:, 0] = self.initial_posture
        return trajectories
