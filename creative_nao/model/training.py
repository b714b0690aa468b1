"""Train one network, with checkpoints from which an interrupted run goes on with the same bits."""

from __future__ import annotations

import dataclasses
import os
import threading
from collections.abc import Callable
from pathlib import Path

from creative_nao.demonstrations import Demonstrations
from creative_nao.errors import SettingsError, TrainingError
from creative_nao.model.checkpoint import load_checkpoint, save_checkpoint
from creative_nao.model.config import NetworkSettings, TrainingSettings
from creative_nao.model.engine import TrainingState, make_engine
from creative_nao.model.memory import MAX_CURVE_POINTS, Memory, encoding_of
from creative_nao.model.parameters import parameter_shapes, views
from creative_nao.model.schedule import closed_loop_ratios
from creative_nao.model.targets import target_codes
from creative_nao.provenance import record

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
