"""The map in a real browser: its colours, and zooming into finer cells."""

import re

import numpy as np
import pytest

from creative_nao.model import load_memory

LEGEND = "(text) => document.querySelector('.cn-map ~ .cn-legend').textContent.includes(text)"
NOTE = "(text) => document.querySelector('.cn-note').textContent.includes(text)"
FINE = "200 x 200 finer cells"
SOURCE = "document.querySelector('.cn-map img').src"


def window(tab):
    """Return what the note says the map shows: PB 1 from, to, PB 2 from, to."""
    return [float(number) for number in re.findall(r"-?\d\.\d+", tab.page.locator(".cn-note").inner_text())][-4:]


def notes(tab, text):
    tab.page.wait_for_function(NOTE, arg=text, timeout=90_000)


def colours(tab, name):
    tab.page.get_by_label("Colour").click()
    tab.page.get_by_role("option", name=name, exact=True).click()


@pytest.mark.slow
def test_the_colours_tell_a_measure_with_its_unit_and_stay_in_the_address(visit, server):
    tab = visit(server.url)
    before = tab.page.evaluate(SOURCE)
    colours(tab, "speed")
    tab.page.wait_for_function(LEGEND, arg="largest speed of a joint [rad/s]")
    assert tab.page.evaluate(SOURCE) != before
    tab.page.wait_for_function("location.search.includes('colour=speed')")
    again = visit(tab.page.url)
    again.page.wait_for_function(LEGEND, arg="largest speed of a joint [rad/s]")
    again.page.mouse.move(*again.place(0.5, 0.5))
    again.page.get_by_text(re.compile(r"largest speed of a joint \[rad/s\]: \d")).wait_for()
    assert all(url.startswith((server.url, "data:", "blob:")) for url in again.requests)


@pytest.mark.slow
def test_the_colours_tell_what_the_body_makes_of_it(visit, server):
    tab = visit(server.url)
    colours(tab, "physical outcome")
    tab.page.wait_for_function(LEGEND, arg="touches itself")
    tab.page.mouse.move(*tab.place(0.3, 0.3))
    tab.page.get_by_text("; on the robot: ").wait_for()
    colours(tab, "physical: hit impulse")
    tab.page.wait_for_function(LEGEND, arg="force on the bag, integrated [N s]")


@pytest.mark.slow
def test_a_click_is_answered_while_colours_are_worked_out(visit, server):
    tab = visit(server.url)
    colours(tab, "ruggedness")
    tab.click_map(0.25, 0.25)
    tab.says("PB -0.517, 0.517", seconds=20)
    tab.page.wait_for_function(LEGEND, arg="neighbouring movements [rad]", timeout=90_000)


@pytest.mark.slow
def test_the_wheel_zooms_round_the_pointer_and_a_click_is_exact(visit, server):
    tab = visit(server.url)
    tab.page.mouse.move(*tab.place(0.5, 0.5))
    tab.page.mouse.wheel(0, -700)
    notes(tab, "times nearer")
    tab.page.wait_for_function("location.search.includes('view=')")
    low_1, high_1, low_2, high_2 = window(tab)
    assert high_1 - low_1 == pytest.approx(2 / np.exp(2.1), rel=0.1)
    assert low_1 < 0 < high_1
    notes(tab, FINE)

    tab.click_map(0.25, 0.25)
    x, y = low_1 + 0.25 * (high_1 - low_1), low_2 + 0.75 * (high_2 - low_2)
    tab.page.wait_for_function("!document.querySelector('[role=status]').textContent.startsWith('PB 0.000, 0.000')")
    told = [float(number) for number in re.findall(r"-?\d\.\d{4,}", tab.status)]
    assert told == pytest.approx([x, y], abs=2e-3)  # half a pixel, and the digits of the note
    recall = load_memory("half/0").generate(np.array([told]))
    assert recall.shape[0] == 1
    again = visit(tab.page.url)
    again.says(f"PB {told[0]:.4f}, {told[1]:.4f}")
    notes(again, FINE)
    assert window(again) == [low_1, high_1, low_2, high_2]


@pytest.mark.slow
def test_keys_and_buttons_zoom_follow_and_show_the_whole_again(visit, server):
    tab = visit(f"{server.url}?x=0.2&y=0.1")
    tab.page.locator(".cn-map").focus()
    for times in ("2 times", "4", "8"):
        tab.page.keyboard.press("+")
        notes(tab, times)
    low, high, *_ = window(tab)
    assert low < 0.2 < high
    notes(tab, FINE)
    tab.page.keyboard.press("Shift+ArrowRight")  # ten of the finer cells
    tab.says(f"PB {0.2 + 10 * (high - low) / 200:.4f}, 0.1000;")  # a decimal more where cells are finer
    letters = tab.page.locator(".cn-map text").count()
    tab.page.keyboard.press("6")
    tab.says("nearest F right uppercut")
    pb = load_memory("half/0").pb[5]
    tab.page.wait_for_function(
        "([x, y]) => { const w = new URLSearchParams(location.search).get('view').split(',').map(Number);"
        "return x >= w[0] && x <= w[0] + w[2] && y >= w[1] && y <= w[1] + w[2] }",
        arg=pb.tolist(),
    )
    tab.page.locator(".cn-map text", has_text="F").wait_for()
    assert letters < 6
    tab.page.keyboard.press("0")
    tab.page.wait_for_function("!location.search.includes('view=')")
    tab.page.wait_for_function("document.querySelectorAll('.cn-map text').length === 6")
    tab.page.get_by_role("button", name="Zoom in").click()
    notes(tab, "2 times")
    tab.page.get_by_role("button", name="Whole map").click()
    tab.page.wait_for_function("document.querySelector('.cn-note').textContent === ''")


@pytest.mark.slow
def test_two_fingers_zoom_and_one_finger_goes_on_touching(browser, server):
    from visiting import Visit

    tab = Visit(browser, server.url, has_touch=True)
    x, y = tab.place(0.5, 0.5)
    session = tab.context.new_cdp_session(tab.page)

    def touch(kind, *offsets):
        points = [{"x": x + dx, "y": y, "id": k} for k, dx in enumerate(offsets)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    touch("touchStart", -30, 30)
    for apart in (50, 70, 90):
        touch("touchMove", -apart, apart)
        tab.page.wait_for_timeout(50)
    touch("touchEnd")
    notes(tab, "times nearer")
    low, high, *_ = window(tab)
    assert high - low == pytest.approx(2 / 3, rel=0.25)
    tab.page.wait_for_timeout(100)
    before = tab.status
    tab.page.touchscreen.tap(x + 100, y + 100)
    tab.page.wait_for_function("(before) => document.querySelector('[role=status]').textContent !== before", arg=before)
    assert not tab.errors
    tab.context.close()


@pytest.mark.slow
@pytest.mark.parametrize("query", ["?view=nan,0,1&colour=x", "?view=%00&colour=<b>", "?view=0.1,0.1,0", "?view=9,9,.1"])
def test_an_address_full_of_nonsense_shows_a_map(visit, server, query):
    assert visit(server.url + query).status.startswith("PB 0.000")
