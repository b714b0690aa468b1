"""The training part of the teaching page: networks that train in threads, watched and stopped from tabs."""

from __future__ import annotations

import dataclasses
import secrets
import shutil
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from nicegui import run, ui

from creative_nao import maps
from creative_nao.demonstrations import Demonstrations, save_demonstrations
from creative_nao.errors import CreativeNaoError, SettingsError
from creative_nao.explorer.keyframe_editor import KeyframeSet
from creative_nao.explorer.markup import grown_map, loss_svg
from creative_nao.explorer.memory_service import spoken
from creative_nao.explorer.registry import MemoryRegistry
from creative_nao.explorer.tab import AppState
from creative_nao.maps.figure_style import action_letter
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
        loss = f"loss {self.curve[-1, 1]:.3g}"
        if self.phase == "learning":
            left = (self.n_epochs - self.epoch) / max(self.epochs_per_s, 1e-9)
            return f"Learning: epoch {self.epoch:,} of {self.n_epochs:,}, {loss}, about {left:.0f} s left"
        return f"{'Learned' if self.phase == 'finished' else 'Stopped'}: {self.epoch:,} epochs, {loss}"


class Trainer:
    """A training in a thread, to be stopped and gone on with; SettingsError if it cannot be learned."""

    def __init__(
        self, demonstrations: Demonstrations, training: TrainingSettings, concurrency_limit: threading.Semaphore
    ) -> None:
        self.demonstrations, self.training = demonstrations, training
        self.progress = TrainingProgress()  # replaced as a whole, so any thread may read it
        self.holders = 0  # tabs that show it
        self.app_state: AppState | None = None  # what the explorer's page shows of it, once it was asked for
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


class TrainingSessions:
    """All trainers by names that nobody can guess; one that no tab holds any more is stopped and forgotten."""

    def __init__(self) -> None:
        self.concurrency_limit = threading.Semaphore(PLACES)
        self._trainers: dict[str, Trainer] = {}

    def add(self, trainer: Trainer) -> str:
        """Keep a trainer, held once, and return its name."""
        key = secrets.token_urlsafe(12)
        self._trainers[key] = trainer
        trainer.holders = 1
        return key

    def get(self, key: str) -> Trainer | None:
        """Return a trainer without holding it; None if there is no such."""
        return self._trainers.get(key)

    def hold(self, key: str) -> Trainer | None:
        """Hold a trainer for one more tab; None if there is no such."""
        if (trainer := self.get(key)) is not None:
            trainer.holders += 1
        return trainer

    def release(self, key: str) -> None:
        """Hold it for one tab less; without any, it is stopped and forgotten."""
        if (trainer := self.get(key)) is not None:
            trainer.holders -= 1
            if trainer.holders <= 0:
                trainer.stop()
                del self._trainers[key]


RATIOS = {0.0: "open loop", 0.5: "half closed", 1.0: "closed loop"}
EPOCHS = {n: f"{n:,} epochs" for n in (10_000, 30_000, 60_000, 100_000)}
GROWTH = ((0.15, 16), (0.5, 24), (1.0, 40))
"""Share of the epochs done, and the points along each side of the map until then."""
LAST_RESOLUTION = 60
EXPLORED_RESOLUTION = 100
"""Of the map of a memory that is explored: a quarter of the time of the paper's, for one that may soon learn on."""
MAX_SEED = 999_999


class TrainingPanel:
    """Trains one memory at a time for its tab; `taught` names the trainer to go on with, or is empty."""

    def __init__(
        self, keyframes: Callable[[], KeyframeSet], app_state: AppState, sessions: TrainingSessions, taught: str
    ) -> None:
        self._keyframes, self._app_state, self._sessions = keyframes, app_state, sessions
        self.name = taught if taught and sessions.hold(taught) else ""
        self._closed = self._drawing = False
        self._drawn: Memory | None = None
        self._shown: TrainingProgress | None = None

    @property
    def trainer(self) -> Trainer | None:
        """The trainer of this tab, if there is or was one."""
        return self._sessions.get(self.name)

    def close(self) -> None:
        """Hold no trainer any more."""
        self._closed = True
        self._sessions.release(self.name)
        self.name = ""
        self._drawn = self._shown = None

    def build(self) -> None:
        """Lay the panel out."""
        ui.label("Train a memory").classes("text-lg mt-4")
        with ui.row().classes("items-center gap-2"):
            self.ratio = ui.select(RATIOS, value=0.5, label="Own prediction").classes("w-32")
            self.epochs = ui.select(EPOCHS, value=30_000, label="How long").classes("w-36")
            self.seed = ui.number("Seed", value=0, min=0, max=MAX_SEED, step=1, format="%d").classes("w-20")
            for field in (self.ratio, self.epochs, self.seed):
                field.props("dense options-dense")
        with ui.row().classes("items-center gap-2"):
            self.train = ui.button("Train", on_click=self._train).props("dense no-caps")
            self.stop = ui.button("Stop", on_click=lambda: self.trainer and self.trainer.stop())
            self.stop.props("dense no-caps outline")
            self.go_on = ui.button("Go on", on_click=self._go_on).props("dense no-caps outline")
            self.explore = ui.button("Explore this memory", on_click=self._explore).props("dense no-caps")
            self.save = ui.button("Download memory", on_click=self._download).props("dense no-caps outline")
            ui.button("Download CSV", on_click=self._download_csv).props("dense no-caps outline")
        self.status = ui.label("").classes("cn-training").props("role=status aria-live=polite").mark("training")
        with ui.element("div").classes("cn-learning"):
            self.map = ui.html(grown_map(None), sanitize=False)  # numbers and fixed letters only
            self.loss = ui.html("", sanitize=False)
        self.result = ui.column().classes("gap-0")
        self.advice = ui.column().classes("gap-0")
        ui.timer(0.5, self._refresh)

    def keyframes_changed(self) -> None:
        """Let the button say whether the set can be taught, and what would make it better."""
        self.train.set_enabled(not self._keyframes().shortcomings())
        self.advice.clear()
        with self.advice:
            for line in self._keyframes().advice()[:4]:
                ui.label(f"Advice: {line}.").classes("text-sm")

    def _train(self) -> None:
        if self.trainer is not None and self.trainer.progress.busy:
            return
        if faults := self._keyframes().shortcomings():
            self.status.text = faults[0]
            return
        try:
            seed = int(min(max(float(self.seed.value or 0), 0), MAX_SEED))
            training = TrainingSettings(closed_loop_ratio=float(self.ratio.value or 0.0), seed=seed)
            trainer = Trainer(self._keyframes().demonstrations(), training, self._sessions.concurrency_limit)
            trainer.learn(int(self.epochs.value or 30_000))
        except (CreativeNaoError, ValueError) as error:
            self.status.text = f"Cannot be taught: {error}"
            return
        self._sessions.release(self.name)
        self.name = self._sessions.add(trainer)
        self._drawn = self._shown = None
        self.map.content = grown_map(None)
        self.result.clear()
        ui.navigate.history.replace(f"/teach?taught={self.name}")

    def _go_on(self) -> None:
        trainer = self.trainer
        if trainer is None or trainer.progress.busy:
            return
        epoch, n_epochs = trainer.progress.epoch, trainer.progress.n_epochs
        try:
            trainer.learn(n_epochs if epoch < n_epochs else epoch + int(self.epochs.value or 30_000))
        except CreativeNaoError as error:
            ui.notify(str(error), type="negative")
        self.result.clear()

    async def _refresh(self) -> None:
        trainer = self.trainer
        progress = TrainingProgress() if trainer is None else trainer.progress
        learned = progress.memory is not None and not progress.busy
        self.train.set_visibility(not progress.busy)
        self.stop.set_visibility(progress.busy)
        self.go_on.set_visibility(progress.epoch > 0 and not progress.busy and progress.phase != "failed")
        self.explore.set_visibility(learned)
        self.save.set_visibility(learned)
        if trainer is None or progress is self._shown:
            return
        self._shown = progress
        self.status.text = str(progress)
        self.loss.content = loss_svg(progress.curve, progress.n_epochs)
        if progress.memory is not None and progress.memory is not self._drawn and not self._drawing:
            await self._draw(progress, progress.memory)

    async def _draw(self, progress: TrainingProgress, memory: Memory) -> None:
        """Draw the map of what is learned so far and, at the end, say which demonstrations come back."""
        self._drawing = True
        try:
            share = progress.epoch / max(progress.n_epochs, 1)
            size = next((n for limit, n in GROWTH if share < limit), LAST_RESOLUTION)
            pb_map = await run.io_bound(maps.pb_map, memory, size if progress.busy else LAST_RESOLUTION)
            distances = None if progress.busy else await run.io_bound(reproduction, memory)
        finally:
            self._drawing = False
        if pb_map is None or self._closed:
            return
        self._drawn = memory
        self.map.content = grown_map(pb_map)
        if distances is None:
            return
        threshold = Criteria().learned_threshold
        back = sum(distance <= threshold for distance in distances)
        self.result.clear()
        with self.result:
            ui.label(f"{back} of {len(distances)} demonstrations come back within {threshold:g} rad (DTW).")
            for place, (name, distance) in enumerate(zip(memory.demonstrations.names, distances, strict=True)):
                ui.label(f"{action_letter(place)} {spoken(name)}: {distance:.1f}").classes("text-sm")

    async def _explore(self) -> None:
        trainer, name = self.trainer, self.name
        memory = None if trainer is None else trainer.progress.memory
        if trainer is None or memory is None:
            return
        registry = await run.io_bound(MemoryRegistry, [memory], EXPLORED_RESOLUTION)
        if registry is not None and not self._closed:
            registry.start()
            trainer.app_state = dataclasses.replace(self._app_state, registry=registry, agent_points=None, taught=name)
            ui.navigate.to(f"/?taught={name}")

    async def _download(self) -> None:
        if self.trainer is not None and (memory := self.trainer.progress.memory) is not None:
            with tempfile.TemporaryDirectory() as folder:
                path = await run.io_bound(memory.save, Path(folder) / "taught.safetensors")
                if path is not None:
                    ui.download.content(path.read_bytes(), path.name)

    async def _download_csv(self) -> None:
        """Offer a ZIP archive of CSV files that `creative-nao train --demonstrations` takes unpacked."""
        demonstrations = self._keyframes().demonstrations()
        with tempfile.TemporaryDirectory() as folder:
            await run.io_bound(save_demonstrations, Path(folder) / "demonstrations", demonstrations)
            archive = await run.io_bound(shutil.make_archive, f"{folder}/made", "zip", folder, "demonstrations")
            if archive is not None:
                ui.download.content(Path(archive).read_bytes(), "demonstrations.zip")
