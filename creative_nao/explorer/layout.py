"""Where things stand on the page: one memory with its robot beside the map, or two memories side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nicegui import ui

from creative_nao.explorer import panels

if TYPE_CHECKING:
    from creative_nao.explorer.page import Tab


def alone(tab: Tab) -> None:
    """Lay one memory out: map left, robot and curves right, on a phone one below the other."""
    (side,) = tab.sides
    with ui.element("div").classes("cn-page"):
        with _area("map"):
            side.map.build(tab)
        with _area("robot"):
            side.build_robot(tab.exhibit.stage)
            tab.build_player()
            side.build_told()
            panels.favourites(tab)
        with _area("tools"):
            tab.build_tools()


def twin(tab: Tab) -> None:
    """Lay two memories out in two columns, on a phone one below the other; one player drives both robots."""
    with ui.element("div").classes("cn-page cn-twin"):
        for number, side in enumerate(tab.sides, start=1):
            with _area("map", number):
                ui.label(f"Memory {side.subject.name}").classes("cn-name-of-side")
                side.map.build(tab)
        for number, side in enumerate(tab.sides, start=1):
            with _area("robot", number):
                side.build_robot(tab.exhibit.stage)
        with _area("player"):
            tab.build_player()
        for number, side in enumerate(tab.sides, start=1):
            with _area("told", number):
                ui.label(f"Memory {side.subject.name}").classes("cn-name-of-side")
                side.build_told()
        with _area("tools"):
            tab.build_tools()
        with _area("keep"):
            panels.favourites(tab)


def _area(name: str, number: int = 1) -> ui.element:
    return ui.element("div").classes(f"cn-at-{name}{number if number > 1 else ''}")
