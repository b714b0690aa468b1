"""Two memories side by side: one PB point, two maps, two robots, one clock."""

import json

import numpy as np
import pytest
from visiting import Server

from creative_nao.cli import main
from creative_nao.errors import NotFoundError
from creative_nao.explorer.registry import MemoryRegistry
from creative_nao.explorer.state import Favourite, Session
from creative_nao.model import load_memory

ANGLES = """[...document.querySelectorAll('.cn-scene [id]')].map((place) => window['scene_' + place.id]).filter(Boolean)
    .map((scene) => [...(window.robotPlayer?.robots ?? [])].find((robot) => {
        let top = robot.root;
        while (top.parent) top = top.parent;
        return top === scene;
    })?.movement?.angles ?? [])"""
"""What the robots do, in the order of the page (the player has the order in which they were made); it may be asked
before the player's script is loaded."""
STATUS = "(k) => document.querySelectorAll('[role=status]')[k]?.textContent ?? ''"


def both_say(tab, text):
    for k in (0, 1):
        tab.page.wait_for_function(f"([k, text]) => ({STATUS})(k).includes(text)", arg=[k, text], timeout=60_000)


def assert_both_move_at(tab, pb):
    """Hold both robots against what each memory generates at a point."""
    made = [np.round(load_memory(name).generate(np.array([pb]))[0], 5) for name in ("half/0", "open/0")]
    tab.page.wait_for_function(
        f"(wanted) => {{ const now = {ANGLES}; return now.length === 2 && now.every((one, k) => one.length && "
        "wanted[k].every((row, t) => row.every((value, j) => Math.abs(value - one[t][j]) < 1e-4))) }",
        arg=[one.tolist() for one in made],
        timeout=60_000,
    )


def test_one_click_moves_both_robots(visit, server):
    tab = visit(f"{server.url}?x=0.3&y=0.2&beside=open/0")
    both_say(tab, "PB 0.300, 0.200")
    assert_both_move_at(tab, (0.3, 0.2))
    assert tab.page.locator(".cn-map").count() == 2
    box = tab.page.locator(".cn-map").nth(1).bounding_box()
    tab.page.mouse.click(box["x"] + 0.25 * box["width"], box["y"] + 0.25 * box["height"])  # on the second map
    both_say(tab, "PB -0.517, 0.517")
    assert_both_move_at(tab, (-0.517, 0.517))
    tab.page.wait_for_function("location.search === '?x=-0.517&y=0.517&beside=open/0'")
    rings = "[...document.querySelectorAll('.cn-map')].map((map) => map.querySelector('circle').getAttribute('cx'))"
    first, second = tab.page.evaluate(rings)
    assert first == second
    assert all(url.startswith((server.url, "data:", "blob:")) for url in tab.requests)


@pytest.mark.slow
def test_drag_keys_and_zoom_go_through_both(visit, server):
    tab = visit(f"{server.url}?x=0&y=0&beside=open/0")
    tab.page.mouse.move(*tab.place(0.3, 0.3))
    tab.page.mouse.down()
    tab.page.mouse.move(*tab.place(0.75, 0.5), steps=4)
    tab.page.mouse.up()
    both_say(tab, "PB 0.517, ")
    tab.page.locator(".cn-map").nth(1).focus()
    tab.page.keyboard.press("3")  # a basic action of the first memory
    pb = load_memory("half/0").pb[2]
    both_say(tab, f"PB {pb[0]:.3f}, {pb[1]:.3f}")
    tab.page.keyboard.press("+")
    tab.page.wait_for_function("document.querySelector('.cn-note').textContent.includes('200 x 200')", timeout=90_000)
    shown = "[...document.querySelectorAll('.cn-map')].map((map) => map.querySelectorAll('text').length)"
    assert max(tab.page.evaluate(shown)) <= 6
    tab.page.mouse.move(*tab.place(0.4, 0.4))
    tab.page.wait_for_function(
        "[...document.querySelectorAll('.cn-hover')].every((one) => one.textContent.includes('novelty'))"
    )
    told = tab.page.locator(".cn-hover").all_inner_texts()
    assert told[0].split(":")[0] == told[1].split(":")[0]


@pytest.mark.slow
def test_a_second_memory_is_chosen_in_the_page_kept_with_a_favourite_and_put_away(visit, server):
    tab = visit(f"{server.url}?x=0.1&y=0.2")
    tab.page.get_by_label("Beside it").click()
    tab.page.get_by_role("option", name="closed/0", exact=True).click()
    tab.page.wait_for_url("**beside=closed/0**")
    both_say(tab, "PB 0.100, 0.200")
    tab.page.get_by_label("Note").fill("twins")
    tab.page.get_by_role("button", name="Keep as favourite").click()
    tab.page.get_by_text("twins").wait_for()
    tab.page.get_by_label("Beside it").click()
    tab.page.get_by_role("option", name="none", exact=True).click()
    tab.page.wait_for_function("document.querySelectorAll('.cn-map').length === 1")
    tab.says("PB 0.100, 0.200")
    tab.page.get_by_role("button", name="Recall a favourite").last.click()
    tab.page.wait_for_function("document.querySelectorAll('.cn-map').length === 2")
    both_say(tab, "PB 0.100, 0.200")
    tab.page.get_by_role("button", name="Remove").last.click()
    tab.page.get_by_text("twins").wait_for(state="detached")


@pytest.mark.slow
def test_a_memory_without_a_physical_map_says_so(visit, server):
    tab = visit(f"{server.url}?beside=open/0&colour=physical")
    tab.page.get_by_text("No physical map of this memory was given").wait_for()
    tab.page.wait_for_function(
        "[...document.querySelectorAll('.cn-legend')].some((one) => one.textContent.includes('touches itself'))"
    )


@pytest.mark.slow
def test_on_a_phone_they_stand_one_below_the_other(visit, server):
    tab = visit(f"{server.url}?beside=open/0")
    tab.page.set_viewport_size({"width": 390, "height": 844})
    first, second = (tab.page.locator(".cn-map").nth(k).bounding_box() for k in (0, 1))
    assert second["y"] > first["y"] + first["height"]
    assert tab.page.evaluate("document.documentElement.scrollWidth") <= 390


@pytest.mark.slow
def test_two_memories_on_the_command_line(visit, tmp_path):
    running = Server(tmp_path, memories=("open/0", "half/0"))
    try:
        tab = visit(f"{running.url}?x=0.3&y=0.2")
        both_say(tab, "PB 0.300, 0.200")
        assert tab.page.get_by_text("Memory open/0 and Memory half/0").is_visible()
        alone = visit(f"{running.url}?beside=none")
        assert alone.page.locator(".cn-map").count() == 1
        assert visit(f"{running.url}?beside=../../etc/passwd").page.locator(".cn-map").count() == 1
    finally:
        running.stop()


@pytest.mark.parametrize("names", [["half/0", "half/0"], ["open/0", "half/0", "closed/0"]])
def test_one_memory_or_two_different_ones(names, capsys):
    assert main(["explore", *names, "--no-open"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"one memory, or two different ones side by side, but got '{' '.join(names)}'" in said
    assert main(["explore", "half/0", "open/0", "--html", "page.html"]) == 2
    assert "--html writes one memory, but got half/0 and open/0" in capsys.readouterr().err


def test_the_registry_gives_only_what_it_names(monkeypatch, tmp_path):
    monkeypatch.setenv("CREATIVE_NAO_CACHE", str(tmp_path))
    registry = MemoryRegistry([load_memory("half/0")], resolution=8)
    assert (registry.beside, registry.names[0], "open/0" in registry.names) == ("", "half/0", True)
    assert registry.get("half/0") is registry.first
    assert registry.get("open/0") is registry.get("open/0")
    with pytest.raises(NotFoundError, match=r"no memory `opn/0` here \(did you mean `open/0`\?\)"):
        registry.get("opn/0")
    with pytest.raises(NotFoundError):
        registry.get(str(tmp_path))
    assert registry.get("open/0").finished.wait(60)


def test_a_favourite_remembers_which_memory_stood_beside(tmp_path):
    path = tmp_path / "session.json"
    Session(path).add(Favourite("m", ((0.1, 0.2),), "one", "open/0"))
    assert Session(path).favourites("m")[0].beside == "open/0"
    old = json.loads(path.read_text())
    del old["favourites"][0]["beside"], old["sha256"]  # as written before there were twins
    path.write_text(json.dumps(old))
    assert Session(path).favourites("m")[0].beside == ""
