"""Train networks: one or many side by side, with checkpoints from which a run goes on with the same bits."""

from __future__ import annotations

import dataclasses
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from pathlib import Path
from typing import overload

import numpy as np

from creative_nao.demonstrations import Demonstrations
from creative_nao.errors import SettingsError
from creative_nao.model.checkpoint import load_checkpoint, save_checkpoint
from creative_nao.model.config import NetworkSettings, TrainingSettings
from creative_nao.model.engine import TrainingState, make_engine
from creative_nao.model.memory import MAX_CURVE_POINTS, Memory, encoding_of
from creative_nao.model.parameters import parameter_shapes, views
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
    progress: Progress | None = None,
    stop: threading.Event | None = None,
    command: str | None = None,
) -> Memory:
    """Train one network on the basic actions and return it as a memory (Eq. 1-6).

    Args:
        demonstrations: The basic actions.
        training: Closed-loop ratio, epochs, learning rate, seed, engine.
        network: Sizes, time constants, code; default: the paper's.
        checkpoint: File that keeps the state of training every `checkpoint_interval` epochs and when training stops
            early.
        checkpoint_interval: Epochs between two checkpoints.
        resume: Go on from `checkpoint` if it is there; the result has the same bits as an uninterrupted run.
        progress: Called with the settings and the state every `CHUNK_EPOCHS` epochs.
        stop: When set, training saves its checkpoint and raises KeyboardInterrupt.
        command: For the memory's record; default: the running command.

    Raises:
        SettingsError: If a setting or the checkpoint does not fit.
        TrainingError: If the loss is no longer finite.
    """
    network = NetworkSettings() if network is None else network
    if checkpoint_interval < 1:
        raise SettingsError(f"`checkpoint_interval` should be at least 1, but is {checkpoint_interval}")
    encoding = encoding_of(demonstrations, network)
    codes, lengths = target_codes(demonstrations.trajectories, encoding.encode)
    state = None
    if resume and checkpoint is not None and Path(checkpoint).exists():
        state = load_checkpoint(checkpoint, demonstrations, network, training)
    if state is None:
        state = TrainingState.initial(network, encoding.n_codes, demonstrations.n_actions, training.seed)
    advance = make_engine(network, training, codes, lengths)
    saved = state.epoch
    try:
        while state.epoch < training.n_epochs:
            if stop is not None and stop.is_set():
                raise KeyboardInterrupt
            n = min(CHUNK_EPOCHS - state.epoch % CHUNK_EPOCHS, training.n_epochs - state.epoch)
            advance(state, np.full(n, training.closed_loop_ratio))
            if progress is not None:
                progress(training, state)
            if checkpoint is not None and state.epoch - saved >= checkpoint_interval:
                save_checkpoint(checkpoint, state, demonstrations, network, training)
                saved = state.epoch
    finally:
        if checkpoint is not None and saved < state.epoch < training.n_epochs:
            save_checkpoint(checkpoint, state, demonstrations, network, training)
    return _memory(demonstrations, network, training, state, encoding.n_codes, command)


@overload
def train(
    demonstrations: Demonstrations, *, seed: int = ..., seeds: None = ..., network: NetworkSettings | None = ...,
    progress: Progress | None = ..., **settings,
) -> Memory: ...  # fmt: skip
@overload
def train(
    demonstrations: Demonstrations, *, seed: int = ..., seeds: Sequence[int], network: NetworkSettings | None = ...,
    progress: Progress | None = ..., **settings,
) -> list[Memory]: ...  # fmt: skip
def train(
    demonstrations: Demonstrations,
    *,
    seed: int = 0,
    seeds: Sequence[int] | None = None,
    network: NetworkSettings | None = None,
    progress: Progress | None = None,
    **settings,
) -> Memory | list[Memory]:
    """Train a network, or one per seed side by side on all cores.

    Args:
        demonstrations: The basic actions, from `load_demonstrations`.
        seed: Seed of the initial weights.
        seeds: Several seeds; then a list of memories in their order is returned.
        network: Sizes, time constants, code; default: the paper's.
        progress: Called with the settings and the state every hundred epochs, from several threads when there are
            several seeds.
        **settings: Other fields of `TrainingSettings`: `closed_loop_ratio`, `n_epochs`, `learning_rate`, `engine`.

    Returns:
        A memory, or a list of them when `seeds` is given. The number of cores does not change a bit.

    Raises:
        SettingsError: If a setting is unknown or out of range.
        TrainingError: If a loss is no longer finite.
    """
    known = {field.name for field in dataclasses.fields(TrainingSettings)} - {"seed"}
    unknown = sorted(set(settings) - known)
    if unknown:
        raise SettingsError(f"`{unknown[0]}` is no setting of training; there are {', '.join(sorted(known))}")
    if seeds is None:
        return train_network(demonstrations, TrainingSettings(seed=seed, **settings), network, progress=progress)
    wanted = [TrainingSettings(seed=one, **settings) for one in seeds]
    return train_side_by_side(
        [
            lambda stop, one=one: train_network(demonstrations, one, network, progress=progress, stop=stop)
            for one in wanted
        ]
    )


def train_side_by_side(
    jobs: Sequence[Callable[[threading.Event], Memory]], n_workers: int | None = None
) -> list[Memory]:
    """Run training jobs on all cores and return their memories in order.

    Compiled epochs release Python's lock, so threads are enough. When one fails or the user interrupts, the others
    save their checkpoints and stop.

    Args:
        jobs: Each is called with an event that asks it to stop.
        n_workers: Networks at a time; default: the number of cores.
    """
    stop = threading.Event()
    n_cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    with ThreadPoolExecutor(n_workers or n_cores) as pool:
        futures = [pool.submit(job, stop) for job in jobs]
        try:
            wait(futures, return_when=FIRST_EXCEPTION)
            failed = [future for future in futures if future.done() and future.exception()]
            if failed:
                failed[0].result()
        except BaseException:
            stop.set()
            for future in futures:
                future.cancel()
            raise
    return [future.result() for future in futures]


def _memory(
    demonstrations: Demonstrations,
    network: NetworkSettings,
    training: TrainingSettings,
    state: TrainingState,
    n_codes: int,
    command: str | None,
) -> Memory:
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
