"""The training part of the teaching page: train, watch the loss fall and the map grow, explore, download."""

from __future__ import annotations

import io
import tempfile
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

from nicegui import run, ui

from creative_nao.demonstrations import Demonstrations, save_demonstrations
from creative_nao.errors import CreativeNaoError
from creative_nao.explorer.apprentice import Apprentice, Look
from creative_nao.explorer.notebook_checks import advice, shortcomings
from creative_nao.explorer.page import Exhibit
from creative_nao.explorer.school import School
from creative_nao.explorer.taught import taught_exhibit
from creative_nao.explorer.teach_drawings import grown_map, loss_svg
from creative_nao.explorer.words import spoken
from creative_nao.measures import Criteria
from creative_nao.model import Memory, TrainingSettings
from creative_nao.model.campaign import reproduction
from creative_nao.pb_space import PBMap, pb_map
from creative_nao.pb_space.palette import action_letter

if TYPE_CHECKING:
    from creative_nao.explorer.teach_page import TeachTab

RATIOS = {0.0: "open loop", 0.5: "half closed", 1.0: "closed loop"}
EPOCHS = {10_000: "10,000 epochs", 30_000: "30,000 epochs", 60_000: "60,000 epochs", 100_000: "100,000 epochs"}
GROWTH = ((0.15, 16), (0.5, 24), (1.0, 40))
"""Share of the epochs done, and the points along each side of the map until then."""
LAST_RESOLUTION = 60
MAX_SEED = 999_999


class TrainingPanel:
    """Trains one memory at a time for its tab."""

    def __init__(self, tab: TeachTab, exhibit: Exhibit, school: School, taught: str) -> None:
        self.tab, self.exhibit, self.school = tab, exhibit, school
        self.name = taught if taught and school.hold(taught) else ""
        self._chart: PBMap | None = None
        self._drawn: Memory | None = None
        self._drawing = False
        self._shown: Look | None = None

    @property
    def apprentice(self) -> Apprentice | None:
        """The network that learns for this tab, if one does or did."""
        desk = self.school.desk(self.name)
        return None if desk is None else desk.apprentice

    def close(self) -> None:
        """Hold no apprentice any more."""
        self.school.let_go(self.name)
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

    def notebook_changed(self) -> None:
        """Let the button say whether the set can be taught, and what would make it better."""
        self.train.set_enabled(not shortcomings(self.tab.notebook))
        self.advice.clear()
        with self.advice:
            for line in advice(self.tab.notebook)[:4]:
                ui.label(f"Advice: {line}.").classes("text-sm")

    def _train(self) -> None:
        if self.apprentice is not None and self.apprentice.look.busy:
            return
        found = shortcomings(self.tab.notebook)
        if found:
            self.said.text = found[0]
            return
        try:
            seed = int(min(max(float(self.seed.value or 0), 0), MAX_SEED))
            training = TrainingSettings(closed_loop_ratio=float(self.ratio.value or 0.0), seed=seed)
            apprentice = Apprentice(self.tab.notebook.demonstrations(), training, self.school.turnstile)
            apprentice.learn(int(self.epochs.value or 30_000))
        except (CreativeNaoError, ValueError) as error:
            self.said.text = f"Cannot be taught: {error}"
            return
        self.school.let_go(self.name)
        self.name = self.school.enrol(apprentice)
        self._chart = self._drawn = self._shown = None
        self.map.content = grown_map(None)
        self.verdict.clear()
        ui.navigate.history.replace(f"/teach?taught={self.name}")

    def _stop(self) -> None:
        if self.apprentice is not None:
            self.apprentice.stop()

    def _go_on(self) -> None:
        apprentice = self.apprentice
        if apprentice is None or apprentice.look.busy:
            return
        look = apprentice.look
        further = look.n_epochs if look.epoch < look.n_epochs else look.epoch + int(self.epochs.value or 30_000)
        try:
            apprentice.learn(further)
        except CreativeNaoError as error:
            ui.notify(str(error), type="negative")
        self.verdict.clear()

    async def _look(self) -> None:
        apprentice = self.apprentice
        look = Look() if apprentice is None else apprentice.look
        for button, wanted in (
            (self.stop, look.busy),
            (self.go_on, look.epoch > 0 and not look.busy and look.phase != "failed"),
            (self.explore, look.memory is not None and not look.busy),
            (self.save, look.memory is not None and not look.busy),
        ):
            button.set_visibility(wanted)
        self.train.set_visibility(not look.busy)
        if apprentice is None or look is self._shown:
            return
        self._shown = look
        self.said.text = words(look)
        self.loss.content = loss_svg(look.curve, look.n_epochs)
        if look.memory is not None and look.memory is not self._drawn and not self._drawing:
            await self._grow(look, look.memory)

    async def _grow(self, look: Look, memory: Memory) -> None:
        self._drawing = True
        try:
            share = look.epoch / max(look.n_epochs, 1)
            size = next((n for limit, n in GROWTH if share < limit), LAST_RESOLUTION)
            chart = await run.io_bound(pb_map, memory, size if look.busy else LAST_RESOLUTION)
            ended = None if look.busy else await run.io_bound(reproduction, memory)
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
        desk, name = self.school.desk(self.name), self.name
        memory = None if desk is None else desk.apprentice.look.memory
        if desk is None or memory is None:
            return
        desk.exhibit = await run.io_bound(taught_exhibit, memory, self.exhibit, name)
        if desk.exhibit is not None and not self.tab.closed:
            ui.navigate.to(f"/?taught={name}")

    async def _download(self) -> None:
        memory = None if self.apprentice is None else self.apprentice.look.memory
        if memory is not None:
            made = await run.io_bound(memory_file, memory)
            if made is not None:
                ui.download.content(made, "taught.safetensors")

    async def _download_csv(self) -> None:
        made = await run.io_bound(csv_archive, self.tab.notebook.demonstrations())
        if made is not None:
            ui.download.content(made, "demonstrations.zip")


def words(look: Look) -> str:
    """Return how far an apprentice is, in words."""
    if look.phase == "failed":
        return f"Training failed: {look.failure}"
    if look.phase == "waiting":
        return "Waiting for another training on this machine to end ..."
    if not len(look.curve):
        return "Beginning ..."
    loss = f"loss {look.curve[-1, 1]:.3g}"
    if look.phase == "learning":
        left = (look.n_epochs - look.epoch) / max(look.epochs_per_s, 1e-9)
        return f"Learning: epoch {look.epoch:,} of {look.n_epochs:,}, {loss}, about {left:.0f} s left"
    end = "Learned" if look.phase == "finished" else "Stopped"
    return f"{end}: {look.epoch:,} epochs, {loss}"


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
