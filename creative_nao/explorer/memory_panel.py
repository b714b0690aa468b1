"""One memory in a tab: its map, its robot, and what is told of the movement."""

from __future__ import annotations

from typing import Any

from nicegui import run, ui

from creative_nao.explorer.map_pane import MapPane
from creative_nao.explorer.memory_service import Recall, curves_svg, describe, strip_html
from creative_nao.explorer.physics_service import PhysicsService, angles_message, robot_scene
from creative_nao.explorer.registry import LoadedMemory


class MemoryPanel:
    """What a tab shows of one memory.

    Args:
        loaded: The memory.

    Attributes:
        recall: The movement shown.
    """

    def __init__(self, loaded: LoadedMemory) -> None:
        self.loaded = loaded
        self.map = MapPane(loaded)
        self.recall: Recall | None = None
        self._movement: tuple[dict[str, Any], dict[str, Any] | None] | None = None
        self._ghostly = True

    def build_robot(self, physics_service: PhysicsService) -> None:
        """Lay the robot out."""
        label = f"The robot performing the movement of memory {self.loaded.name}"
        self.robot = robot_scene(physics_service.robot, self.replay, label)

    def build_told(self) -> None:
        """Lay out what is told of the movement in words and curves."""
        self.status = ui.label("The robot remembers ...").classes("cn-status")
        self.status.props("role=status aria-live=polite").mark("status")
        self.curves = ui.html("", sanitize=False).classes("w-full")  # numbers and fixed names only

    def present(self, recall: Recall, digits: int = 3) -> None:
        """Show a movement that has been made or recognised; its PB is told with so many decimals."""
        memory = self.loaded.service.memory
        basic = memory.demonstrations.trajectories[recall.nearest]
        self.recall = recall
        self._movement = angles_message(recall.trajectory, memory.dt_s), angles_message(basic, memory.dt_s)
        self.replay()
        self.status.text = describe(recall, self.loaded.service, digits)
        self.curves.content = curves_svg(recall, self.loaded.service) + strip_html(recall, self.loaded.service)

    async def perform(self, physics_service: PhysicsService) -> None:
        """Let the simulated robot perform the movement shown, and tell what its body made of it."""
        recall = self.recall
        if recall is None:
            return
        dt_s = self.loaded.service.memory.dt_s
        performed = await run.io_bound(physics_service.perform, recall.trajectory, dt_s)
        if performed is not None and recall is self.recall:
            self._movement = performed[0], None
            self.replay()
            self.status.text = f"{self.status.text}; {performed[1]}"

    def ghost(self, seen: bool) -> None:
        """Show or hide the nearest basic action."""
        self._ghostly = seen
        self.replay()

    def replay(self) -> None:
        """Let the browser play the movement again."""
        if self._movement is not None:
            movement, ghost = self._movement
            self.robot.perform(movement, ghost if self._ghostly else None)
