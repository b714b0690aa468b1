"""The teaching page of one tab: demonstrations by sliders and keys, and the memory trained from them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable

import numpy as np
from nicegui import events, run, ui

from creative_nao.demonstrations.keyframes import DT_S
from creative_nao.errors import CreativeNaoError
from creative_nao.explorer.keyframe_editor import (
    MAX_DRAFTS,
    MAX_DURATION_S,
    MAX_TEXT,
    Draft,
    KeyframeSet,
    blank,
    boxing,
)
from creative_nao.explorer.markup import draft_svg
from creative_nao.explorer.memory_service import spoken
from creative_nao.explorer.physics_service import STATIC, angles_message, player_controls, robot_scene
from creative_nao.explorer.tab import AppState
from creative_nao.explorer.teach_training import TrainingPanel, TrainingSessions
from creative_nao.joints import JOINTS, limits
from creative_nao.maps.figure_style import action_colour, action_letter

MAX_UNDO = 50
_ARMS = (("Left arm", (4, 5, 6, 7)), ("Right arm", (0, 1, 2, 3)))
_PARTS = ("Shoulder pitch", "Shoulder roll", "Elbow yaw", "Elbow roll")
_KEPT_AS = "creative-nao-keyframes"


class TeachTab:
    """One tab that teaches. The keyframes live here and in the browser's own store of the tab, nowhere else."""

    def __init__(self, app_state: AppState, sessions: TrainingSessions, taught: str = "") -> None:
        self.physics_service = app_state.physics_service
        self.keyframes = boxing()
        self.place = self.key = 0  # which draft is shown, and which of its keys
        self.training = TrainingPanel(lambda: self.keyframes, app_state, sessions, taught)
        self._sliders: dict[int, ui.slider] = {}
        self._figures: dict[int, ui.label] = {}
        self._trail: list[tuple[KeyframeSet, int, int]] = []
        self._merged: object = None
        self._closed = self._opened = False

    @property
    def draft(self) -> Draft:
        """The draft that is shown."""
        return self.keyframes.drafts[self.place]

    def close(self) -> None:
        """Drop what the tab holds; a trainer that no other tab holds is stopped."""
        self._closed = True
        self._trail.clear()
        self.training.close()

    def build(self) -> None:
        """Lay the page out."""
        ui.page_title("Teach the robot")
        ui.add_css("".join((STATIC / name).read_text(encoding="utf-8") for name in ("page.css", "teach.css")))
        ui.add_body_html(f"<script>{(STATIC / 'sliders.js').read_text(encoding='utf-8')}</script>")
        dark = ui.dark_mode(None)
        with ui.row().classes("w-full items-center justify-between"):
            ui.label("Teach the robot").classes("text-lg")
            with ui.row().classes("items-center"):
                ui.link("Explore", "/")
                ui.button("Dark / light", on_click=lambda: dark.set_value(not dark.value)).props("flat no-caps dense")
        with ui.element("div").classes("cn-page"):
            with ui.element("div").classes("cn-at-map"):
                self._build_editor()
            with ui.element("div").classes("cn-at-robot"):
                label = "The robot in the posture of the key, or performing the demonstration"
                self.robot = robot_scene(self.physics_service.robot, self.pose, label)
                with ui.row().classes("w-full items-center gap-2"):
                    ui.button("Preview", on_click=self.preview).props("dense no-caps")
                    ui.button("Preview in physics", on_click=self.perform).props("dense no-caps outline")
                    player_controls()
                self.status = ui.label("").classes("cn-status").props("role=status aria-live=polite").mark("status")
                self.curves = ui.html("", sanitize=False).classes("w-full")  # numbers and fixed names only
            with ui.element("div").classes("cn-at-tools"):
                self.training.build()
        self.refresh()

    def _build_editor(self) -> None:
        with ui.row().classes("items-center gap-2"):
            _button("Boxing set", lambda: self._start(boxing()))
            _button("Empty set", lambda: self._start(KeyframeSet((blank(),))))
            _button("Add", self._add)
            _button("Add mirror image", self._mirror)
            _button("Remove", self._remove)
            _button("Undo", self.undo)
        self.list = ui.row().classes("gap-1").props('role=group aria-label="Demonstrations"')
        self.name = ui.input("Name of the demonstration").props("dense maxlength=24").classes("w-full")
        self.name.on("change", self._rename)
        with ui.row().classes("items-center gap-2"):
            _button("Earlier key", lambda: self._choose(self.key - 1))
            _button("Later key", lambda: self._choose(self.key + 1))
            self.time = ui.number("Reached at [s]", min=0, max=MAX_DURATION_S, step=0.05, format="%.2f")
            self.time.props("dense").classes("w-28")
            self.time.on("change", self._retime)
            _button("Add key", self._add_key)
            _button("Remove key", lambda: self._try(lambda: self.change_draft(self.draft.without_key(self.key))))
        self.timeline = ui.element("div").classes("cn-timeline").props('role=group aria-label="Keys over time"')
        low, high = limits()
        with ui.element("div").classes("cn-arms"):
            for arm, joints in _ARMS:
                with ui.column().classes("gap-0"):
                    ui.label(arm).classes("font-bold")
                    for joint, part in zip(joints, _PARTS, strict=True):
                        with ui.row().classes("w-full justify-between no-wrap"):
                            ui.label(part).classes("text-sm")
                            self._figures[joint] = ui.label("").classes("text-sm cn-figure")
                        slider = self._sliders[joint] = ui.slider(
                            min=float(low[joint]), max=float(high[joint]), step=0.01, value=float(low[joint])
                        )
                        slider.props(f'dense aria-label="{JOINTS[joint]}"').classes("cn-slider")
                        slider.on("update:model-value", self._drag(joint), throttle=0.05)
                        slider.on("change", self.refresh)

    def _refresh_editor(self) -> None:
        self.list.clear()
        with self.list:
            for place, draft in enumerate(self.keyframes.drafts):
                chosen = place == self.place
                button = ui.button(
                    f"{action_letter(place)} {spoken(draft.name)}{' - has a fault' if draft.fault() else ''}"
                )
                button.on_click(lambda _, place=place: self._show(place)).classes("cn-draft")
                button.props(
                    f"dense no-caps {'unelevated' if chosen else 'outline'} aria-pressed={str(chosen).lower()}"
                )
                button.style(f"border-left: 6px solid {action_colour(place)}")
        self.timeline.clear()
        with self.timeline:
            for k, key in enumerate(self.draft.keys):
                chosen = k == self.key
                handle = ui.element("button").classes("cn-key-handle" + (" cn-chosen" if chosen else ""))
                handle.style(f"left: {100 * key.time_s / self.draft.duration_s:.2f}%")
                handle.on("click", lambda _, k=k: self._choose(k))
                handle.props(f'type=button aria-label="Key at {key.time_s:.2f} s" aria-pressed={str(chosen).lower()}')
        self.name.value = self.draft.name
        key = self.draft.keys[self.key]
        self.time.value = key.time_s
        for joint, slider in self._sliders.items():
            slider.value = round(key.posture[joint], 4)
            self._show_angle(joint, key.posture[joint])

    def _show_angle(self, joint: int, angle: float) -> None:
        self._figures[joint].text = f"{angle:.2f} rad, {math.degrees(angle):.0f}°"

    def _drag(self, joint: int) -> Callable[[events.GenericEventArguments], None]:
        def dragged(event: events.GenericEventArguments) -> None:
            value = event.args
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                return
            self.change_draft(self.draft.posed(self.key, joint, value), merged=(self.place, self.key, joint))
            self._show_angle(joint, self.draft.keys[self.key].posture[joint])
            self.pose()
            self._describe()

        return dragged

    def _try(self, change: Callable[[], None]) -> None:
        """Change something, or say in one line why not."""
        try:
            change()
        except CreativeNaoError as error:
            ui.notify(str(error), type="negative")
        self.refresh()

    def _show(self, place: int) -> None:
        self.place, self.key = place, 0
        self.refresh()
        self.preview()

    def _choose(self, key: int) -> None:
        self.key = min(max(key, 0), len(self.draft.keys) - 1)
        self.refresh()

    def _start(self, keyframes: KeyframeSet) -> None:
        self._try(lambda: self.change(keyframes, 0, 0))

    def _add(self) -> None:
        n = len(self.keyframes.drafts)
        name = self.keyframes.free_name("my_move" if n < MAX_DRAFTS else "one_more")
        self._try(lambda: self.change(self.keyframes.with_draft(n, blank(name)), n, 1))

    def _mirror(self) -> None:
        n, name = len(self.keyframes.drafts), self.draft.name
        other = name.replace("left", "right") if "left" in name else name.replace("right", "left")
        name = self.keyframes.free_name(f"{name[:17]}_mirror" if other == name else other[:24])
        self._try(lambda: self.change(self.keyframes.with_draft(n, self.draft.mirrored(name)), n, 0))

    def _remove(self) -> None:
        if len(self.keyframes.drafts) == 1:
            ui.notify("One demonstration has to stay; start anew with the empty set.")
            return
        others = tuple(draft for draft in self.keyframes.drafts if draft is not self.draft)
        self._try(lambda: self.change(KeyframeSet(others), max(self.place - 1, 0), 0))

    def _rename(self, event: events.GenericEventArguments) -> None:
        name = str(event.args).strip().replace(" ", "_")
        if name != self.draft.name:
            self._try(lambda: self.change_draft(Draft(name, self.draft.keys)))

    def _retime(self, event: events.GenericEventArguments) -> None:
        try:
            time_s = float(event.args)
        except (TypeError, ValueError):
            self.refresh()
            return
        self._try(lambda: self.change_draft(self.draft.at_time(self.key, time_s)))

    def _add_key(self) -> None:
        keys, here = self.draft.keys, self.draft.keys[self.key].time_s
        time_s = here + 0.5 if self.key == len(keys) - 1 else (here + keys[self.key + 1].time_s) / 2
        self._try(lambda: self.change_draft(*self.draft.with_key(time_s)))

    async def open(self) -> None:
        """Take up the keyframes that the browser kept for this tab."""
        kept = await ui.run_javascript(f"sessionStorage.getItem('{_KEPT_AS}')", timeout=20)
        self._opened = True  # only now may what the browser keeps be replaced
        if not kept or self._closed:
            return
        try:
            self.keyframes = KeyframeSet.from_text(kept)
        except CreativeNaoError as error:
            ui.notify(f"The demonstrations kept by this tab cannot be read: {error}", type="negative")
        self.place = self.key = 0
        self.refresh()

    def change(
        self, keyframes: KeyframeSet, place: int | None = None, key: int | None = None, merged: object = None
    ) -> None:
        """Take up changed keyframes; steps with the same `merged` are undone together."""
        if merged is None or merged != self._merged:
            self._trail = [*self._trail, (self.keyframes, self.place, self.key)][-MAX_UNDO:]
        self._merged = merged
        self.keyframes = keyframes
        self.place = min(self.place if place is None else place, len(keyframes.drafts) - 1)
        self.key = min(self.key if key is None else key, len(self.draft.keys) - 1)

    def change_draft(self, draft: Draft, key: int | None = None, merged: object = None) -> None:
        """Take up a change of the draft that is shown."""
        self.change(self.keyframes.with_draft(self.place, draft), None, key, merged)

    def undo(self) -> None:
        """Go one step back."""
        if self._trail:
            self.keyframes, self.place, self.key = self._trail.pop()
            self._merged = None
            self.refresh()

    def refresh(self) -> None:
        """Show everything anew after a change, and let the browser keep the keyframes."""
        self._refresh_editor()
        self.pose()
        self._describe()
        self.curves.content = draft_svg(self.draft, self.key)
        self.training.keyframes_changed()
        text = self.keyframes.to_text()
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
        performed = await run.io_bound(self.physics_service.perform, self.draft.trajectory(), DT_S)
        if performed is not None and not self._closed:
            self.robot.perform(performed[0])
            self.status.text = f"In physics: {performed[1]}."

    def _describe(self) -> None:
        """Say whether what is shown, and the whole set, can be taught."""
        line = self.draft.fault() or next(iter(self.keyframes.shortcomings()), "")
        self.status.text = line or f"{len(self.keyframes.drafts)} demonstrations, all fit to be taught."
        self.status.classes(add="cn-fault" if line else "", remove="" if line else "cn-fault")


def _button(text: str, action: Callable[[], object]) -> None:
    ui.button(text, on_click=action).props("dense no-caps outline")
