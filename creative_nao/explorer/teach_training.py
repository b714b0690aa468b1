"""The training part of the teaching page: networks that train in threads, watched and stopped from tabs."""

from __future__ import annotations

import dataclasses
import io
import secrets
import tempfile
import threading
import time
import zipfile
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from nicegui import run, ui

from creative_nao.demonstrations import Demonstrations, save_demonstrations
from creative_nao.errors import CreativeNaoError, SettingsError
from creative_nao.explorer.keyframe_editor import KeyframeSet, advice, grown_map, loss_svg, shortcomings
from creative_nao.explorer.memory_service import spoken
from creative_nao.explorer.registry import MemoryRegistry
from creative_nao.explorer.tab import AppState
from creative_nao.maps import PBMap, pb_map
from creative_nao.maps.figure_style import action_letter
from creative_nao.measures import Criteria
from creative_nao.model import Memory, NetworkSettings, TrainingSettings
from creative_nao.model.encoding import encoding_of
from creative_nao.model.training import TrainingState, memory_at, reproduction, train_network
from creative_nao.runtime import usable_cores

MAX_EPOCHS = 300_000
"""Where an trainer has learned enough, however often it goes on."""
LOOK_S = 0.4
"""Shortest time between two looks at what is learned so far."""
CURVE_POINTS = 240
MADE_BY = "taught in the explorer's page"


@dataclasses.dataclass(frozen=True, eq=False)
class TrainingProgress:
    """How far an trainer is.

    Attributes:
        phase: `idle`, `waiting` for others to finish, `learning`, `stopped`, `finished` or `failed`.
        n_epochs: Where it will stop.
        epoch: Epochs done.
        curve: Epoch and loss, shape (n, 2).
        memory: What it has learned so far, None before the first progress.
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


class Trainer:
    """A network and what it is to learn.

    Args:
        demonstrations: The basic actions.
        training: Closed-loop ratio and seed; the number of epochs is `learn`'s.
        concurrency_limit: Lets as many trainers of the server learn at a time as it has places.

    Attributes:
        progress: How far it is now; replaced as a whole, so any thread may read it.

    Raises:
        SettingsError: If the demonstrations cannot be learned.
    """

    def __init__(
        self, demonstrations: Demonstrations, training: TrainingSettings, concurrency_limit: threading.Semaphore
    ) -> None:
        self.demonstrations, self.training = demonstrations, training
        self.progress = TrainingProgress()
        self._network = NetworkSettings()
        n_codes = encoding_of(demonstrations, self._network).n_codes
        self._state = TrainingState.initial(self._network, n_codes, demonstrations.n_actions, training.seed)
        self._concurrency_limit = concurrency_limit
        self._stop = threading.Event()
        self._started = (0, 0.0)
        self._looked = 0.0

    def learn(self, n_epochs: int) -> None:
        """Begin, or go on, until `n_epochs` epochs are done altogether; returns at once.

        Raises:
            SettingsError: If it is at work already, or `n_epochs` are done or too many.
        """
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
            self._note(phase, n_epochs, failure)

    def _watch(self, training: TrainingSettings, _: TrainingState) -> None:
        if time.monotonic() - self._looked >= LOOK_S:
            self._note("learning", training.n_epochs)

    def _note(self, phase: str, n_epochs: int, failure: str = "") -> None:
        state = self._state
        memory = self.progress.memory
        if state.epoch and np.isfinite(state.best_loss):
            settings = dataclasses.replace(self.training, n_epochs=max(state.epoch, 1))
            memory = memory_at(self.demonstrations, self._network, settings, state, MADE_BY)
            memory = dataclasses.replace(memory, name="taught in this page")
        places = np.unique(np.linspace(0, max(state.epoch - 1, 0), CURVE_POINTS).astype(int))[: state.epoch]
        curve = np.stack([places + 1.0, state.loss_history[places]], axis=1)
        done, since = self._started
        pace = (state.epoch - done) / max(time.monotonic() - since, 1e-3)
        self.progress = TrainingProgress(phase, n_epochs, state.epoch, curve, memory, failure, pace)
        self._looked = time.monotonic()


PLACES = max(1, usable_cores() - 1)
"""How many learn at a time; the page keeps a core."""


class TrainingSession:
    """An trainer and what was made of it.

    Attributes:
        trainer: The network that learns.
        app_state: What the explorer's page shows of it, once it was asked for.
    """

    def __init__(self, trainer: Trainer) -> None:
        self.trainer = trainer
        self.app_state: Any = None
        self.holders = 0


class TrainingSessions:
    """All trainers; what no tab holds any more is stopped and forgotten."""

    def __init__(self) -> None:
        self.concurrency_limit = threading.Semaphore(PLACES)
        self._sessions: dict[str, TrainingSession] = {}

    def __len__(self) -> int:
        return len(self._sessions)

    def add(self, trainer: Trainer) -> str:
        """Take an trainer in, held once, and return its name."""
        key = secrets.token_urlsafe(12)
        self._sessions[key] = TrainingSession(trainer)
        self._sessions[key].holders = 1
        return key

    def hold(self, key: str) -> TrainingSession | None:
        """Hold an trainer for one more tab; None if there is no such."""
        session = self._sessions.get(key)
        if session is not None:
            session.holders += 1
        return session

    def session(self, key: str) -> TrainingSession | None:
        """Return an trainer's session without holding it."""
        return self._sessions.get(key)

    def release(self, key: str) -> None:
        """Hold it for one tab less; without any, it is stopped and forgotten."""
        session = self._sessions.get(key)
        if session is None:
            return
        session.holders -= 1
        if session.holders <= 0:
            session.trainer.stop()
            del self._sessions[key]


RATIOS = {0.0: "open loop", 0.5: "half closed", 1.0: "closed loop"}
EPOCHS = {10_000: "10,000 epochs", 30_000: "30,000 epochs", 60_000: "60,000 epochs", 100_000: "100,000 epochs"}
GROWTH = ((0.15, 16), (0.5, 24), (1.0, 40))
"""Share of the epochs done, and the points along each side of the map until then."""
LAST_RESOLUTION = 60
MAX_SEED = 999_999


class KeyframeSource(Protocol):
    """The tab whose demonstrations are trained."""

    closed: bool

    @property
    def keyframes(self) -> KeyframeSet:
        """The demonstrations as they are now."""
        ...


class TrainingPanel:
    """Trains one memory at a time for its tab."""

    def __init__(self, tab: KeyframeSource, app_state: AppState, sessions: TrainingSessions, taught: str) -> None:
        self.tab, self.app_state, self.sessions = tab, app_state, sessions
        self.name = taught if taught and sessions.hold(taught) else ""
        self._chart: PBMap | None = None
        self._drawn: Memory | None = None
        self._drawing = False
        self._shown: TrainingProgress | None = None

    @property
    def trainer(self) -> Trainer | None:
        """The network that learns for this tab, if one does or did."""
        session = self.sessions.session(self.name)
        return None if session is None else session.trainer

    def close(self) -> None:
        """Hold no trainer any more."""
        self.sessions.release(self.name)
        self.name = ""
        self._chart = self._drawn = self._shown = None

    def build(self) -> None:
        """Lay the panel out."""
        ui.label("Train a memory").classes("text-lg mt-4")
        with ui.row().classes("items-center gap-2"):
            self.ratio = (
                ui.select(RATIOS, value=0.5, label="Own prediction").props("dense options-dense").classes("w-32")
            )
            self.epochs = ui.select(EPOCHS, value=30_000, label="How long").props("dense options-dense").classes("w-36")
            self.seed = (
                ui.number("Seed", value=0, min=0, max=MAX_SEED, step=1, format="%d").props("dense").classes("w-20")
            )
        with ui.row().classes("items-center gap-2"):
            self.train = ui.button("Train", on_click=self._train).props("dense no-caps")
            self.stop = ui.button("Stop", on_click=self._stop).props("dense no-caps outline")
            self.go_on = ui.button("Go on", on_click=self._go_on).props("dense no-caps outline")
            self.explore = ui.button("Explore this memory", on_click=self._explore).props("dense no-caps")
            self.save = ui.button("Download memory", on_click=self._download).props("dense no-caps outline")
            ui.button("Download CSV", on_click=self._download_csv).props("dense no-caps outline")
        self.said = ui.label("").classes("cn-said").props("role=status aria-live=polite").mark("training")
        with ui.element("div").classes("cn-learning"):
            self.map = ui.html(grown_map(None), sanitize=False)  # numbers and fixed letters only
            self.loss = ui.html("", sanitize=False)
        self.verdict = ui.column().classes("gap-0")
        self.advice = ui.column().classes("gap-0")
        ui.timer(0.5, self._look)

    def keyframes_changed(self) -> None:
        """Let the button say whether the set can be taught, and what would make it better."""
        self.train.set_enabled(not shortcomings(self.tab.keyframes))
        self.advice.clear()
        with self.advice:
            for line in advice(self.tab.keyframes)[:4]:
                ui.label(f"Advice: {line}.").classes("text-sm")

    def _train(self) -> None:
        if self.trainer is not None and self.trainer.progress.busy:
            return
        found = shortcomings(self.tab.keyframes)
        if found:
            self.said.text = found[0]
            return
        try:
            seed = int(min(max(float(self.seed.value or 0), 0), MAX_SEED))
            training = TrainingSettings(closed_loop_ratio=float(self.ratio.value or 0.0), seed=seed)
            trainer = Trainer(self.tab.keyframes.demonstrations(), training, self.sessions.concurrency_limit)
            trainer.learn(int(self.epochs.value or 30_000))
        except (CreativeNaoError, ValueError) as error:
            self.said.text = f"Cannot be taught: {error}"
            return
        self.sessions.release(self.name)
        self.name = self.sessions.add(trainer)
        self._chart = self._drawn = self._shown = None
        self.map.content = grown_map(None)
        self.verdict.clear()
        ui.navigate.history.replace(f"/teach?taught={self.name}")

    def _stop(self) -> None:
        if self.trainer is not None:
            self.trainer.stop()

    def _go_on(self) -> None:
        trainer = self.trainer
        if trainer is None or trainer.progress.busy:
            return
        progress = trainer.progress
        further = (
            progress.n_epochs
            if progress.epoch < progress.n_epochs
            else progress.epoch + int(self.epochs.value or 30_000)
        )
        try:
            trainer.learn(further)
        except CreativeNaoError as error:
            ui.notify(str(error), type="negative")
        self.verdict.clear()

    async def _look(self) -> None:
        trainer = self.trainer
        progress = TrainingProgress() if trainer is None else trainer.progress
        for button, wanted in (
            (self.stop, progress.busy),
            (self.go_on, progress.epoch > 0 and not progress.busy and progress.phase != "failed"),
            (self.explore, progress.memory is not None and not progress.busy),
            (self.save, progress.memory is not None and not progress.busy),
        ):
            button.set_visibility(wanted)
        self.train.set_visibility(not progress.busy)
        if trainer is None or progress is self._shown:
            return
        self._shown = progress
        self.said.text = words(progress)
        self.loss.content = loss_svg(progress.curve, progress.n_epochs)
        if progress.memory is not None and progress.memory is not self._drawn and not self._drawing:
            await self._grow(progress, progress.memory)

    async def _grow(self, progress: TrainingProgress, memory: Memory) -> None:
        self._drawing = True
        try:
            share = progress.epoch / max(progress.n_epochs, 1)
            size = next((n for limit, n in GROWTH if share < limit), LAST_RESOLUTION)
            chart = await run.io_bound(pb_map, memory, size if progress.busy else LAST_RESOLUTION)
            ended = None if progress.busy else await run.io_bound(reproduction, memory)
        finally:
            self._drawing = False
        if chart is None or self.tab.closed:
            return
        self._chart, self._drawn = chart, memory
        self.map.content = grown_map(chart)
        if ended is not None:
            self._judge(memory.demonstrations, ended)

    def _judge(self, demonstrations: Demonstrations, distances: list[float]) -> None:
        threshold = Criteria().learned_threshold
        back = sum(one <= threshold for one in distances)
        self.verdict.clear()
        with self.verdict:
            ui.label(f"{back} of {len(distances)} demonstrations come back within {threshold:g} rad (DTW).")
            for place, (name, one) in enumerate(zip(demonstrations.names, distances, strict=True)):
                ui.label(f"{action_letter(place)} {spoken(name)}: {one:.1f}").classes("text-sm")

    async def _explore(self) -> None:
        session, name = self.sessions.session(self.name), self.name
        memory = None if session is None else session.trainer.progress.memory
        if session is None or memory is None:
            return
        session.app_state = await run.io_bound(taught_app_state, memory, self.app_state, name)
        if session.app_state is not None and not self.tab.closed:
            ui.navigate.to(f"/?taught={name}")

    async def _download(self) -> None:
        memory = None if self.trainer is None else self.trainer.progress.memory
        if memory is not None:
            made = await run.io_bound(memory_file, memory)
            if made is not None:
                ui.download.content(made, "taught.safetensors")

    async def _download_csv(self) -> None:
        made = await run.io_bound(csv_archive, self.tab.keyframes.demonstrations())
        if made is not None:
            ui.download.content(made, "demonstrations.zip")


def words(progress: TrainingProgress) -> str:
    """Return how far an trainer is, in words."""
    if progress.phase == "failed":
        return f"Training failed: {progress.failure}"
    if progress.phase == "waiting":
        return "Waiting for another training on this machine to end ..."
    if not len(progress.curve):
        return "Beginning ..."
    loss = f"loss {progress.curve[-1, 1]:.3g}"
    if progress.phase == "learning":
        left = (progress.n_epochs - progress.epoch) / max(progress.epochs_per_s, 1e-9)
        return f"Learning: epoch {progress.epoch:,} of {progress.n_epochs:,}, {loss}, about {left:.0f} s left"
    end = "Learned" if progress.phase == "finished" else "Stopped"
    return f"{end}: {progress.epoch:,} epochs, {loss}"


def memory_file(memory: Memory) -> bytes:
    """Return a memory as the bytes of its file."""
    with tempfile.TemporaryDirectory() as folder:
        return memory.save(Path(folder) / "taught.safetensors").read_bytes()


def csv_archive(demonstrations: Demonstrations) -> bytes:
    """Return demonstrations as a ZIP archive of CSV files that `creative-nao train --demonstrations` takes unpacked."""
    stream = io.BytesIO()
    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(save_demonstrations(folder, demonstrations).iterdir()):
            archive.write(path, f"demonstrations/{path.name}")
    return stream.getvalue()


RESOLUTION = 100
"""Points along each side of its map: a quarter of the time of the paper's, for a memory that may soon learn on."""


def taught_app_state(memory: Memory, shown: AppState, key: str) -> AppState:
    """Return an app_state of a taught memory with the robot and the favourites of another one.

    Args:
        memory: What was taught.
        shown: The app_state of this server.
        key: Name of the trainer in the `TrainingSessions`, for the page's address.
    """
    registry = MemoryRegistry([memory], RESOLUTION)
    registry.start()
    return dataclasses.replace(shown, registry=registry, agent_points=None, taught=key)
