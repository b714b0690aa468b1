"""Train one network, with checkpoints from which an interrupted run goes on with the same bits.

Also here:
- The codes that a network is taught to predict.
- The two interchangeable ways to run training epochs: compiled (`fused`) and readable (`reference`).
- Keep the state of a training run in a file, so that a killed run goes on with the same bits.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao.arrays import load_tensors, save_tensors, take
from creative_nao.demonstrations import Demonstrations
from creative_nao.errors import FileFormatError, SettingsError, TrainingError
from creative_nao.fields import Fields, only_arrays, shown
from creative_nao.model.config import (
    NetworkSettings,
    TrainingSettings,
    candidates,
    closed_loop_ratios,
    initial_vector,
    n_parameters,
    parameter_shapes,
    views,
)
from creative_nao.model.memory import MAX_CURVE_POINTS, Memory, encoding_of
from creative_nao.runtime import record

TARGET_FLOOR = 1e-12
"""Smallest target probability, so that its logarithm is finite."""


def target_codes(
    trajectories: list[np.ndarray], encode: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Encode actions of any lengths into one array.

    Args:
        trajectories: Joint angles [rad], each (n_steps, n_joints).
        encode: `SoftmaxEncoding.encode`.

    Returns:
        Codes, shape (n_actions, longest, n_codes) float32, the rows past an action's end filled with its last posture;
        and the lengths, shape (n_actions,).
    """
    lengths = np.array([len(t) for t in trajectories])
    codes = []
    for trajectory in trajectories:
        padding = [(0, int(lengths.max()) - len(trajectory)), (0, 0)]
        codes.append(encode(np.pad(trajectory, padding, mode="edge")))
    return np.maximum(np.array(codes), TARGET_FLOOR).astype(np.float32), lengths


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
    from creative_nao.model.compiled_training import CompiledNetwork

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

    from creative_nao.model.network import PBMTRNN, kl_divergence

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


KIND = "checkpoint"
_VECTORS = ("vector", "first_moment", "second_moment", "best_vector")


def save_checkpoint(
    path: str | os.PathLike[str],
    state: TrainingState,
    demonstrations: Demonstrations,
    network: NetworkSettings,
    training: TrainingSettings,
) -> Path:
    """Write the state and what it belongs to, in one step."""
    header = {
        **_identity(demonstrations, network, training),
        "best_loss": state.best_loss if math.isfinite(state.best_loss) else None,
        "best_epoch": state.best_epoch,
    }
    tensors = {name: getattr(state, name) for name in _VECTORS}
    return save_tensors(path, kind=KIND, header=header, tensors={**tensors, "loss_history": state.loss_history})


def load_checkpoint(
    path: str | os.PathLike[str], demonstrations: Demonstrations, network: NetworkSettings, training: TrainingSettings
) -> TrainingState:
    """Read a state back.

    Raises:
        SettingsError: If it belongs to other settings or demonstrations; the message names the field. Only the number
            of epochs may differ, so that a finished run can be continued.
        FileFormatError: If the file is torn or foreign.
    """
    values, tensors = load_tensors(path, kind=KIND)
    header = Fields(values, f"{path}: header")
    expected = _identity(demonstrations, network, training)
    for part in ("network", "training"):
        found = header.object(part).values
        for field, value in expected[part].items():
            came = found.get(field)
            came = tuple(came) if isinstance(came, list) else came
            if (came != value or isinstance(came, bool) is not isinstance(value, bool)) and field != "n_epochs":
                raise SettingsError(f"{path}: made with {field}={shown(came)}, but {field}={value!r} is asked for")
    if header.any("demonstrations") != expected["demonstrations"]:
        raise SettingsError(f"{path}: made with other demonstrations than those given")
    n_codes = demonstrations.n_joints * network.n_softmax_units
    size = n_parameters(parameter_shapes(network, n_codes, demonstrations.n_actions))
    only_arrays(path, tensors, [*_VECTORS, "loss_history"])
    vectors = {name: take(path, tensors, name, (size,), np.float32) for name in _VECTORS}
    if (vectors["second_moment"] < 0).any():
        raise FileFormatError(f"{path}: the array `second_moment` should hold means of squares, but some are below 0")
    history = take(path, tensors, "loss_history", (None,), np.float64)
    best_loss = math.inf if header.any("best_loss") is None else header.number("best_loss")
    best_epoch = header.whole("best_epoch", least=0, most=len(history))
    return TrainingState(**vectors, loss_history=history, best_loss=best_loss, best_epoch=best_epoch)


def _identity(demonstrations: Demonstrations, network: NetworkSettings, training: TrainingSettings) -> dict[str, Any]:
    digest = hashlib.sha256(repr((demonstrations.names, demonstrations.joints, demonstrations.dt_s)).encode())
    for trajectory in demonstrations.trajectories:
        digest.update(np.ascontiguousarray(trajectory).tobytes())
    return {
        "network": dataclasses.asdict(network),
        "training": dataclasses.asdict(training),
        "demonstrations": digest.hexdigest(),
    }


CHUNK_EPOCHS = 100
"""Epochs between two looks at progress and at a wish to stop."""

Progress = Callable[[TrainingSettings, TrainingState], None]


def train_network(
    demonstrations: Demonstrations,
    training: TrainingSettings,
    network: NetworkSettings | None = None,
    *,
    checkpoint: str | os.PathLike[str] | None = None,
    checkpoint_interval: int = 5000,
    resume: bool = False,
    state: TrainingState | None = None,
    progress: Progress | None = None,
    stop: threading.Event | None = None,
    command: str | None = None,
) -> Memory:
    """Train one network on the basic actions and return it as a memory (Eq. 1-6).

    Args:
        demonstrations: The basic actions.
        training: Closed-loop ratio, epochs, learning rate, seed, engine.
        network: Sizes, time constants, code; default: the paper's.
        checkpoint: File that keeps the state of training every `checkpoint_interval` epochs and when training is
            interrupted.
        checkpoint_interval: Epochs between two checkpoints.
        resume: Go on from `checkpoint` if it is there; the result has the same bits as an uninterrupted run.
        state: Go on from this state of the same training, which is advanced in place; instead of `resume`.
        progress: Called with the settings and the state every `CHUNK_EPOCHS` epochs.
        stop: When set, training saves its checkpoint and raises KeyboardInterrupt.
        command: For the memory's record; default: the running command.

    Raises:
        SettingsError: If a setting or the checkpoint does not fit.
        TrainingError: If the loss is no longer finite; the last checkpoint stays as it is.
    """
    network = NetworkSettings() if network is None else network
    if checkpoint_interval < 1:
        raise SettingsError(f"`checkpoint_interval` should be at least 1, but is {checkpoint_interval}")
    encoding = encoding_of(demonstrations, network)
    codes, lengths = target_codes(demonstrations.trajectories, encoding.encode)
    if state is None and resume and checkpoint is not None and Path(checkpoint).exists():
        state = load_checkpoint(checkpoint, demonstrations, network, training)
    if state is None:
        state = TrainingState.initial(network, encoding.n_codes, demonstrations.n_actions, training.seed)
    advance = make_engine(network, training, codes, lengths)
    saved = state.epoch

    def save() -> None:
        nonlocal saved
        if checkpoint is not None and saved < state.epoch:
            save_checkpoint(checkpoint, state, demonstrations, network, training)
            saved = state.epoch

    try:
        while state.epoch < training.n_epochs:
            if stop is not None and stop.is_set():
                raise KeyboardInterrupt
            end = min(state.epoch - state.epoch % CHUNK_EPOCHS + CHUNK_EPOCHS, training.n_epochs)
            advance(state, closed_loop_ratios(training, state.epoch, end))
            if progress is not None:
                progress(training, state)
            if state.epoch - saved >= checkpoint_interval:
                save()
    except TrainingError:
        raise  # the moments of Adam are not finite any more: an older checkpoint is worth more
    except BaseException:
        save()
        raise
    return memory_at(demonstrations, network, training, state, command)


def memory_at(
    demonstrations: Demonstrations,
    network: NetworkSettings,
    training: TrainingSettings,
    state: TrainingState,
    command: str | None = None,
) -> Memory:
    """Return the memory that a training would leave if it ended in this state, with the best epoch so far."""
    n_codes = demonstrations.n_joints * network.n_softmax_units
    shapes = parameter_shapes(network, n_codes, demonstrations.n_actions)
    every = -(-state.epoch // MAX_CURVE_POINTS)
    settings = {"network": dataclasses.asdict(network), "training": dataclasses.asdict(training)}
    return Memory(
        network=network,
        training=training,
        parameters={name: array.copy() for name, array in views(state.best_vector, shapes).items()},
        demonstrations=demonstrations,
        loss_history=state.loss_history[::every].astype("float32"),
        loss_every=every,
        best_epoch=state.best_epoch,
        best_loss=state.best_loss,
        record=record(settings=settings, command=command),
    )
