"""The page as one file: it works from a disk, asks for nothing, and text from a memory runs nothing."""

import contextlib
import dataclasses
import json
import re
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from visiting import free_port

from creative_nao.agents import shipped_agents
from creative_nao.cli import main
from creative_nao.explorer import live_agents
from creative_nao.explorer.static_export import STATIC, bundled, page, write_page
from creative_nao.model import load_memory

DOCS = Path(__file__).parents[2] / "docs"
EVIL = (
    "<img src=x onerror=document.title='A1'>", "</script><script>document.title='A2'</script>", "{{7*7}}",
    "\"><svg onload=document.title='A4'>", "`${document.title='A5'}`", "<!--<script>",
)  # fmt: skip


@pytest.fixture(autouse=True, scope="module")
def no_trained_agents():
    """Let agents without torch, which takes seconds to load, play in the files; docs/play.html has a trained one."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(live_agents, "trained_agents", lambda _: [])
        yield


@pytest.fixture(scope="module")
def file(tmp_path_factory, no_trained_agents):
    """A file of a memory whose names are markup."""
    memory = load_memory("half/0")
    actions = dataclasses.replace(memory.demonstrations, names=EVIL)
    evil = dataclasses.replace(memory, demonstrations=actions, name=EVIL[0])
    return write_page(evil, tmp_path_factory.mktemp("file") / "page.html", 20)


def test_it_plays_from_a_disk_and_names_from_a_memory_are_text(visit, file, attempt):
    attempt("`explore --html`", "a memory whose names are HTML and scripts", "shown as text, nothing runs")
    tab = visit(file.as_uri())
    assert all(url.startswith(("file:", "data:")) for url in tab.requests)
    tab.page.keyboard.press("1")
    tab.press("Details")
    tab.until("(name) => document.querySelector('#resembles').textContent.includes(name)", EVIL[0])
    assert EVIL[0] in tab.status
    assert tab.page.locator("img[onerror], svg[onload]").count() == 0
    assert "A1" not in tab.page.title().replace(EVIL[0], "")
    assert tab.page.locator(".served:visible").count() == 0
    points = tab.points
    tab.press("Surprise me")
    assert tab.points != points
    tab.press("Keep as favourite")
    tab.page.locator(".favourite").wait_for()


def test_only_its_own_scripts_may_run(visit, file):
    tab = visit(file.as_uri())
    ran = tab("""() => {
        const script = document.createElement("script");
        script.textContent = "window.ran = true";
        document.body.append(script);
        const frame = document.createElement("img");
        frame.setAttribute("onerror", "window.ran = true");
        frame.src = "data:,x";
        document.body.append(frame);
        return new Promise((done) => setTimeout(() => done(window.ran ?? false), 300));
    }""")
    assert ran is False
    assert any("Content Security Policy" in error for error in tab.errors)
    tab.errors.clear()


def test_the_file_generates_as_the_package(visit, file):
    memory = load_memory("half/0")
    points = np.random.default_rng(1).uniform(-1, 1, (20, 2))
    tab = visit(file.as_uri())
    angles = tab(
        "(points) => points.map((pb) => explorer.panels[0].memory.recall([pb]).angles.map((row) => [...row]))",
        points.tolist(),
    )
    assert np.abs(np.array(angles) - memory.generate(points)).max() < 1e-3


def test_the_bundle_has_no_imports_left_and_its_policy_no_holes():
    script = bundled()
    assert not re.search(r"^(import|export) ", script, re.MULTILINE)
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', page("name", {}))[1]
    assert "unsafe" not in policy
    assert "default-src 'none'" in policy


def test_the_file_of_the_documentation_has_the_scripts_of_today():
    """`creative-nao explore half/0 --html docs/play.html --resolution 100` writes it."""
    text = (DOCS / "play.html").read_text(encoding="utf-8")
    assert bundled() in text
    assert (STATIC / "page.css").read_text(encoding="utf-8") in text
    tries = json.loads(re.search(r'<script type="application/json" id="data">(.*)</script>', text)[1])["tries"]
    assert any(name in shipped_agents() for name in tries)


@pytest.mark.slow
def test_the_first_page_of_the_documentation_holds_it_alive(visit, tmp_path):
    """The site is built and served as it would be published."""
    shutil.copytree(DOCS, tmp_path / "docs")
    shutil.copy(DOCS.parent / "mkdocs.yml", tmp_path)
    subprocess.run([sys.executable, "-m", "zensical", "build", "--strict"], cwd=tmp_path, check=True)
    port = free_port()
    command = [sys.executable, "-m", "http.server", str(port), "--bind", "127.0.0.1", "--directory", tmp_path / "site"]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as site:
        try:
            for _ in range(100):
                with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=5):
                    break
                time.sleep(0.1)
            tab = visit(f"http://127.0.0.1:{port}/index.html")
            frame = tab.page.locator("iframe").element_handle().content_frame()
            frame.wait_for_function("() => !document.body.classList.contains('loading')")
            before = frame.evaluate("() => explorer.points")
            frame.get_by_role("button", name="Surprise me", exact=True).click()
            frame.wait_for_function("(before) => String(explorer.points) !== String(before)", arg=before)
            assert all(url.startswith((f"http://127.0.0.1:{port}/", "data:", "blob:")) for url in tab.requests)
        finally:
            site.terminate()


def test_a_folder_takes_a_file_for_each_memory(tmp_path, capsys):
    assert main(["explore", "half/0", "open/1", "--html", str(tmp_path / "files"), "--resolution", "8"]) == 0
    assert sorted(path.name for path in (tmp_path / "files").iterdir()) == ["half_0.html", "open_1.html"]
    assert main(["explore", "half/0", "open/1", "--html", str(tmp_path / "a.html")]) == 2
    assert "name a folder" in capsys.readouterr().err
