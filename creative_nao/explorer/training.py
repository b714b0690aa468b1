"""Networks that train in threads for the teaching page, watched and stopped from there."""

from __future__ import annotations

import dataclasses
import secrets
import threading
import time
from typing import Any

import numpy as np

from creative_nao import maps
from creative_nao.demonstrations import Demonstrations
from creative_nao.errors import CreativeNaoError, NotFoundError, SettingsError
from creative_nao.explorer.registry import LoadedMemory, cells_json, spoken
from creative_nao.measures import Criteria
from creative_nao.model import Memory, NetworkSettings, TrainingSettings
from creative_nao.model.encoding import encoding_of
from creative_nao.model.recall import reproduction
from creative_nao.model.training import TrainingState, memory_at, train_network
from creative_nao.runtime import usable_cores

MAX_EPOCHS = 300_000  # where a training ends, however often it goes on
MIN_INTERVAL_S = 0.4  # shortest time between two reports of progress
CURVE_POINTS = 240


@dataclasses.dataclass(frozen=True, eq=False)
class TrainingProgress:
    """How far a training is: `epoch` of `n_epochs`, epochs and losses (n, 2), what is learned, and why it failed."""

    phase: str = "idle"  # `waiting` for others to finish, `learning`, `stopped`, `finished` or `failed`
    n_epochs: int = 0
    epoch: int = 0
    curve: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 2)))
    memory: Memory | None = None
    failure: str = ""
    epochs_per_s: float = 0.0

    @property
    def busy(self) -> bool:
        """Whether it is at work, or will be."""
        return self.phase in ("waiting", "learning")

    def __str__(self) -> str:
        """Return how far it is, in words."""
        if self.phase == "failed":
            return f"Training failed: {self.failure}"
        if self.phase == "waiting":
            return "Waiting for another training on this machine to end ..."
        if not len(self.curve):
            return "Beginning ..."
        if self.phase == "learning":
            left = (self.n_epochs - self.epoch) / max(self.epochs_per_s, 1e-9)
            return f"Learning: {self.epoch:,} of {self.n_epochs:,} rounds, about {left:.0f} s left"
        return f"{'Learned' if self.phase == 'finished' else 'Stopped'} after {self.epoch:,} rounds"


class Trainer:
    """A training in a thread, to be stopped and gone on with; SettingsError if it cannot be learned."""

    def __init__(
        self, demonstrations: Demonstrations, training: TrainingSettings, concurrency_limit: threading.Semaphore
    ) -> None:
        self.demonstrations, self.training = demonstrations, training
        self.progress = TrainingProgress()  # replaced as a whole, so any thread may read it
        self._loaded: tuple[Memory, LoadedMemory] | None = None
        self._map: tuple[Memory, dict[str, Any]] | None = None
        self._network = NetworkSettings()
        n_codes = encoding_of(demonstrations, self._network).n_codes
        self._state = TrainingState.initial(self._network, n_codes, demonstrations.n_actions, training.seed)
        self._concurrency_limit = concurrency_limit
        self._stop = threading.Event()
        self._started = (0, 0.0)
        self._reported = 0.0

    def learn(self, n_epochs: int) -> None:
        """Begin, or go on, until `n_epochs` are done altogether; SettingsError if at work, done or too many."""
        if self.progress.busy:
            raise SettingsError("it is learning already")
        if not self._state.epoch < n_epochs <= MAX_EPOCHS:
            raise SettingsError(
                f"`n_epochs` should be above the {self._state.epoch:,} done and at most {MAX_EPOCHS:,}, "
                f"but is {n_epochs:,}"
            )
        self._stop.clear()
        self.progress = dataclasses.replace(
            self.progress, phase="waiting", n_epochs=n_epochs, failure="", epochs_per_s=0.0
        )
        threading.Thread(target=self._learn, args=(n_epochs,), name="trainer", daemon=True).start()

    def loaded(self) -> LoadedMemory:
        """Return what has been learned so far, to be explored; SettingsError if that is nothing yet."""
        memory = self.progress.memory
        if memory is None:
            raise SettingsError("nothing has been learned yet")
        if self._loaded is None or self._loaded[0] is not memory:
            self._loaded = memory, LoadedMemory(memory, EXPLORED_RESOLUTION)
            self._loaded[1].start()
        return self._loaded[1]

    def as_json(self) -> dict[str, Any]:
        """Return how far it is as the page shows it; at the end with the distance of each demonstration as it returns.

        The distances are DTW [rad], and `threshold` is the largest that counts as learned.
        """
        progress = self.progress
        memory, ended = progress.memory, not progress.busy
        if memory is not None and (self._map is None or self._map[0] is not memory):
            drawn = cells_json(maps.pb_map(memory, WATCHED_RESOLUTION), {}) | {"pb": memory.pb.tolist()}
            self._map = memory, drawn
        return {
            "phase": progress.phase, "epoch": progress.epoch, "epochs": progress.n_epochs, "text": str(progress),
            "curve": [[int(epoch), float(loss)] for epoch, loss in progress.curve if np.isfinite(loss)],
            "names": [spoken(name) for name in self.demonstrations.names], "threshold": Criteria().learned_threshold,
            "map": None if self._map is None else self._map[1],
            "distances": [float(one) for one in reproduction(memory)] if memory is not None and ended else None,
        }  # fmt: skip

    def stop(self) -> None:
        """Let it end at the next hundred epochs; it can go on later."""
        self._stop.set()

    def _learn(self, n_epochs: int) -> None:
        while not self._concurrency_limit.acquire(timeout=0.1):
            if self._stop.is_set():
                self.progress = dataclasses.replace(self.progress, phase="stopped")
                return
        phase, failure = "failed", ""
        try:
            settings = dataclasses.replace(self.training, n_epochs=n_epochs)
            self._started = (self._state.epoch, time.monotonic())
            train_network(
                self.demonstrations, settings, self._network, state=self._state, progress=self._watch, stop=self._stop
            )
            phase = "finished"
        except KeyboardInterrupt:
            phase = "stopped"
        except CreativeNaoError as error:
            failure = str(error)
        except Exception as error:  # the page has to say so, a thread has nobody else to tell
            failure = f"{type(error).__name__}: {error}"
            raise
        finally:
            self._concurrency_limit.release()
            self._report(phase, n_epochs, failure)

    def _watch(self, training: TrainingSettings, _: TrainingState) -> None:
        if time.monotonic() - self._reported >= MIN_INTERVAL_S:
            self._report("learning", training.n_epochs)

    def _report(self, phase: str, n_epochs: int, failure: str = "") -> None:
        state, memory = self._state, self.progress.memory
        if state.epoch and np.isfinite(state.best_loss):
            settings = dataclasses.replace(self.training, n_epochs=state.epoch)
            memory = memory_at(self.demonstrations, self._network, settings, state, "taught in the explorer's page")
            memory = dataclasses.replace(memory, name="taught in this page")
        places = np.unique(np.linspace(0, max(state.epoch - 1, 0), CURVE_POINTS).astype(int))[: state.epoch]
        curve = np.stack([places + 1.0, state.loss_history[places]], axis=1)
        done, since = self._started
        pace = (state.epoch - done) / max(time.monotonic() - since, 1e-3)
        self.progress = TrainingProgress(phase, n_epochs, state.epoch, curve, memory, failure, pace)
        self._reported = time.monotonic()


PLACES = max(1, usable_cores() - 1)  # how many train at a time; the page keeps a core
MAX_TRAINERS = 40
PATIENCE_S = 30.0
"""How long a trainer that no page asks for is kept [s]; a tab that is closed asks no more."""
EXPLORED_RESOLUTION = 100
"""Of the map of a memory that is explored: a quarter of the time of the paper's, for one that may soon learn on."""
WATCHED_RESOLUTION = 32


class TrainingSessions:
    """All trainers by names that nobody can guess; one that no page asks for any more is stopped and forgotten."""

    def __init__(self) -> None:
        self.concurrency_limit = threading.Semaphore(PLACES)
        self._trainers: dict[str, tuple[Trainer, float]] = {}
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._trainers)

    def add(self, trainer: Trainer) -> str:
        """Keep a trainer and return its name; SettingsError if there are too many."""
        self.sweep()
        with self._lock:
            if len(self._trainers) >= MAX_TRAINERS:
                raise SettingsError(f"{MAX_TRAINERS} memories are being taught; close a page and wait a minute")
            name = secrets.token_urlsafe(12)
            self._trainers[name] = trainer, time.monotonic()
        return name

    def get(self, name: str) -> Trainer:
        """Return a trainer, which stays for `PATIENCE_S` more; NotFoundError if there is none of this name."""
        with self._lock:
            if name not in self._trainers:
                raise NotFoundError("the memory taught in the page is gone: no page has shown it for a while")
            trainer, _ = self._trainers[name]
            self._trainers[name] = trainer, time.monotonic()
            return trainer

    def sweep(self) -> None:
        """Stop and forget the trainers that nobody has asked for; to be called now and then."""
        with self._lock:
            now = time.monotonic()
            gone = [name for name, (_, asked) in self._trainers.items() if now - asked > PATIENCE_S]
            trainers = [self._trainers.pop(name)[0] for name in gone]
        for trainer in trainers:
            trainer.stop()
