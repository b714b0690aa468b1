"""The page in a real browser: what a person does with the map, the robot, the drawer, tour and race."""

import json
import re

import numpy as np
import pytest
from visiting import Server

from creative_nao.cli import main


def test_a_click_moves_the_robot_and_nothing_leaves_the_server(visit, server):
    tab = visit(server.url, plays=True)
    before = tab.pose()
    tab.click_map(0.25, 0.75)
    assert tab.points == [[pytest.approx(-0.5, abs=0.01), pytest.approx(-0.5, abs=0.01)]]
    tab.moved(before)
    tab.until("() => location.search.startsWith('?x=-0.')")
    tab.says("ost like")
    assert all(url.startswith((server.url, "data:")) for url in tab.requests)
    assert tab("() => document.documentElement.scrollHeight <= innerHeight")  # one screen


def test_the_pose_is_that_of_the_movement(visit, server):
    """At a moment between two ticks the arm's node has the angle of the movement, halfway."""
    tab = visit(f"{server.url}?x=0.45&y=0.62")
    turned = tab("""() => {
        const { player, panels: [{ stage, recall, memory }] } = explorer;
        player.pause();
        stage.blend = 1;
        player.seek(1.05 * memory.dt * 2 / 2.1);
        const { hinges, nodes } = stage.robot;
        return hinges.map(({ body }, joint) => {
            const { turn } = nodes[body].userData;
            const { w } = turn.clone().invert().multiply(nodes[body].quaternion);
            const angle = 2 * Math.acos(Math.min(1, Math.abs(w)));
            return [angle, Math.abs(recall.angles[1][joint])];
        });
    }""")
    for seen, meant in turned:
        assert seen == pytest.approx(meant, abs=1e-3)


@pytest.mark.slow
def test_dragging_goes_on_in_the_movement_and_one_undo_takes_it_back(visit, server):
    tab = visit(f"{server.url}?x=0.5&y=0.5")
    tab.page.mouse.move(*tab.place(0.3, 0.3))
    tab.page.mouse.down()
    tab.page.wait_for_timeout(300)
    time = tab("() => explorer.player.time")
    for k in range(6):
        tab.page.mouse.move(*tab.place(0.3 + 0.05 * k, 0.3))
    tab.page.wait_for_timeout(100)
    tab.page.mouse.up()
    assert tab("() => explorer.player.time") >= time
    tab.until("() => !document.querySelector('#undo').disabled")
    assert tab.points[0][0] == pytest.approx(0.1, abs=0.02)
    tab.press("Undo")
    assert tab.points == [[0.5, 0.5]]
    tab.until("() => !document.querySelector('#redo').disabled")
    tab.press("Redo")
    assert tab.points[0][0] == pytest.approx(0.1, abs=0.02)
    tab.until("() => location.search.includes('x=0.1') || location.search.includes('x=0.09')")
    tab.page.go_back()  # stays in the page
    tab.until("() => explorer.panels[0].recall")


def test_the_pointer_shows_a_card_with_a_small_robot(visit, server):
    tab = visit(server.url)
    for x in (0.30, 0.31):
        tab.page.mouse.move(*tab.place(x, 0.3))
        tab.page.wait_for_timeout(150)
    card = tab.page.locator("#card")
    assert re.match(r"(New|Taught|Too fast|Hardly moves)most like", card.text_content())
    tab.until("() => document.querySelector('#card-stage canvas').width > 50")
    tab.page.mouse.move(2, 2)
    assert card.is_hidden()


@pytest.mark.slow
def test_an_idle_page_draws_nothing(visit, server):
    tab = visit(server.url, plays=True)
    for x in (0.30, 0.31):
        tab.page.mouse.move(*tab.place(x, 0.3))  # the card plays, too
    tab.click_map(0.3, 0.3)
    tab.resting()
    asked = """() => {
        let n = 0;
        const ask = globalThis.requestAnimationFrame;
        globalThis.requestAnimationFrame = (call) => (n++, ask(call));
        return new Promise((done) => setTimeout(() => done(n), 700));
    }"""
    assert tab(asked) == 0


@pytest.mark.slow
def test_where_the_processor_draws_it_draws_thirty_pictures_a_second(visit, server):
    tab = visit(server.url, plays=True)
    drawn = """() => new Promise((done) => {
        const { player, panels: [{ stage }] } = explorer;
        player.play();
        const before = stage.frames;
        setTimeout(() => done([stage.software, stage.frames - before]), 2000);
    })"""
    software, n = tab(drawn)
    assert software
    assert 1 < n <= 70


@pytest.mark.slow
def test_keys_work_wherever_the_focus_is(visit, server):
    tab = visit(f"{server.url}?x=0&y=0")
    tab.page.keyboard.press("3")
    assert tab.points == tab("() => [explorer.panels[0].memory.pb[2]]")
    before = tab.points[0][0]
    tab.page.keyboard.press("ArrowRight")
    assert tab.points[0][0] == pytest.approx(before + 0.01)
    tab.page.keyboard.press("r")
    assert tab("() => explorer.panels[0].recall.outcome") == "unlearned"
    playing = tab("() => explorer.player.playing")
    tab.page.keyboard.press("Space")
    assert tab("() => explorer.player.playing") != playing
    tab.page.keyboard.press("?")
    assert tab.page.get_by_role("dialog").is_visible()
    tab.page.keyboard.press("Escape")
    tab.page.keyboard.press("+")
    assert tab("() => explorer.view.width") == 1
    tab.page.keyboard.press("0")
    assert tab("() => explorer.view.width") == 2


def test_the_camera_cannot_be_lost(visit, server):
    tab = visit(server.url)
    home = tab("() => explorer.panels[0].stage.camera.position.toArray()")
    x, y = tab.place(0.5, 0.3, "#stages")
    for way in (-400, 400, -300):
        tab.page.mouse.move(x, y)
        tab.page.mouse.down()
        tab.page.mouse.move(x + 30, y + way, steps=3)
        tab.page.mouse.up()
        assert tab("() => explorer.panels[0].stage.camera.position.z") > 0.05
    tab.page.mouse.wheel(0, 5000)
    tab.press("Reset the camera")
    np.testing.assert_allclose(tab("() => explorer.panels[0].stage.camera.position.toArray()"), home, atol=1e-3)


def test_the_drawer_tells_numbers_curves_and_takes_a_point(visit, server):
    tab = visit(server.url)
    tab.press("Details")
    drawer = tab.page.locator("#drawer")
    assert drawer.locator("svg").count() == 8
    assert drawer.evaluate("(box) => box.scrollWidth <= box.clientWidth")
    scene = tab.page.locator("#scene").bounding_box()
    assert scene["width"] > 300  # the robot stays in sight beside it
    assert scene["x"] + scene["width"] <= drawer.bounding_box()["x"]
    drawer.locator("#pb1").fill("0,25")
    drawer.locator("#pb2").fill("-0.5")
    drawer.locator("#pb2").press("Enter")
    assert tab.points == [[0.25, -0.5]]
    tab.until("() => document.querySelector('#numbers').textContent.includes('rad from')")
    drawer.locator("#colour").select_option("speed")
    tab.until("() => document.querySelector('#legend').textContent.includes('rad/s')")
    drawer.locator("#walk").click()
    assert tab("() => explorer.panels[0].recall.outcome") == "unlearned"  # the walk that is offered can be used


def test_favourites_are_pictures_and_stars_that_other_tabs_see(visit, server):
    tab, other = visit(f"{server.url}?x=0.3&y=0.2"), visit(server.url)
    tab.press("Keep as favourite")
    tab.page.locator(".favourite img").wait_for()
    assert tab.page.locator(".star").count() == 1
    other("() => dispatchEvent(new Event('focus'))")
    other.page.locator(".favourite button").first.click()
    assert other.points == [[0.3, 0.2]]
    tab.page.locator(".favourite").hover()
    tab.press("Remove this favourite")
    tab.page.locator(".favourite").wait_for(state="detached")


@pytest.mark.slow
def test_physics_is_felt_and_remembered(visit, server):
    tab = visit(server.url)
    tab.page.keyboard.press("2")
    tab.press("Physics")
    tab.until("() => explorer.panels[0].body")
    tab.says("The body can do it.")
    tab.press("Play")
    assert "hits of the bag, the hardest with" in tab.status
    tab.until("() => /^\\d+ N$/.test(document.querySelector('#badge').textContent)")
    tab.page.reload()
    tab.until("() => globalThis.explorer?.panels[0]?.body")
    assert tab.page.locator("#physics").get_attribute("aria-pressed") == "true"


@pytest.mark.slow
def test_two_memories_follow_one_pointer(visit, server):
    tab = visit(f"{server.url}?beside=open/0")
    tab.until("() => explorer.panels.length === 2 && explorer.panels[1].recall")
    tab.click_map(0.7, 0.3)
    angles = tab("() => explorer.panels.map((panel) => [...panel.recall.angles[20]])")
    assert not re.search("[LR](Shoulder|Elbow)", tab.status)  # joints are called in words
    assert np.abs(np.subtract(*angles)).max() > 0.01
    assert tab("() => document.documentElement.scrollHeight <= innerHeight")
    gone = visit(f"{server.url}?beside=nothing&taught=guess&colour=none")
    for text in ("is gone", "no memory “nothing”", "no colours “none”"):
        assert gone.page.get_by_text(text).count() == 1
    gone.errors.clear()  # the browser tells of the answer 404


@pytest.mark.slow
def test_the_tour_shows_surprises_and_ends(visit, server):
    tab = visit(server.url)
    tab.press("Take a tour")
    panel = tab.page.locator("#stop")
    panel.wait_for(timeout=120_000)
    seen = []
    while "Explore yourself" not in panel.text_content():
        seen.append(tab.points)
        assert re.search(r"The agent \w+ found this movement; nobody taught it", panel.text_content())
        box = panel.bounding_box()
        for name in ("#map", ".player"):
            other = tab.page.locator(name).bounding_box()
            assert other["x"] + other["width"] <= box["x"] or other["y"] + other["height"] <= box["y"]
        tab.press("Next")
    assert len(seen) == 3
    tab.press("Explore yourself")
    assert panel.is_hidden()


@pytest.mark.slow
def test_two_agents_race_on_the_map_with_a_robot_each(visit, server):
    tab = visit(server.url)
    tab.press("Watch agents")
    tab.page.locator(".dot.b").first.wait_for(timeout=120_000)
    assert tab("() => explorer.player.stages.length") == 2
    labels = tab.page.locator(".stage .of")
    assert all(re.search(r": [A-Z][\w ]+, \+\d+\.\d\d$", text) for text in labels.all_text_contents())
    tab.press("To the end")
    tab.page.get_by_text("wins:").wait_for(timeout=120_000)
    assert tab.page.locator(".dot").count() == 60
    player = tab.page.locator(".player").bounding_box()
    assert player["y"] + player["height"] <= tab.page.locator("#stop").bounding_box()["y"]
    assert all("/" not in text for text in labels.all_text_contents())
    tab.page.get_by_label("Yellow dots").select_option("plan@8")  # another race begins
    tab.page.get_by_text("plan@8: ").wait_for(timeout=120_000)
    tab.press("To the end")
    tab.page.get_by_text("plan@8 wins:").wait_for()
    assert tab.page.get_by_text("plan@8 imagined 240 movements").count() == 1
    tab.press("End")
    assert tab("() => [explorer.player.stages.length, explorer.player.speed]") == [1, 1]
    assert tab.page.locator(".dot").count() == 0


@pytest.mark.slow
def test_the_agents_of_a_run_explore_as_they_did(visit, tmp_path):
    suite = tmp_path / "mine.toml"
    suite.write_text('agents = ["random", "sobol"]\nenvs = ["CreativeNao/BoxingMental-v0"]\nmemories = ["half/3"]\n'
                     "n_seeds = 2\nn_actions = 5\n")  # fmt: skip
    assert main(["evaluate", str(suite), "--out", str(tmp_path / "run"), "--n-workers", "1"]) == 0
    results = json.loads((tmp_path / "run" / "results.json").read_text())
    (row,) = (row for row in results["rows"] if row["agent"] == "sobol")
    running = Server(tmp_path, words=["--run", str(tmp_path / "run")], memories=("half/3",))
    try:
        tab = visit(running.url)
        assert tab.page.locator(".dot").count() == 20
        tab.press("Watch agents")
        tab.page.get_by_text("wins:").wait_for(timeout=120_000)
        shares = tab.page.locator(".racer b").all_text_contents()
        assert float(shares[1]) == pytest.approx(row["reward_per_seed"]["1"], abs=0.06)
        assert tab.page.get_by_label("White dots").input_value() == "run:random"
        tab.press("Again")
        tab.page.get_by_text(" of 5. A try is").wait_for()
        tab.page.get_by_text("wins:").wait_for(timeout=120_000)
        shares = tab.page.locator(".racer b").all_text_contents()
        assert float(shares[1]) == pytest.approx(row["reward_per_seed"]["0"], abs=0.06)
        tab.page.get_by_label("Yellow dots").select_option("spread_points")  # a live one against it
        tab.page.get_by_text("spread_points: ").wait_for(timeout=120_000)
    finally:
        running.stop()


def test_a_phone_scrolls_and_has_the_robot_on_top(visit, server):
    tab = visit(server.url, size=(390, 844), has_touch=True, is_mobile=True)
    assert tab("() => document.documentElement.scrollWidth <= innerWidth")
    robot = tab.page.locator("#scene").bounding_box()
    assert robot["y"] + robot["height"] < 0.45 * 844
    assert tab.page.locator("#map").bounding_box()["width"] > 340
    for name in ("Keep as favourite", "Draw a path", "Undo", "Dark or light"):  # no button is beyond the edge
        box = tab.page.get_by_role("button", name=name).bounding_box()
        assert box["x"] + box["width"] <= 390
    hint, zooms = (tab.page.locator(name).bounding_box() for name in ("#hint", ".zooms"))
    assert zooms["y"] + zooms["height"] <= hint["y"] < 700
    x, y = tab.place(0.4, 0.4)
    tab.page.touchscreen.tap(x, y)
    assert tab.points[0] == pytest.approx([-0.2, 0.2], abs=0.03)
    tab.press("Details")
    sheet = tab.page.locator("#drawer").bounding_box()
    assert sheet["y"] > 0.35 * 844
    tab.press("Close the details")


@pytest.mark.slow
def test_long_play_takes_no_more_memory(visit, server):
    tab = visit(server.url)
    session = tab.context.new_cdp_session(tab.page)

    def held():
        session.send("HeapProfiler.collectGarbage")
        return tab("() => performance.memory.usedJSHeapSize")

    def play(n):
        for _ in range(n):
            tab("() => document.querySelector('#surprise').click()")
            tab.page.wait_for_timeout(5)

    play(60)
    before = held()
    play(600)
    assert held() < 1.3 * before + 5_000_000


@pytest.mark.slow
def test_zoom_brings_finer_cells(visit, server):
    tab = visit(f"{server.url}?x=0.2&y=0.3&view=0.1,0.2,0.4")
    tab.until("() => explorer.panels[0].finer?.cells.n === 200")
    tab.page.mouse.move(*tab.place(0.5, 0.5))
    tab.page.mouse.wheel(0, -300)
    tab.until("() => explorer.view.width < 0.3")
    tab.until("() => location.search.includes('view=')")
    tab.press("Details")
    tab.page.locator("#colour").select_option("unexpectedness")  # zoomed on while this is computed
    for _ in range(12):
        tab.press("Zoom in")
    assert tab.page.locator("#zoomed").text_content() == "1000 times nearer"
    tab.until("() => explorer.panels[0].finer?.cells.n === 200 && explorer.panels[0].finer.cells.values.unexpectedness")
    tab.until("() => { const { map, finer } = explorer.panels[0]; return map.cells === finer.cells; }")
    assert tab("() => { const { colour, view } = explorer.panels[0].map; return [colour, view.width]; }") == [
        "unexpectedness", 0.002,
    ]  # fmt: skip
    overflow = "() => getComputedStyle(document.querySelector('#map svg')).overflow"
    assert tab(overflow) == "hidden"
    tab.press("Whole map")
    assert tab(overflow) == "visible"  # a ring on the edge is a whole one
    tab.until("() => !location.search.includes('view=')")


@pytest.mark.slow
def test_a_movement_that_is_chosen_plays_whatever_the_player_did(visit, server):
    tab = visit(server.url, plays=True)
    tab.press("Pause")
    before = tab.pose()
    tab.click_map(0.3, 0.2)
    tab.moved(before)
    assert tab("() => explorer.player.playing")
    tab.press("Loop")
    tab("() => explorer.player.seek(explorer.player.duration - 0.05)")
    tab.until("() => !explorer.player.playing")
    tab.click_map(0.7, 0.6)
    tab.until("() => explorer.player.playing && explorer.player.time > 0.1")
    time = tab("() => explorer.player.time")
    tab.press("Ghost of the nearest taught movement")
    assert tab("() => explorer.player.time") >= time
    tab.press("Dark or light")
    tab.page.reload()
    tab.until("() => globalThis.explorer?.panels[0]?.recall")
    assert tab("() => document.documentElement.classList.contains('dark')")
    assert tab("() => explorer.ghost") is False
    tab.page.goto(f"{server.url}teach")
    tab.until("() => document.querySelector('#teach-status')?.textContent")
    assert tab("() => document.documentElement.classList.contains('dark')")
    assert tab.page.locator("#loop").get_attribute("aria-pressed") == "false"
    tab.press("Loop")
    assert tab("() => explorer.player.looping") is True


@pytest.mark.slow
def test_nothing_new_is_said_and_favourites_of_another_tab_are_there_at_once(visit, server):
    tab = visit(server.url)
    tab("() => explorer.panels[0].cells.outcome.fill(0)")
    points = tab.points
    tab.press("Surprise me")
    tab.page.get_by_text("Everything usable on this map was taught").wait_for()
    assert tab.points == points
    other = tab.context.new_page()
    other.goto(server.url)
    other.get_by_role("button", name="Keep as favourite").click()
    tab.page.locator(".favourite").wait_for(timeout=5_000)


@pytest.mark.slow
def test_on_a_phone_a_long_press_shows_the_card_and_two_memories_are_usable(visit, server):
    tab = visit(f"{server.url}?beside=open/0", size=(390, 844), has_touch=True, is_mobile=True)
    tab.until("() => explorer.panels.length === 2 && explorer.panels[1].recall")
    first, second = (tab.page.locator(name).bounding_box() for name in ("#map", "#map2"))
    assert first["y"] == second["y"]
    assert second["x"] >= first["x"] + first["width"] > 180
    assert tab("() => document.documentElement.scrollWidth <= innerWidth")
    x, y = tab.place(0.4, 0.5, "#map2")
    session = tab.context.new_cdp_session(tab.page)
    session.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]})
    card = tab.page.locator("#card")
    assert card.is_hidden()
    card.wait_for(state="visible")
    box = card.bounding_box()
    assert box["y"] + box["height"] < y  # not under the finger
    assert 0 <= box["x"] <= box["x"] + box["width"] <= 390
    assert "most like" in card.text_content()
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    card.wait_for(state="hidden")
    assert tab.points[0] == pytest.approx([-0.2, 0.0], abs=0.03)
    tab.page.evaluate("() => scrollTo(0, 400)")
    assert tab("() => scrollY") > 0 or tab("() => document.documentElement.scrollHeight") <= 844
    scene = tab.page.locator("#scene").bounding_box()
    assert scene["y"] + scene["height"] < 0.45 * 844  # the robot stays
    tab.press("Details")
    tab.page.locator("#beside").select_option("")
    tab.until("() => explorer.panels.length === 1")


@pytest.mark.slow
def test_teaching_is_usable_on_a_phone(visit, server):
    tab = visit(f"{server.url}teach", size=(390, 844), has_touch=True, is_mobile=True)
    tab.until("() => document.querySelector('#teach-status').textContent")
    assert tab("() => document.documentElement.scrollWidth <= innerWidth")
    tab.page.locator(".key").nth(2).tap()
    before = tab.pose()
    slider = tab.page.get_by_label("Left arm shoulder pitch")
    slider.scroll_into_view_if_needed()
    box = slider.bounding_box()
    scene = tab.page.locator("#scene").bounding_box()
    assert scene["y"] + scene["height"] <= box["y"]  # the robot that it moves stays in sight
    tab.page.touchscreen.tap(box["x"] + 0.2 * box["width"], box["y"] + box["height"] / 2)
    tab.moved(before)
    tab.until("() => document.querySelector('#train-help').textContent.startsWith('First, in step 1: left jab: ')")
    tab.page.locator("#teach-undo").tap()
    tab.page.locator("#to-step-2").tap()
    tab.page.get_by_role("button", name="Train", exact=True).tap()
    tab.page.get_by_text("rounds, about").wait_for(timeout=120_000)
    tab.press("Stop")
    tab.page.get_by_text("Stopped after").wait_for()
    tab.press("Go on")
    tab.page.get_by_text("Learned after").wait_for(timeout=300_000)
    tab.press("Explore this memory")
    tab.until("() => globalThis.explorer?.panels[0]?.recall && !document.body.classList.contains('loading')")
