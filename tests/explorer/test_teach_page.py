"""Teach in three steps, in a real browser."""

import numpy as np
import pytest

from creative_nao.explorer.keyframes import boxing


def drafts(tab):
    return tab("() => JSON.parse(sessionStorage.getItem('creative-nao-keyframes'))")


@pytest.fixture
def teach(visit, server):
    tab = visit(f"{server.url}teach")
    tab.until("() => document.querySelector('#teach-status').textContent")
    return tab


def test_a_slider_poses_the_robot_and_undo_takes_it_back(teach):
    assert teach.page.locator("#teach-status").text_content() == "6 demonstrations, all fit to be taught."
    assert teach.page.locator(".key img").count() == len(boxing().drafts[0].keys)
    before = teach.pose()
    slider = teach.page.get_by_label("Right arm shoulder pitch")
    slider.fill("-1")
    teach.moved(before)
    assert drafts(teach)[0][1][0][1] == pytest.approx(-1, abs=0.01)
    teach.until("() => !document.querySelector('#teach-undo').disabled")
    teach.press("Undo")
    teach.until("() => JSON.parse(sessionStorage.getItem('creative-nao-keyframes'))[0][1][0][1] > 0")


def test_what_cannot_be_taught_is_said_where_it_blocks_and_not_before(teach):
    status = teach.page.locator("#teach-status")
    assert "fault" not in (status.get_attribute("class") or "")
    teach.press("New")
    teach.until("() => document.querySelector('#teach-status').textContent.includes('hardly moves')")
    assert status.get_attribute("class") == "fault"
    assert teach.page.get_by_role("button", name="Train", exact=True).is_disabled()
    teach.press("Remove")
    teach.until("() => !document.querySelector('#train').disabled")


@pytest.mark.slow
def test_the_mirror_image_of_the_mirror_image_is_the_same(teach):
    teach.press("C left hook")
    teach.press("Mirror image")
    teach.until("() => JSON.parse(sessionStorage.getItem('creative-nao-keyframes')).length === 7")
    made = drafts(teach)
    assert made[6][0] == "right_hook_2"
    np.testing.assert_allclose(made[6][1], made[3][1], atol=1e-6)


def test_a_recording_becomes_a_demonstration_and_its_conversions_are_said(teach, tmp_path):
    joints = "RShoulderPitch;RShoulderRoll;RElbowYaw;RElbowRoll"
    rows = [f"{0.1 * k:.1f};{40 - k};-10;50;60".replace(".", ",") for k in range(30)]
    path = tmp_path / "my arm.csv"
    path.write_text("\n".join([f"time_s;{joints}", *rows]))
    teach.page.locator("#teach-file").set_input_files(str(path))
    teach.until("() => JSON.parse(sessionStorage.getItem('creative-nao-keyframes')).length === 7")
    said = teach.page.locator(".toast").text_content()
    assert "my arm.csv is a demonstration" in said
    assert "degrees" in said
    assert drafts(teach)[6][0] == "my_arm"


@pytest.mark.slow
def test_a_memory_is_trained_and_explored(teach):
    teach.page.locator("#epochs").select_option("10000")
    teach.press("Train")
    teach.page.get_by_text("Learned after").wait_for(timeout=300_000)
    teach.page.get_by_text("demonstrations come back").wait_for()
    assert teach.page.locator("#loss svg").count() == 1
    teach.press("Explore this memory")
    teach.until("() => globalThis.explorer?.panels[0]?.recall && !document.body.classList.contains('loading')")
    assert teach("() => explorer.panels[0].memory.name") == "taught in this page"
