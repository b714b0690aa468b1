"""axe-core finds no violation in any page, light or dark, with everything open."""

import pytest
from axe_playwright_python.sync_playwright import Axe


def violations(tab):
    """Return what axe-core finds, with the elements."""
    found = Axe().run(tab.page).response["violations"]
    return [(one["id"], [node["target"] for node in one["nodes"]][:4]) for one in found]


@pytest.mark.parametrize("scheme", ["light", pytest.param("dark", marks=pytest.mark.slow)])
def test_the_page_has_no_violation(visit, server, scheme):
    tab = visit(f"{server.url}?x=0.3&y=0.2", color_scheme=scheme)
    tab.press("Keep as favourite")
    tab.page.locator(".favourite").wait_for()
    assert violations(tab) == []
    tab.press("Details")
    tab.page.mouse.move(*tab.place(0.3, 0.3))
    assert violations(tab) == []
    tab.page.keyboard.press("Escape")
    tab.page.keyboard.press("?")
    assert violations(tab) == []
    tab.page.keyboard.press("Escape")
    tab("() => document.documentElement.removeAttribute('lang')")
    assert [name for name, _ in violations(tab)] == ["html-has-lang"]  # it looks


def test_the_teaching_page_has_no_violation(visit, server):
    tab = visit(f"{server.url}teach")
    tab.until("() => document.querySelector('#teach-status').textContent")
    for summary in tab.page.locator("summary").all():
        summary.click()
    assert violations(tab) == []


def test_the_phone_has_no_violation(visit, server):
    tab = visit(server.url, size=(390, 844), has_touch=True, is_mobile=True)
    assert violations(tab) == []


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [(1440, 900), (390, 844)], ids=["desktop", "phone"])
def test_two_memories_teaching_and_a_race_have_no_violation(visit, server, scheme, size):
    options = {"color_scheme": scheme, "size": size} | ({"has_touch": True, "is_mobile": True} if size[0] < 500 else {})
    twin = visit(f"{server.url}?beside=open/0", **options)
    twin.until("() => explorer.panels.length === 2 && explorer.panels[1].recall")
    assert violations(twin) == []
    twin.press("Watch agents")
    twin.page.locator(".dot.b").first.wait_for(timeout=120_000)
    assert violations(twin) == []
    twin.press("End")
    teach = visit(f"{server.url}teach", **options)
    teach.until("() => document.querySelector('#teach-status').textContent")
    for summary in teach.page.locator("summary").all():
        summary.click()
    teach.press("New")
    teach.page.locator(".key").nth(1).click()
    teach.page.locator("#key-time").fill("0.02")
    teach.page.locator("#key-time").press("Enter")
    teach.page.locator("#teach-status.fault").wait_for()
    assert violations(teach) == []
    teach.errors.clear()  # the browser tells of the answer 400
    teach.press("Undo")
    teach.press("Remove")
    teach.press("Train")
    teach.page.locator("#loss svg").wait_for(timeout=120_000)
    teach.press("Stop")
    teach.page.get_by_text("Stopped after").wait_for()
    assert violations(teach) == []
