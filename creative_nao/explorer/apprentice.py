"""One network that learns beside the page, in a thread of its own: watched, stopped between epochs, gone on with."""

from __future__ import annotations

import dataclasses
import threading
import time

import numpy as np

from creative_nao.demonstrations import Demonstrations
from creative_nao.errors import CreativeNaoError, SettingsError
from creative_nao.model import Memory, NetworkSettings, TrainingSettings
from creative_nao.model.engine import TrainingState
from creative_nao.model.memory import encoding_of
from creative_nao.model.training import memory_at, train_network

MAX_EPOCHS = 300_000
"""Where an apprentice has learned enough, however often it goes on."""
LOOK_S = 0.4
"""Shortest time between two looks at what is learned so far."""
CURVE_POINTS = 240
MADE_BY = "taught in the explorer's page"


@dataclasses.dataclass(frozen=True, eq=False)
class Look:
    """How far an apprentice is.

    Attributes:
        phase: `idle`, `waiting` for others to finish, `learning`, `stopped`, `finished` or `failed`.
        n_epochs: Where it will stop.
        epoch: Epochs done.
        curve: Epoch and loss, shape (n, 2).
        memory: What it has learned so far, None before the first look.
        failure: Why it failed, one line, or empty.
        epochs_per_s: Its pace since it was last started, 0 if unknown.
    """

    phase: str = "idle"
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


class Apprentice:
    """A network and what it is to learn.

    Args:
        demonstrations: The basic actions.
        training: Closed-loop ratio and seed; the number of epochs is `learn`'s.
        turnstile: Lets as many apprentices of the server learn at a time as it has places.

    Attributes:
        look: How far it is now; replaced as a whole, so any thread may read it.

    Raises:
        SettingsError: If the demonstrations cannot be learned.
    """

    def __init__(
        self, demonstrations: Demonstrations, training: TrainingSettings, turnstile: threading.Semaphore
    ) -> None:
        self.demonstrations, self.training = demonstrations, training
        self.look = Look()
        self._network = NetworkSettings()
        n_codes = encoding_of(demonstrations, self._network).n_codes
        self._state = TrainingState.initial(self._network, n_codes, demonstrations.n_actions, training.seed)
        self._turnstile = turnstile
        self._stop = threading.Event()
        self._started = (0, 0.0)
        self._looked = 0.0

    def learn(self, n_epochs: int) -> None:
        """Begin, or go on, until `n_epochs` epochs are done altogether; returns at once.

        Raises:
            SettingsError: If it is at work already, or `n_epochs` are done or too many.
        """
        if self.look.busy:
            raise SettingsError("it is learning already")
        if not self._state.epoch < n_epochs <= MAX_EPOCHS:
            raise SettingsError(
                f"`n_epochs` should be above the {self._state.epoch:,} done and at most {MAX_EPOCHS:,}, "
                f"but is {n_epochs:,}"
            )
        self._stop.clear()
        self.look = dataclasses.replace(self.look, phase="waiting", n_epochs=n_epochs, failure="", epochs_per_s=0.0)
        threading.Thread(target=self._learn, args=(n_epochs,), name="apprentice", daemon=True).start()

    def stop(self) -> None:
        """Let it end at the next hundred epochs; it can go on later."""
        self._stop.set()

    def _learn(self, n_epochs: int) -> None:
        while not self._turnstile.acquire(timeout=0.1):
            if self._stop.is_set():
                self.look = dataclasses.replace(self.look, phase="stopped")
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
            self._turnstile.release()
            self._note(phase, n_epochs, failure)

    def _watch(self, training: TrainingSettings, _: TrainingState) -> None:
        if time.monotonic() - self._looked >= LOOK_S:
            self._note("learning", training.n_epochs)

    def _note(self, phase: str, n_epochs: int, failure: str = "") -> None:
        state = self._state
        memory = self.look.memory
        if state.epoch and np.isfinite(state.best_loss):
            settings = dataclasses.replace(self.training, n_epochs=max(state.epoch, 1))
            memory = memory_at(self.demonstrations, self._network, settings, state, MADE_BY)
            memory = dataclasses.replace(memory, name="taught in this page")
        places = np.unique(np.linspace(0, max(state.epoch - 1, 0), CURVE_POINTS).astype(int))[: state.epoch]
        curve = np.stack([places + 1.0, state.loss_history[places]], axis=1)
        done, since = self._started
        pace = (state.epoch - done) / max(time.monotonic() - since, 1e-3)
        self.look = Look(phase, n_epochs, state.epoch, curve, memory, failure, pace)
        self._looked = time.monotonic()
