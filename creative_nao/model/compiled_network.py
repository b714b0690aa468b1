"""The compiled engine with its working memory: what `engine` and `autograd` call."""

from __future__ import annotations

import numpy as np

from creative_nao.model import fused
from creative_nao.model.config import NetworkSettings
from creative_nao.model.layout import Packing, aligned


class CompiledNetwork:
    """A network's sizes and the actions it is taught, prepared for compiled epochs.

    One instance serves one thread at a time: it owns the memory that the epochs work in.

    Args:
        settings: Sizes and time constants.
        codes: Target codes, (n_actions, longest, n_codes) positive, from `targets.target_codes`.
        lengths: Steps of each action, (n_actions,).
    """

    def __init__(self, settings: NetworkSettings, codes: np.ndarray, lengths: np.ndarray) -> None:
        self._packing = Packing(settings, codes.shape[2], codes.shape[0])
        self.layout = self._packing.layout
        self._work = self._workspace(settings, codes, lengths)

    def _workspace(self, settings: NetworkSettings, codes: np.ndarray, lengths: np.ndarray) -> fused.Workspace:
        lay = self.layout
        n_actions, n_steps, _ = codes.shape
        taught = aligned(n_steps, n_actions, lay.n_codes)
        counts = np.arange(n_steps)[:, None] < lengths[None, :]
        taught[:, :, self._packing.code_columns] = codes.transpose(1, 0, 2) * counts[:, :, None]
        units = taught.reshape(n_steps, n_actions, settings.n_softmax_units, lay.n_joints).astype(np.float64)
        entropy = (units * np.log(np.where(units > 0, units, 1))).sum(axis=2)
        rows, lines, few = n_steps * n_actions * lay.row, lay.width, n_actions * lay.row
        return fused.Workspace(
            taught=taught.ravel(),
            weight=_copied(units.sum(axis=2)),
            entropy=_copied(entropy),
            rate=_copied(self._packing.rate),
            real=self._packing.real(),
            z=aligned(rows),
            da=aligned(rows),
            o=aligned(n_steps * n_actions * lay.n_codes),
            a=aligned(few),
            u=aligned(few),
            start=aligned(few),
            d_start=aligned(few),
            pb=aligned(n_actions * lay.n_pb),
            zeros=aligned(lines),
            w_back=aligned(lay.bias),
            gradient=aligned(lay.size),
        )

    def loss_and_gradient(self, vector: np.ndarray, ratio: float) -> tuple[float, np.ndarray]:
        """Return the loss of Eq. 4 and its gradient.

        Args:
            vector: Parameters, flat as in `parameters`, float32.
            ratio: Closed-loop ratio.

        Returns:
            The loss, and the gradient in the order of `vector`, zero where layers are not neighbours.
        """
        loss = fused.loss_and_gradient(self.layout, self._work, self._packing.pack(vector), np.float32(ratio))
        return loss, self._packing.unpack(self._work.gradient, np.zeros_like(vector))

    def run_epochs(
        self,
        vectors: list[np.ndarray],
        ratios: np.ndarray,
        allowed: np.ndarray,
        epoch: int,
        best_loss: float,
        learning_rate: float,
    ) -> tuple[list[np.ndarray], np.ndarray, int]:
        """Train for one epoch per ratio, or until the loss is not finite.

        Args:
            vectors: Parameters, first and second moment of Adam, best parameters so far; flat float32.
            ratios: Closed-loop ratio of each epoch.
            allowed: Whether each epoch may be the best, bool.
            epoch: Epochs done before.
            best_loss: Lowest loss before.
            learning_rate: Step size of Adam.

        Returns:
            The four vectors afterwards, the losses of the epochs done, and which of these is the best, counted from 1
            (0: none is better than before).
        """
        packed = [self._packing.pack(vector) for vector in vectors]
        losses = np.empty(len(ratios))
        n_done, best_epoch, _ = fused.run_epochs(
            self.layout, self._work, *packed, np.ascontiguousarray(ratios, np.float32), allowed, losses,
            epoch, float(best_loss), float(learning_rate),
        )  # fmt: skip
        new = [self._packing.unpack(p, vector) for p, vector in zip(packed, vectors, strict=True)]
        return new, losses[:n_done], best_epoch


def _copied(values: np.ndarray) -> np.ndarray:
    copy = aligned(values.size)
    copy[:] = values.ravel()
    return copy
