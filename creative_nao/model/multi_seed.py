"""Multi-seed training: several networks side by side on all cores, each with its own checkpoint and result."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from pathlib import Path
from typing import overload

from creative_nao.demonstrations import Demonstrations
from creative_nao.errors import SettingsError, TrainingError, shown
from creative_nao.measures import Criteria, dtw
from creative_nao.model.config import NetworkSettings, TrainingSettings, check_kind
from creative_nao.model.memory import Memory
from creative_nao.model.training import Progress, train_network
from creative_nao.runtime import usable_cores
from creative_nao.schema import Count, checked


@dataclasses.dataclass(frozen=True, eq=False)
class Trained:
    """The result of training one network.

    Attributes:
        training: How it was to be trained.
        memory: The result; None if training failed.
        failure: Why there is none, for example a loss that is no longer finite; None otherwise.
    """

    training: TrainingSettings
    memory: Memory | None
    failure: str | None

    def reproduction(self) -> list[float]:
        """Return the DTW distance of each basic action to what its learned PB generates in closed loop [rad]."""
        return [] if self.memory is None else reproduction(self.memory)

    def succeeded(self, threshold: float = Criteria().learned_threshold) -> bool:
        """Tell whether every basic action comes back in closed loop within `threshold` [rad]."""
        return self.memory is not None and max(self.reproduction()) <= threshold


def reproduction(memory: Memory) -> list[float]:
    """Return the DTW distance of each basic action to what its learned PB generates in closed loop [rad]."""
    check_kind(Memory, memory, "memory")
    pairs = zip(memory.generate(memory.pb), memory.demonstrations.trajectories, strict=True)
    return [dtw(generated[: len(action)], action) for generated, action in pairs]


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
        demonstrations: The basic actions.
        wanted: Settings of each network.
        network: Sizes, time constants, code; default: the paper's.
        out: Where each memory is written as soon as it is ready, its checkpoint beside it; None writes nothing.
        checkpoint_interval: Epochs between two checkpoints.
        resume: Take memories that are there as they are, and go on from checkpoints.
        progress: Called from several threads, see `train_network`.
        stop: When set, all networks save their checkpoints and KeyboardInterrupt is raised.
        command: For the memories' records; default: the running command.
        n_workers: Networks at a time; default: the number of cores.

    Returns:
        One result for each of `wanted`, in order.
    """
    check_kind(Sequence, wanted, "wanted")
    for training in wanted:
        check_kind(TrainingSettings, training, "wanted")
    n_workers = usable_cores() if n_workers is None else checked(Count, n_workers, "n_workers")
    stop = threading.Event() if stop is None else stop

    def train_one(training: TrainingSettings) -> Trained:
        path = None if out is None else out(training)
        checkpoint = None if path is None else checkpoint_of(path)
        if resume and path is not None and checkpoint is not None and path.exists():
            finished = _finished(path, training)
            checkpoint.unlink(missing_ok=True)  # of a run that was killed just after it wrote the memory
            return Trained(training, finished, None)
        try:
            memory = train_network(
                demonstrations, training, network, checkpoint=checkpoint, checkpoint_interval=checkpoint_interval,
                resume=resume, progress=progress, stop=stop, command=command,
            )  # fmt: skip
        except TrainingError as error:
            return Trained(training, None, str(error))
        if path is not None and checkpoint is not None:
            memory.save(path)
            checkpoint.unlink(missing_ok=True)
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


def _finished(path: Path, training: TrainingSettings) -> Memory:
    memory = Memory.read(path)
    if memory.training != training:
        raise SettingsError(f"{path}: made with other settings ({memory.training}) than those asked for ({training})")
    return memory


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
        **settings: Other fields of `TrainingSettings`: `closed_loop_ratio`, `schedule`, `n_epochs`, ...

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
    if not isinstance(seeds, Iterable):
        raise SettingsError(f"`seeds` should be a list of whole numbers, but is {shown(seeds)}")
    wanted = [TrainingSettings(seed=value, **settings) for value in seeds]
    trained = train_many(demonstrations, wanted, network, progress=progress)
    failed = [result for result in trained if result.failure is not None]
    if failed:
        raise TrainingError(f"seed {failed[0].training.seed}: {failed[0].failure}")
    return [result.memory for result in trained if result.memory is not None]
