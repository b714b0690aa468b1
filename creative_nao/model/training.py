"""Train one network or many, with checkpoints from which an interrupted run goes on with the same bits."""

from __future__ import annotations

import dataclasses
import hashlib
import math
import os
import threading
import warnings
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any, overload

import numpy as np

from creative_nao.arrays import load_tensors, only_arrays, save_tensors, take
from creative_nao.demonstrations import Demonstrations
from creative_nao.errors import FileFormatError, RecallWarning, SettingsError, TrainingError, shown
from creative_nao.model.config import (
    VECTORS,
    NetworkSettings,
    TrainingSettings,
    TrainingState,
    attempts,
    candidates,
    check_kind,
    closed_loop_ratios,
    n_parameters,
    parameter_shapes,
    views,
)
from creative_nao.model.encoding import encoding_of, target_codes
from creative_nao.model.memory import MAX_CURVE_POINTS, Memory
from creative_nao.model.recall import RecallReport, Trained, condition_settings
from creative_nao.runtime import record as provenance
from creative_nao.runtime import usable_cores
from creative_nao.schema import Count, Index, Sha256, checked, checked_path, dump, parse, record


def make_engine(
    network: NetworkSettings, training: TrainingSettings, codes: np.ndarray, lengths: np.ndarray
) -> Callable[[TrainingState, np.ndarray], None]:
    """Return a function that advances a state in place: `advance(state, ratios)`, one closed-loop ratio per epoch.

    `codes` and `lengths` are those of `encoding.target_codes`. The function raises TrainingError where the loss is not
    finite; the state stays at the last good epoch.
    """
    if training.engine == "fused":
        from creative_nao.model.compiled_training import CompiledNetwork

        run_epochs = CompiledNetwork(network, codes, lengths).run_epochs
    else:
        from creative_nao.model.network import ReferenceTraining

        run_epochs = ReferenceTraining(network, codes, lengths).run_epochs

    def advance(state: TrainingState, ratios: np.ndarray) -> None:
        done = state.epoch
        vectors, losses, best = run_epochs(state, ratios, candidates(training, ratios), training.learning_rate)
        for name, vector in zip(VECTORS, vectors, strict=True):
            setattr(state, name, vector)
        if best:
            state.best_epoch, state.best_loss = done + best, float(losses[best - 1])
        state.loss_history = np.concatenate([state.loss_history, losses])
        if len(losses) < len(ratios):
            raise TrainingError(
                f"the loss is no longer finite at epoch {state.epoch + 1} (learning rate {training.learning_rate}); "
                f"the best epoch so far is {state.best_epoch} with loss {state.best_loss:.4g}"
            )

    return advance


KIND = "checkpoint"


@record
class CheckpointHeader:
    """What a checkpoint holds beside its arrays: the training it belongs to, and the best epoch so far."""

    network: NetworkSettings
    training: TrainingSettings
    demonstrations: Sha256
    best_loss: float | None
    best_epoch: Index


def save_checkpoint(
    path: str | os.PathLike[str],
    state: TrainingState,
    demonstrations: Demonstrations,
    network: NetworkSettings,
    training: TrainingSettings,
) -> Path:
    """Write the state and what it belongs to, in one step."""
    best_loss = state.best_loss if math.isfinite(state.best_loss) else None
    header = CheckpointHeader(network, training, _digest(demonstrations), best_loss, state.best_epoch)
    tensors = {name: getattr(state, name) for name in (*VECTORS, "loss_history")}
    return save_tensors(path, kind=KIND, header=dump(header), tensors=tensors)


def load_checkpoint(
    path: str | os.PathLike[str], demonstrations: Demonstrations, network: NetworkSettings, training: TrainingSettings
) -> TrainingState:
    """Read a state back; a torn or foreign file is a FileFormatError.

    One of other settings or demonstrations is a SettingsError that names the field. Only the number of epochs may
    differ, so that a finished run can be continued.
    """
    values, tensors = load_tensors(path, kind=KIND)
    header = parse(CheckpointHeader, values, f"{path}: header")
    for made_with, asked in ((header.network, network), (header.training, training)):
        for field in dataclasses.fields(asked):
            came, expected = getattr(made_with, field.name), getattr(asked, field.name)
            if came != expected and field.name != "n_epochs":
                raise SettingsError(
                    f"{path}: made with {field.name}={shown(came)}, but {field.name}={expected!r} is asked for"
                )
    if header.demonstrations != _digest(demonstrations):
        raise SettingsError(f"{path}: made with other demonstrations than those given")
    n_codes = demonstrations.n_joints * network.n_softmax_units
    size = n_parameters(parameter_shapes(network, n_codes, demonstrations.n_actions))
    only_arrays(path, tensors, [*VECTORS, "loss_history"])
    least = {"second_moment": 0.0}  # a mean of squares
    vectors = {
        name: take(path, tensors, name, (size,), np.float32, least=least.get(name, -math.inf)) for name in VECTORS
    }
    history = take(path, tensors, "loss_history", (None,), np.float64)
    if header.best_epoch > len(history):
        raise FileFormatError(
            f"{path}: header: `best_epoch` should be at most {len(history)}, but is {header.best_epoch}"
        )
    best_loss = math.inf if header.best_loss is None else header.best_loss
    return TrainingState(**vectors, loss_history=history, best_loss=best_loss, best_epoch=header.best_epoch)


def _digest(demonstrations: Demonstrations) -> str:
    digest = hashlib.sha256(repr((demonstrations.names, demonstrations.joints, demonstrations.dt_s)).encode())
    for trajectory in demonstrations.trajectories:
        digest.update(np.ascontiguousarray(trajectory).tobytes())
    return digest.hexdigest()


CHUNK_EPOCHS = 100  # epochs between two looks at progress and at a wish to stop

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

    With the condition `auto` it trains up to several, `config.attempts`, until one gives every basic action back, and
    returns that one, or the best; `record["attempts"]` of the memory tells what was tried.

    Args:
        demonstrations: The basic actions.
        training: Closed-loop ratio, epochs, learning rate, seed, engine, condition.
        network: Sizes, time constants, code; default: the paper's.
        checkpoint: File that keeps the state of training every `checkpoint_interval` epochs and when training is
            interrupted.
        checkpoint_interval: Epochs between two checkpoints.
        resume: Go on from `checkpoint` if it is there; the result has the same bits as an uninterrupted run.
        state: Go on from this state of the same training, which is advanced in place; instead of `resume`, and not
            with `auto`.
        progress: Called with the settings and the state every `CHUNK_EPOCHS` epochs; with `auto` the settings are
            those of the attempt.
        stop: When set, training saves its checkpoint and raises KeyboardInterrupt.
        command: For the memory's record; default: the running command.

    Raises:
        SettingsError: If a setting or the checkpoint does not fit.
        TrainingError: If the loss is no longer finite; the last checkpoint stays as it is.
    """
    network = NetworkSettings() if network is None else network
    check_kind(demonstrations, Demonstrations, "demonstrations")
    check_kind(training, TrainingSettings, "training")
    check_kind(network, NetworkSettings, "network")
    checked(Count, checkpoint_interval, "checkpoint_interval")
    checkpoint = None if checkpoint is None else checked_path(checkpoint, "checkpoint")
    if training.condition == "auto":
        if state is not None:
            raise SettingsError("`state` belongs to one training, but the condition `auto` may make several")
        return _train_until_recalled(
            demonstrations, training, network, checkpoint, checkpoint_interval=checkpoint_interval, resume=resume,
            progress=progress, stop=stop, command=command,
        )  # fmt: skip
    encoding = encoding_of(demonstrations, network)
    codes, lengths = target_codes(encoding, demonstrations.trajectories, training.first_input, training.ending)
    if state is None and resume and checkpoint is not None and checkpoint.exists():
        state = load_checkpoint(checkpoint, demonstrations, network, training)
    if state is None:
        sizes = encoding.n_codes, demonstrations.n_actions
        state = TrainingState.initial(network, *sizes, training.seed, training.attempt)
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


def _train_until_recalled(
    demonstrations: Demonstrations,
    training: TrainingSettings,
    network: NetworkSettings,
    checkpoint: Path | None,
    **options: Any,
) -> Memory:
    """Return the first memory of the attempts that gives every action back, else the one nearest to it."""
    tried: list[dict[str, Any]] = []
    best: tuple[tuple[int, float], int, Memory] | None = None
    failure: TrainingError | None = None
    for one in attempts(training):
        settings = {name: getattr(one, name) for name in ("attempt", "closed_loop_ratio", "n_epochs")}
        place = None if checkpoint is None else checkpoint_of_attempt(checkpoint, one.attempt)
        try:
            memory = train_network(demonstrations, one, network, checkpoint=place, **options)
        except TrainingError as error:
            failure = error
            tried.append({**settings, "failure": str(error)})
            continue
        recall = RecallReport.of(memory)
        tried.append({**settings, "loss": memory.best_loss, "reproduction_dtw": recall.distances})
        rank = len(recall.missing), max(recall.distances.values())
        if best is None or rank < best[0]:
            best = rank, one.attempt, memory
        if not recall.missing:
            break
    if best is None:
        assert failure is not None
        raise failure
    _, kept, memory = best
    done = {"condition": "auto", "attempts": tried, "kept_attempt": kept}
    return dataclasses.replace(memory, record={**memory.record, **done})


def checkpoint_of_attempt(checkpoint: Path, attempt: int) -> Path:
    """Return where an attempt of the condition `auto` keeps its state; the first one's is `checkpoint` itself."""
    return checkpoint if attempt == 1 else checkpoint.with_name(f"{checkpoint.name}-{attempt}")


def memory_at(
    demonstrations: Demonstrations,
    network: NetworkSettings,
    training: TrainingSettings,
    state: TrainingState,
    command: str | None = None,
) -> Memory:
    """Return the memory of a training that ends in this state, with the best epoch so far."""
    shapes = parameter_shapes(network, demonstrations.n_joints * network.n_softmax_units, demonstrations.n_actions)
    every = -(-state.epoch // MAX_CURVE_POINTS)
    return Memory(
        network=network,
        training=training,
        parameters={name: array.copy() for name, array in views(state.best_vector, shapes).items()},
        demonstrations=demonstrations,
        loss_history=state.loss_history[::every].astype("float32"),
        loss_every=every,
        best_epoch=state.best_epoch,
        best_loss=state.best_loss,
        record=provenance(settings={"network": dump(network), "training": dump(training)}, command=command),
    )


def train_many(
    demonstrations: Demonstrations,
    wanted: Sequence[TrainingSettings],
    network: NetworkSettings | None = None,
    *,
    out: Callable[[TrainingSettings], Path] | None = None,
    checkpoint_interval: int = 5000,
    resume: bool = False,
    progress: Progress | None = None,
    stop: threading.Event | None = None,
    command: str | None = None,
    n_workers: int | None = None,
) -> list[Trained]:
    """Train several networks at a time, one a core; the number of cores changes no bit.

    Compiled epochs release Python's lock, so threads are enough. A network whose loss is no longer finite is recorded
    as failed, the others go on. When the user interrupts, all save their checkpoints.

    Args:
        demonstrations, network, checkpoint_interval, command: As in `train_network`.
        wanted: Settings of each network.
        out: Where each memory is written as soon as it is ready, its checkpoint beside it; None writes nothing.
        resume: Take memories that are there as they are, and go on from checkpoints.
        progress: Called from several threads, see `train_network`.
        stop: When set, all networks save their checkpoints and KeyboardInterrupt is raised.
        n_workers: Networks at a time; default: the number of cores.

    Returns:
        One result for each of `wanted`, in order.
    """
    check_kind(wanted, Sequence, "wanted")
    for training in wanted:
        check_kind(training, TrainingSettings, "wanted")
    n_workers = usable_cores() if n_workers is None else checked(Count, n_workers, "n_workers")
    stop = threading.Event() if stop is None else stop

    def train_one(training: TrainingSettings) -> Trained:
        path = None if out is None else out(training)
        checkpoint = None if path is None else checkpoint_of(path)
        if resume and path is not None and path.exists():
            memory = Memory.read(path)
            if memory.training not in attempts(training):
                raise SettingsError(f"{path}: made with other settings ({memory.training}) than asked for ({training})")
        else:
            try:
                memory = train_network(
                    demonstrations, training, network, checkpoint=checkpoint, checkpoint_interval=checkpoint_interval,
                    resume=resume, progress=progress, stop=stop, command=command,
                )  # fmt: skip
            except TrainingError as error:
                return Trained(training, None, str(error))
            if path is not None:
                memory.save(path)
        if checkpoint is not None:
            for one in attempts(training):
                checkpoint_of_attempt(checkpoint, one.attempt).unlink(missing_ok=True)
        return Trained(training, memory, None)

    with ThreadPoolExecutor(n_workers) as pool:
        futures = [pool.submit(train_one, training) for training in wanted]
        try:
            done, _ = wait(futures, return_when=FIRST_EXCEPTION)
            for future in done:
                future.result()
        except BaseException:
            stop.set()
            for future in futures:
                future.cancel()
            raise
    return [future.result() for future in futures]


def checkpoint_of(path: Path) -> Path:
    """Return where the checkpoint of the memory file `path` stands."""
    return path.with_name(f"{path.name}.checkpoint")


@overload
def train(
    demonstrations: Demonstrations, *, seed: int = ..., seeds: None = ..., network: NetworkSettings | None = ...,
    condition: str | None = ..., progress: Progress | None = ..., **settings,
) -> Memory: ...  # fmt: skip
@overload
def train(
    demonstrations: Demonstrations, *, seed: int = ..., seeds: Sequence[int], network: NetworkSettings | None = ...,
    condition: str | None = ..., progress: Progress | None = ..., **settings,
) -> list[Memory]: ...  # fmt: skip
def train(
    demonstrations: Demonstrations,
    *,
    seed: int = 0,
    seeds: Sequence[int] | None = None,
    network: NetworkSettings | None = None,
    condition: str | None = None,
    progress: Progress | None = None,
    **settings,
) -> Memory | list[Memory]:
    """Train a network, or one per seed side by side on all cores.

    A memory that does not give every basic action back in closed loop is told by a `RecallWarning`.

    Args:
        demonstrations: The basic actions, from `load_demonstrations`.
        seed: Seed of the initial weights.
        seeds: Several seeds; then a list of memories in their order is returned.
        network: Sizes, time constants, code; default: the paper's.
        condition: `open`, `half` or `closed`, the paper's closed-loop ratios; or `auto`, which trains until every
            action comes back (`config.attempts`): for recordings of any length. Instead of `closed_loop_ratio`.
        progress: Called with the settings and the state every hundred epochs, from several threads when there are
            several seeds.
        **settings: Other fields of `TrainingSettings`: `closed_loop_ratio`, `schedule`, `n_epochs`, ...

    Returns:
        A memory, or a list of them when `seeds` is given. The number of cores does not change a bit.

    Raises:
        SettingsError: If a setting is unknown or out of range.
        TrainingError: If a loss is no longer finite.
    """
    settings |= condition_settings(condition, settings)
    if seeds is None:
        memory = train_network(demonstrations, TrainingSettings(seed=seed, **settings), network, progress=progress)
        _warn(memory)
        return memory
    if not isinstance(seeds, Iterable):
        raise SettingsError(f"`seeds` should be a list of whole numbers, but is {shown(seeds)}")
    wanted = [TrainingSettings(seed=value, **settings) for value in seeds]
    trained = train_many(demonstrations, wanted, network, progress=progress)
    failed = [result for result in trained if result.failure is not None]
    if failed:
        raise TrainingError(f"seed {failed[0].training.seed}: {failed[0].failure}")
    memories = [result.memory for result in trained if result.memory is not None]
    for memory in memories:
        _warn(memory)
    return memories


def _warn(memory: Memory) -> None:
    if (recall := RecallReport.of(memory)).missing:
        warnings.warn(f"seed {memory.training.seed}: {recall}", RecallWarning, stacklevel=3)
