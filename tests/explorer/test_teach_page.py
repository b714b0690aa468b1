"""The teaching page in a real browser: sliders move the robot, a memory is trained, and it can be explored."""

import io
import re
import zipfile

import numpy as np
import pytest
from test_tabs import WatchedServer
from visiting import free_port

from creative_nao.demonstrations import load_demonstrations
from creative_nao.explorer.keyframe_editor import boxing
from creative_nao.model import load_memory, reproduction

FIT = "demonstrations, all fit to be taught"


@pytest.fixture
def teach(visit, server):
    def open_tab(query="", **options):
        tab = visit(f"{server.url}teach{query}", ready=FIT, **options)
        tab.wait_for_pose()
        return tab

    return open_tab


def press(tab, name):
    tab.page.get_by_role("button", name=name, exact=True).click()


def lower(tab, joint, n):
    """Turn a joint by so many tenths of a radian, by keys."""
    handle = tab.page.get_by_role("slider", name=joint)
    for _ in range(n):
        handle.press("PageDown")


def test_a_slider_turns_the_joint_and_too_fast_is_said_at_once(teach):
    tab = teach()
    tab.page.get_by_role("button", name="Key at 0.70 s").click()
    tab.page.wait_for_function("document.querySelector('.cn-chosen').ariaLabel === 'Key at 0.70 s'")
    before = tab.page.evaluate(tab.POSE)
    lower(tab, "LShoulderPitch", 8)
    tab.page.wait_for_function(tab.MOVED, arg=before)
    tab.says("LShoulderPitch reaches")
    assert "its motor 7.9; give it" in tab.status
    tab.page.get_by_role("button", name="A left jab - has a fault").wait_for()
    assert tab.page.get_by_role("button", name="Train", exact=True).is_disabled()
    press(tab, "Undo")
    tab.says(FIT)


@pytest.mark.slow
def test_what_takes_the_focus_says_its_joint_and_its_value(teach):
    tab = teach()
    slider = tab.page.get_by_role("slider", name="LShoulderPitch")
    slider.focus()
    told = "['role', 'aria-label', 'aria-valuenow'].map((name) => document.activeElement.getAttribute(name))"
    role, name, before = tab.page.evaluate(told)
    assert (role, name) == ("slider", "LShoulderPitch")
    slider.press("PageDown")
    tab.page.wait_for_function(
        "(before) => document.activeElement.getAttribute('aria-valuenow') < before - 0.05", arg=float(before)
    )
    assert slider.count() == 1


@pytest.mark.slow
def test_the_posture_shown_is_that_of_the_key(teach):
    tab = teach()
    tab.page.get_by_role("button", name="Key at 0.70 s").click()
    posture = boxing().drafts[0].keys[2].posture
    turn = "[...(window.robotPlayer?.robots ?? [])][0]?.movement?.angles"
    tab.page.wait_for_function(f"JSON.stringify({turn}) === JSON.stringify({[[round(a, 5) for a in posture]]})")
    press(tab, "Preview")
    tab.page.wait_for_function("Math.abs(window.robotPlayer.duration - 7.35) < 1e-6")


@pytest.mark.slow
def test_an_empty_set_becomes_a_demonstration_and_its_mirror_image(teach):
    tab = teach()
    press(tab, "Empty set")
    tab.says("hardly moves")
    press(tab, "Add key")
    for part in ("ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll"):
        lower(tab, f"R{part}", 2)
    tab.says("a memory needs two demonstrations")
    press(tab, "Add mirror image")
    tab.says(f"2 {FIT}")
    name = tab.page.get_by_label("Name of the demonstration")
    name.fill("../../evil")
    name.press("Enter")
    tab.page.get_by_text("`name` should be a letter").wait_for()
    name.fill("other side")
    name.press("Enter")
    tab.page.get_by_role("button", name="B other side").wait_for()
    tab.page.reload()  # the browser keeps the keyframes of its tab
    tab.page.get_by_role("button", name="B other side").wait_for()
    tab.says(f"2 {FIT}")


@pytest.mark.slow
def test_a_memory_is_trained_watched_explored_and_taken_away(teach, server, tmp_path):
    tab = teach()
    tab.page.get_by_label("How long").click()
    tab.page.get_by_role("option", name="10,000 epochs").click()
    press(tab, "Train")
    tab.page.get_by_text(re.compile(r"Learning: epoch [\d,]+ of 10,000, loss")).wait_for(timeout=120_000)
    tab.page.locator(".cn-grown img").wait_for(timeout=120_000)
    first = tab.page.locator(".cn-grown").get_attribute("aria-label")
    tab.page.get_by_role("button", name="B right straight").click()  # the page lives on
    tab.page.wait_for_function("document.querySelector('[aria-label=\"Key at 0.30 s\"]')")
    tab.page.get_by_text("6 of 6 demonstrations come back within 10 rad").wait_for(timeout=400_000)
    assert first.startswith(("Map of 16 by 16", "Map of 24 by 24", "Map of 40 by 40", "Map of 60 by 60"))
    assert tab.page.locator(".cn-grown").get_attribute("aria-label").startswith("Map of 60 by 60 points")

    with tab.page.expect_download() as waiting:
        press(tab, "Download memory")
    waiting.value.save_as(tmp_path / "taught.safetensors")
    memory = load_memory(tmp_path / "taught.safetensors")
    assert memory.training.n_epochs == 10_000
    assert max(reproduction(memory)) < 10
    with tab.page.expect_download() as waiting:
        press(tab, "Download CSV")
    waiting.value.save_as(tmp_path / "demonstrations.zip")
    archive = zipfile.ZipFile(io.BytesIO((tmp_path / "demonstrations.zip").read_bytes()))
    archive.extractall(tmp_path)  # made by ourselves a moment ago
    again = load_demonstrations(tmp_path / "demonstrations")
    assert again.names == memory.demonstrations.names
    assert all(map(np.array_equal, again.trajectories, memory.demonstrations.trajectories))

    press(tab, "Explore this memory")
    tab.says("novelty")
    assert tab.page.get_by_text("Memory taught in this page").count() >= 1
    tab.page.locator(".cn-map").first.focus()
    tab.page.keyboard.press("3")
    tab.says(f"PB {memory.pb[2, 0]:.3f}, {memory.pb[2, 1]:.3f}; appropriate, like a basic action; nearest C left hook")
    tab.page.wait_for_function("location.search.includes('taught=')")
    tab.page.reload()
    tab.says("nearest C left hook")
    tab.page.get_by_role("link", name="Teach").click()
    tab.says(FIT)
    tab.page.get_by_text("Learned: 10,000 epochs").wait_for()
    assert all(url.startswith((server.url, "data:", "blob:")) for url in tab.requests)


@pytest.mark.slow
def test_stop_and_go_on_and_another_tab_knows_nothing(teach):
    tab, other = teach(), teach()
    press(tab, "Train")
    tab.page.get_by_text("Learning: epoch").wait_for(timeout=120_000)
    press(tab, "Stop")
    stopped = tab.page.get_by_text("Stopped: ")
    stopped.wait_for(timeout=120_000)
    assert other.page.get_by_text("Learning").count() + other.page.get_by_text("Stopped").count() == 0
    press(tab, "Go on")
    stopped.wait_for(state="detached", timeout=120_000)
    tab.page.get_by_text("Learning: epoch").wait_for(timeout=120_000)
    press(tab, "Stop")
    stopped.wait_for(timeout=120_000)


@pytest.mark.slow
def test_text_of_nonsense_in_the_browser_is_told_and_left(teach):
    tab = teach()
    tab.page.evaluate("sessionStorage.setItem('creative-nao-keyframes', '[[\"<img src=x onerror=alert(1)>\", []]]')")
    tab.page.reload()
    tab.page.get_by_text("The demonstrations kept by this tab cannot be read").wait_for()
    tab.says(f"6 {FIT}")


@pytest.mark.slow
def test_a_tab_that_goes_stops_its_training(visit, tmp_path):
    watched = WatchedServer(tmp_path, free_port())
    try:
        tab = visit(f"{watched.url}teach", ready=FIT)
        tab.page.get_by_label("How long").click()
        tab.page.get_by_role("option", name="100,000 epochs").click()
        press(tab, "Train")
        tab.page.get_by_text("Learning: epoch").wait_for(timeout=120_000)
        assert watched.tells()["learning"] == 1
        tab.page.close()
        watched.becomes(kept=0, alive=0, learning=0)
    finally:
        watched.stop()
