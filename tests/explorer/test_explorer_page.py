"""The page in a real browser: touch the map, and the robot moves."""

import json

import mujoco
import numpy as np
import pytest

from creative_nao.explorer.physics_service import PhysicsService
from creative_nao.model import load_memory

HANDS = ("nao/RHand", "nao/LHand")


def test_a_click_moves_the_robot_and_nothing_leaves_the_server(visit, server):
    tab = visit(server.url)
    tab.wait_for_robot()
    tab.page.evaluate("window.robotPlayer.playing = false; window.robotPlayer.seek(1.5)")
    before = tab.page.evaluate(tab.POSE)
    tab.click_map(0.05, 0.7)
    tab.page.evaluate("window.robotPlayer.playing = true")
    tab.page.wait_for_function(tab.MOVED, arg=before)
    tab.says("PB -0.9")
    tab.page.wait_for_function("location.search.startsWith('?x=-0.9')")
    assert tab.page.locator(".cn-curves svg").count() == 8
    assert all(url.startswith((server.url, "data:", "blob:")) for url in tab.requests), tab.requests


def test_the_pose_in_the_browser_is_that_of_mujoco(visit, server):
    memory, physics_service = load_memory("half/0"), PhysicsService()
    model = physics_service.robot.scene.model
    data = mujoco.MjData(model)
    trajectory = memory.generate(np.array([[0.25, -0.5]]))[0]
    tab = visit(f"{server.url}?x=0.25&y=-0.5")
    tab.wait_for_robot()
    tab.says("PB 0.250, -0.500")
    tab.page.wait_for_function("window.robotPlayer.duration > 7")

    for tick in (0, 7, 23, 49):
        places = tab.page.evaluate(
            """([time, names]) => {
                window.robotPlayer.playing = false;
                window.robotPlayer.seek(time);
                const scene = window[Object.keys(window).find((key) => key.startsWith("scene_"))];
                scene.updateMatrixWorld(true);
                return names.map((name) => scene.getObjectByName(name).matrixWorld.elements.slice(12, 15));
            }""",
            [tick * memory.dt_s, HANDS],
        )
        data.qpos[:] = physics_service.robot.scene.guard_qpos()
        data.qpos[physics_service.robot.scene.index.arm_qpos] = trajectory[tick]
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(places, [data.body(name).xpos for name in HANDS], atol=1e-4)


def test_keys_do_what_the_pointer_does(visit, server):
    tab = visit(f"{server.url}?x=0&y=0")
    tab.page.locator(".cn-map").focus()
    tab.page.keyboard.press("Shift+ArrowRight")
    tab.says("PB 0.690, 0.000")  # ten cells of a map of 30
    tab.page.keyboard.press("ArrowDown")
    tab.says("PB 0.690, -0.069")
    learned = load_memory("half/0").pb[2]
    tab.page.keyboard.press("3")
    tab.says(f"PB {learned[0]:.3f}, {learned[1]:.3f}; appropriate, like a basic action; nearest C left hook")
    tab.page.keyboard.press("u")
    tab.says("PB 0.690, -0.069")


@pytest.mark.slow
def test_dragging_follows_the_pointer_and_a_path_is_one_movement(visit, server):
    tab = visit(server.url)
    tab.page.mouse.move(*tab.place(0.2, 0.2))
    tab.page.mouse.down()
    tab.page.mouse.move(*tab.place(0.5, 0.5), steps=4)
    tab.page.mouse.move(*tab.place(0.75, 0.5), steps=4)
    tab.page.mouse.up()
    tab.says("PB 0.517, ")

    tab.page.get_by_role("button", name="path", exact=True).click()
    tab.page.mouse.move(*tab.place(0.2, 0.4))
    tab.page.mouse.down()
    for share in (0.3, 0.4, 0.5):
        tab.page.mouse.move(*tab.place(share, 0.4))
        tab.page.wait_for_timeout(120)
    tab.page.mouse.up()
    tab.says("path of ")
    tab.page.wait_for_function("location.search.startsWith('?path=')")
    again = visit(tab.page.url)
    again.says("path of ")


@pytest.mark.slow
def test_two_tabs_know_nothing_of_each_other(visit, server):
    one, other = visit(f"{server.url}?x=0.5&y=0.5"), visit(f"{server.url}?x=-0.5&y=-0.5")
    one.click_map(0.5, 0.1)
    one.says("PB 0.0")
    assert other.status.startswith("PB -0.500, -0.500")


@pytest.mark.slow
@pytest.mark.parametrize("query", ["?x=nan&y=inf", "?x=1e999&y=%00", "?path=_,_nan,3_;drop", "?x=&y=<b>"])
def test_an_address_full_of_nonsense_shows_the_map(visit, server, query):
    assert visit(server.url + query).status.startswith(("PB ", "path "))


@pytest.mark.slow
def test_the_player_pauses_scrubs_and_slows_down(visit, server):
    tab = visit(server.url)
    tab.wait_for_robot()
    tab.page.get_by_role("button", name="Pause").click()
    first = tab.page.evaluate("window.robotPlayer.time")
    tab.page.wait_for_timeout(200)
    assert tab.page.evaluate("window.robotPlayer.time") == first
    tab.page.locator("[data-player=scrub]").fill("500")
    assert tab.page.evaluate("window.robotPlayer.time") == pytest.approx(7.35 / 2, abs=0.01)
    tab.page.get_by_role("button", name="Speed: 1").click()
    tab.page.get_by_role("button", name="Speed: 0.5").wait_for()


@pytest.mark.slow
def test_favourites_outlive_the_tab(visit, server):
    tab = visit(f"{server.url}?x=0.1&y=0.2")
    tab.page.get_by_label("Note").fill("my <b>favourite</b>")
    tab.page.get_by_role("button", name="Keep as favourite").click()
    tab.page.get_by_text("my <b>favourite</b>").wait_for()
    again = visit(f"{server.url}?x=0.9&y=0.9")
    again.page.get_by_role("button", name="Recall a favourite").click()
    again.says("PB 0.100, 0.200")
    again.page.get_by_role("button", name="Remove").click()
    again.page.get_by_text("my <b>favourite</b>").wait_for(state="detached")


@pytest.mark.slow
def test_a_click_is_answered_within_200_ms(visit, server):
    tab = visit(server.url)
    tab.wait_for_robot()
    rng = np.random.default_rng(0)
    measured = []
    for _ in range(21):
        x, y = tab.place(*rng.uniform(0.1, 0.9, 2))
        took = tab.page.evaluate(
            """([x, y]) => new Promise((done) => {
                const map = document.elementFromPoint(x, y);
                const player = window.robotPlayer;
                const robot = [...player.robots][0];
                const before = robot.movement;
                const start = performance.now();
                const options = {clientX: x, clientY: y, buttons: 1, bubbles: true, pointerId: 1};
                map.dispatchEvent(new PointerEvent("pointerdown", options));
                const look = () => robot.movement !== before ? done(performance.now() - start)
                                                              : requestAnimationFrame(look);
                look();
            })""",
            [x, y],
        )
        measured.append(took)
        tab.page.wait_for_timeout(200)
    assert np.median(measured[1:]) < 200, measured


@pytest.mark.slow
def test_what_was_exported_is_recognised_again(visit, server, tmp_path):
    tab = visit(f"{server.url}?x=0.1&y=0.3")
    with tab.page.expect_download() as waiting:
        tab.page.get_by_role("button", name="Export").click()
        tab.page.get_by_text("csv: ").click()
    exported = tmp_path / "movement.csv"
    waiting.value.save_as(exported)
    other = visit(server.url)
    other.page.locator("input[type=file]").set_input_files(exported)
    other.says("Recording, recognised at R with DTW 0.0", seconds=240)  # recognition is compiled at first use
    assert other.status.split(" left. ")[1].startswith("PB 0.100, 0.300")

    nonsense = tmp_path / "nonsense.csv"
    nonsense.write_text("time_s,RShoulderPitch\n0,bananas\n")
    other.page.locator("input[type=file]").set_input_files(nonsense)
    other.says("Not a movement")


@pytest.mark.slow
def test_physics_swings_the_bag(visit, server):
    learned = load_memory("half/0").pb[1]
    tab = visit(f"{server.url}?x={learned[0]}&y={learned[1]}")
    tab.wait_for_robot()
    tab.page.get_by_role("switch", name="Physics").click()
    tab.says("the body can do it")
    swing = "[...window.robotPlayer.robots][0].movement.tracks?.map((track) => track.body) ?? []"
    tab.page.wait_for_function(f"({swing}).includes('bag/bag')")
    assert json.dumps(tab.page.evaluate(swing))
