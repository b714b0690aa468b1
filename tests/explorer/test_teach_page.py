"""Teach in three steps, in a real browser."""

import shutil
from base64 import b64encode

import numpy as np
import pytest

from creative_nao import load_memory
from creative_nao.demonstrations import load_demonstrations
from creative_nao.demonstrations.keyframes import DT_S
from creative_nao.exchange import Motion, write
from creative_nao.explorer.keyframes import boxing
from creative_nao.joints import JOINTS


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
    teach.until(  # it is kept a moment after the robot has moved
        "() => Math.abs(JSON.parse(sessionStorage.getItem('creative-nao-keyframes'))[0][1][0][1] + 1) < 0.01"
    )
    teach.until("() => !document.querySelector('#teach-undo').disabled")
    teach.press("Undo")
    teach.until("() => JSON.parse(sessionStorage.getItem('creative-nao-keyframes'))[0][1][0][1] > 0")


def test_what_cannot_be_taught_is_said_where_it_blocks_and_not_before(teach):
    status = teach.page.locator("#teach-status")
    assert "fault" not in (status.get_attribute("class") or "")
    teach.press("New")
    teach.until("() => document.querySelector('#teach-status').textContent.includes('still stands: choose its second')")
    assert "fault" not in (status.get_attribute("class") or "")  # nobody has posed it yet
    teach.until("() => document.querySelector('#train').disabled")
    assert "First, in step 1: my move still stands" in teach.page.locator("#train-help").text_content()
    teach.page.locator(".key").nth(1).click()
    teach.page.get_by_label("Right arm shoulder pitch").fill("-2")
    teach.page.locator("#key-time").fill("0,3")
    teach.page.locator("#key-time").press("Enter")
    teach.until("() => document.querySelector('#teach-status').textContent.includes('its motor')")
    assert status.get_attribute("class") == "fault"
    teach.press("Slow it down")
    teach.until("() => !document.querySelector('#train').disabled")
    assert teach.page.locator("#train-help").text_content() == ""
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


DROP = """async ([name, content]) => {
    const bytes = Uint8Array.from(atob(content), (c) => c.charCodeAt(0));
    const data = new DataTransfer();
    data.items.add(new File([bytes], name));
    document.body.dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true }));
}"""


def drop(tab, name, content):
    tab(DROP, [name, b64encode(content).decode()])


@pytest.mark.slow
def test_the_whole_way_from_a_person_s_movement_to_a_memory_that_others_read(teach, tmp_path):
    """Motion capture is dropped, a movement chosen, posed, trained to the end, explored, downloaded and read again."""
    drop(teach, "take.csv", landmarks().encode())
    teach.page.locator(".found .key").first.wait_for()
    assert teach.page.locator(".found .key img").count() == teach.page.locator(".found .key").count() == 3
    teach.page.locator(".found .key").nth(1).click()
    teach.until("() => JSON.parse(sessionStorage.getItem('creative-nao-keyframes')).length === 7")
    teach.press("Done")
    told = teach.page.locator("#told")
    for words in (
        "From take.csv: a body's right arm, ",
        "degrees beside the person's",
        "led from the guard",
        "tick of 0.15 s",
    ):
        assert words in told.text_content()
    made = drafts(teach)[6]
    assert made[0] == "right_2"
    assert np.allclose(np.diff([row[0] for row in made[1]]), 0.15)
    jab = boxing().drafts[0]
    write(tmp_path / "jab.bvh", Motion(jab.trajectory(), DT_S, JOINTS), "bvh")
    drop(teach, "jab.bvh", (tmp_path / "jab.bvh").read_bytes())  # it holds one movement
    teach.until("() => JSON.parse(sessionStorage.getItem('creative-nao-keyframes')).length === 8")
    assert "frames a second" in told.text_content()
    drop(teach, "more.csv", landmarks().encode())
    teach.page.get_by_text("more.csv: 3 movements").wait_for()
    teach.page.locator(".found .key").first.click()
    teach.page.get_by_text("There may be 8 demonstrations").wait_for()
    teach.press("Done")
    teach.page.reload()
    teach.until("() => document.querySelectorAll('#drafts button').length === 8")
    for _ in range(6):
        teach.page.locator("#drafts button").first.click()
        teach.press("Remove")
    teach.until("() => JSON.parse(sessionStorage.getItem('creative-nao-keyframes')).length === 2")
    teach.page.locator("#epochs").select_option("10000")
    assert teach.page.locator("#explore-help").text_content() == "First train it, in step 2."
    teach.press("Train")
    teach.page.get_by_text("Learned after").wait_for(timeout=300_000)
    teach.page.get_by_text("2 of 2 demonstrations come back").wait_for()
    assert teach.page.locator("#loss svg").count() == 1
    with teach.page.expect_download() as download:
        teach.press("Download memory")
    download.value.save_as(tmp_path / "mine.safetensors")
    assert load_memory(tmp_path / "mine.safetensors").demonstrations.names[0] == "right_2"
    with teach.page.expect_download() as download:
        teach.press("Download CSV")
    download.value.save_as(tmp_path / "mine.zip")
    shutil.unpack_archive(tmp_path / "mine.zip", tmp_path)
    assert len(load_demonstrations(tmp_path / "demonstrations").names) == 2
    teach.press("Explore this memory")
    teach.until("() => globalThis.explorer?.panels[0]?.recall && !document.body.classList.contains('loading')")
    assert teach("() => explorer.panels[0].memory.name") == "taught in this page"
    drop(teach, "jab.bvh", (tmp_path / "jab.bvh").read_bytes())
    teach.page.get_by_text("the memory comes nearest at R").wait_for()
    teach.press("Watch agents")
    teach.page.locator(".dot.b").first.wait_for(timeout=120_000)


def landmarks():
    """A person who punches three times with the right hand, 60 frames a second, as a table of places."""
    times = np.arange(0, 7.0, 1 / 60)
    reach = sum(np.exp(-(((times - middle) / 0.28) ** 2)) for middle in (1.5, 3.5, 5.5))[:, None]
    still = {"RShoulder": [-0.2, 1.4, 0], "LShoulder": [0.2, 1.4, 0], "LElbow": [0.25, 1.15, 0.05],
             "LWrist": [0.2, 1.3, 0.25], "RHip": [-0.1, 0.9, 0], "LHip": [0.1, 0.9, 0]}  # fmt: skip
    places = {name: np.tile(place, (len(times), 1)) for name, place in still.items()}
    upper = np.array([-0.05, -0.27, 0.05]) * (1 - reach) + np.array([0.03, 0.0, 0.27]) * reach
    fore = np.array([0.02, 0.15, 0.2]) * (1 - reach) + np.array([0.02, 0.0, 0.25]) * reach
    places["RElbow"] = places["RShoulder"] + 0.28 * upper / np.linalg.norm(upper, axis=1, keepdims=True)
    places["RWrist"] = places["RElbow"] + 0.25 * fore / np.linalg.norm(fore, axis=1, keepdims=True)
    columns = [f"{name}_{axis}" for name in places for axis in "xyz"]
    rows = np.concatenate([times[:, None], *places.values()], axis=1)
    return "\n".join([",".join(["time_s", *columns]), *(",".join(f"{value:.4f}" for value in row) for row in rows)])
