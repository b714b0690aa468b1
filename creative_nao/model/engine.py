"""The two interchangeable ways to run training epochs: compiled (`fused`) and readable (`reference`).

Both advance the same `TrainingState` and obey the same rule: the loss of an epoch is that of the weights before its
step, and the weights of the epoch with the lowest loss are kept.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from creative_nao.errors import TrainingError
from creative_nao.model.config import NetworkSettings, TrainingSettings
from creative_nao.model.parameters import initial_vector, views
from creative_nao.model.schedule import candidates


@dataclasses.dataclass
class TrainingState:
    """Everything that decides how training goes on: saved in a checkpoint, a resumed run gives the same bits."""

    vector: np.ndarray
    """Parameters, (n_parameters,) float32."""
    first_moment: np.ndarray
    """Adam's running mean of the gradient."""
    second_moment: np.ndarray
    """Adam's running mean of the squared gradient."""
    best_vector: np.ndarray
    """Parameters of the epoch with the lowest loss so far."""
    loss_history: np.ndarray
    """Loss of each epoch done (Eq. 4, summed over actions), (epoch,) float64."""
    best_loss: float = math.inf
    best_epoch: int = 0

    @property
    def epoch(self) -> int:
        """Number of epochs done."""
        return len(self.loss_history)

    @classmethod
    def initial(cls, settings: NetworkSettings, n_codes: int, n_actions: int, seed: int) -> TrainingState:
        """Return the state before the first epoch."""
        vector = initial_vector(settings, n_codes, n_actions, seed)
        return cls(vector, np.zeros_like(vector), np.zeros_like(vector), vector.copy(), np.zeros(0))


Advance = Callable[[TrainingState, np.ndarray], None]


def make_engine(
    network: NetworkSettings, training: TrainingSettings, codes: np.ndarray, lengths: np.ndarray
) -> Advance:
    """Return a function that advances a state in place: `advance(state, ratios)`, one closed-loop ratio per epoch.

    Args:
        network: Sizes and time constants.
        training: Learning rate, schedule of the ratio, and the name of the engine.
        codes: Target codes, (n_actions, longest, n_codes) float32, from `targets.target_codes`.
        lengths: Steps of each action.

    Raises:
        TrainingError: (the returned function) If the loss is not finite; the state stays at the last good epoch.
    """
    build = {"fused": _fused_engine, "reference": _reference_engine}[training.engine]
    run_epochs = build(network, training, codes, lengths)

    def advance(state: TrainingState, ratios: np.ndarray) -> None:
        done = state.epoch
        losses, best_epoch = run_epochs(state, ratios, candidates(training, ratios))
        if best_epoch:
            state.best_epoch, state.best_loss = done + best_epoch, float(losses[best_epoch - 1])
        state.loss_history = np.concatenate([state.loss_history, losses])
        if len(losses) < len(ratios):
            raise TrainingError(
                f"the loss is no longer finite at epoch {state.epoch + 1} "
                f"(learning rate {training.learning_rate}); "
                f"the best epoch so far is {state.best_epoch} with loss {state.best_loss:.4g}"
            )

    return advance


# An engine runs one epoch per ratio, or stops where the loss is not finite; the third argument says which epochs may be
# the best. It changes the vectors of the state and returns the losses of the epochs done and which of these is the best
# so far, counted from 1 (0: none).
RunEpochs = Callable[[TrainingState, np.ndarray, np.ndarray], tuple[np.ndarray, int]]


def _fused_engine(
    network: NetworkSettings, training: TrainingSettings, codes: np.ndarray, lengths: np.ndarray
) -> RunEpochs:
    from creative_nao.model.compiled_network import CompiledNetwork

    compiled = CompiledNetwork(network, codes, lengths)

    def run_epochs(state: TrainingState, ratios: np.ndarray, allowed: np.ndarray) -> tuple[np.ndarray, int]:
        vectors = [state.vector, state.first_moment, state.second_moment, state.best_vector]
        vectors, losses, best_epoch = compiled.run_epochs(
            vectors, ratios, allowed, state.epoch, state.best_loss, training.learning_rate
        )
        state.vector, state.first_moment, state.second_moment, state.best_vector = vectors
        return losses, best_epoch

    return run_epochs


def _reference_engine(
    network: NetworkSettings, training: TrainingSettings, codes: np.ndarray, lengths: np.ndarray
) -> RunEpochs:
    import torch

    from creative_nao.model.loss import kl_divergence
    from creative_nao.model.mtrnn import PBMTRNN

    net = PBMTRNN(network, codes.shape[2], len(codes))
    target, steps = torch.from_numpy(codes), torch.from_numpy(lengths)
    adam = torch.optim.Adam(net.parameters(), lr=training.learning_rate, betas=(0.9, 0.999), eps=1e-8)

    def put(state: TrainingState, epoch: int) -> None:
        # The state is the only memory between calls, so that a checkpoint is complete whatever the engine.
        net.load_parameter_vector(state.vector)
        moments = zip(
            views(state.first_moment, net.shapes).items(), views(state.second_moment, net.shapes).values(), strict=True
        )
        for (name, first), second in moments:
            adam.state[getattr(net, name)] = {
                "step": torch.tensor(float(epoch - 1)),
                "exp_avg": torch.from_numpy(first.copy()),
                "exp_avg_sq": torch.from_numpy(second.copy()),
            }

    def take(state: TrainingState) -> None:
        state.vector = net.parameter_vector()
        states = [adam.state[getattr(net, name)] for name in net.shapes]
        state.first_moment = np.concatenate([s["exp_avg"].numpy().ravel() for s in states])
        state.second_moment = np.concatenate([s["exp_avg_sq"].numpy().ravel() for s in states])

    def run_epochs(state: TrainingState, ratios: np.ndarray, allowed: np.ndarray) -> tuple[np.ndarray, int]:
        put(state, state.epoch + 1)
        losses, best_loss, best_epoch = [], state.best_loss, 0
        for ratio, may_be_best in zip(ratios, allowed, strict=True):
            adam.zero_grad()
            loss = kl_divergence(net(target, float(ratio)), target, steps)
            if not math.isfinite(loss.item()):
                break
            losses.append(loss.item())
            if may_be_best and losses[-1] < best_loss:
                best_loss, best_epoch, state.best_vector = losses[-1], len(losses), net.parameter_vector()
            loss.backward()
            adam.step()
        take(state)
        return np.array(losses), best_epoch

    return run_epochs
