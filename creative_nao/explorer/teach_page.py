"""The teaching page of one tab: demonstrations by sliders and keys, a memory trained from them, a map that grows."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from nicegui import run, ui

from creative_nao.demonstrations.keyframes import DT_S
from creative_nao.errors import CreativeNaoError
from creative_nao.explorer.body import angles_message
from creative_nao.explorer.notebook import MAX_TEXT, Draft, Notebook, boxing
from creative_nao.explorer.notebook_checks import fault, shortcomings
from creative_nao.explorer.page import Exhibit
from creative_nao.explorer.robot_view import player_controls, robot_scene
from creative_nao.explorer.school import School
from creative_nao.explorer.teach_drawings import draft_svg
from creative_nao.explorer.teach_editor import Editor
from creative_nao.explorer.teach_training import TrainingPanel

STATIC = Path(__file__).with_name("static")
MAX_UNDO = 50
_KEPT_AS = "creative-nao-notebook"


class TeachTab:
    """One tab that teaches. The notebook lives here and in the browser's own store of the tab, nowhere else.

    Args:
        exhibit: What this server shows; its robot is taught.
        school: Where the apprentices of this server learn.
        taught: Name of an apprentice to go on with, or empty.
    """

    def __init__(self, exhibit: Exhibit, school: School, taught: str = "") -> None:
        self.stage = exhibit.stage
        self.notebook = boxing()
        self.place = 0
        """Which draft is shown."""
        self.key = 0
        """Which of its keys."""
        self._trail: list[tuple[Notebook, int, int]] = []
        self._merged: object = None
        self.training = TrainingPanel(self, exhibit, school, taught)
        self.editor = Editor(self)
        self.closed = False
        self._opened = False

    @property
    def draft(self) -> Draft:
        """The draft that is shown."""
        return self.notebook.drafts[self.place]

    def close(self) -> None:
        """Let go of what the tab holds; an apprentice that no other tab holds is stopped."""
        self.closed = True
        self._trail.clear()
        self.training.close()

    def build(self) -> None:
        """Lay the page out."""
        ui.page_title("Teach the robot")
        ui.add_css(
            (STATIC / "page.css").read_text(encoding="utf-8") + (STATIC / "teach.css").read_text(encoding="utf-8")
        )
        ui.add_body_html(f"<script>{(STATIC / 'sliders.js').read_text(encoding='utf-8')}</script>")
        dark = ui.dark_mode(None)
        with ui.row().classes("w-full items-center justify-between"):
            ui.label("Teach the robot").classes("text-lg")
            with ui.row().classes("items-center"):
                ui.link("Explore", "/")
                ui.button("Dark / light", on_click=lambda: dark.set_value(not dark.value)).props("flat no-caps dense")
        with ui.element("div").classes("cn-page"):
            with ui.element("div").classes("cn-at-map"):
                self.editor.build()
            with ui.element("div").classes("cn-at-robot"):
                self._build_robot()
            with ui.element("div").classes("cn-at-tools"):
                self.training.build()
        self.settle()

    def _build_robot(self) -> None:
        self.robot = robot_scene(
            self.stage.body, self.pose, "The robot in the posture of the key, or performing the demonstration"
        )
        with ui.row().classes("w-full items-center gap-2"):
            ui.button("Preview", on_click=self.preview).props("dense no-caps")
            ui.button("Preview in physics", on_click=self.perform).props("dense no-caps outline")
            player_controls()
        self.status = ui.label("").classes("cn-status").props("role=status aria-live=polite").mark("status")
        self.curves = ui.html("", sanitize=False).classes("w-full")  # numbers and fixed names only

    async def open(self) -> None:
        """Take up the notebook that the browser kept for this tab."""
        kept = await ui.run_javascript(f"sessionStorage.getItem('{_KEPT_AS}')", timeout=20)
        self._opened = True  # only now may what the browser keeps be replaced
        if not kept or self.closed:
            return
        try:
            self.notebook = Notebook.from_text(kept)
        except CreativeNaoError as error:
            ui.notify(f"The demonstrations kept by this tab cannot be read: {error}", type="negative")
        self.place = self.key = 0
        self.settle()

    def change(
        self, notebook: Notebook, place: int | None = None, key: int | None = None, merged: object = None
    ) -> None:
        """Take up a changed notebook; steps with the same `merged` are undone together."""
        if merged is None or merged != self._merged:
            self._trail = [*self._trail, (self.notebook, self.place, self.key)][-MAX_UNDO:]
        self._merged = merged
        self.notebook = notebook
        self.place = min(self.place if place is None else place, len(notebook.drafts) - 1)
        self.key = min(self.key if key is None else key, len(self.draft.keys) - 1)

    def change_draft(self, draft: Draft, key: int | None = None, merged: object = None) -> None:
        """Take up a change of the draft that is shown."""
        self.change(self.notebook.with_draft(self.place, draft), None, key, merged)

    def undo(self) -> None:
        """Go one step back."""
        if self._trail:
            self.notebook, self.place, self.key = self._trail.pop()
            self._merged = None
            self.settle()

    def settle(self) -> None:
        """Show everything anew after a change, and let the browser keep the notebook."""
        self.editor.refresh()
        self.pose()
        self.tell()
        self.curves.content = draft_svg(self.draft, self.key)
        self.training.notebook_changed()
        text = self.notebook.to_text()
        if self._opened and len(text) <= MAX_TEXT:
            ui.run_javascript(f"sessionStorage.setItem('{_KEPT_AS}', {json.dumps(text)})")

    def pose(self) -> None:
        """Let the robot take the posture of the key that is shown."""
        self.robot.perform(angles_message(np.array([self.draft.keys[self.key].posture]), DT_S))

    def preview(self) -> None:
        """Let the robot play the demonstration."""
        self.robot.perform(angles_message(self.draft.trajectory(), DT_S))
        ui.run_javascript("window.robotPlayer.playing = true")

    async def perform(self) -> None:
        """Let the robot perform the demonstration in physics, before the bag."""
        done = await run.io_bound(self.stage.perform, self.draft.trajectory(), DT_S)
        if done is not None and not self.closed:
            self.robot.perform(done[0])
            self.status.text = f"In physics: {done[1]}."

    def tell(self) -> None:
        """Say whether what is shown, and the whole set, can be taught."""
        found = fault(self.draft) or next(iter(shortcomings(self.notebook)), None)
        count = len(self.notebook.drafts)
        self.status.text = found or f"{count} demonstrations, all fit to be taught."
        self.status.classes(add="cn-fault" if found else "", remove="" if found else "cn-fault")
