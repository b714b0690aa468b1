"""Names out of a memory file are text in the exported page, whatever they hold."""

import re

import pytest

from creative_nao.cli import main
from creative_nao.demonstrations import Demonstrations
from creative_nao.model import load_memory

pytestmark = pytest.mark.slow
NAMES = (
    '<img src=x onerror=alert("A1")>', '</script><script>alert("A2")</script>', "<!--<script>",
    "{{constructor.constructor('alert(\"A3\")')()}}", '"><svg onload=alert("A4")>', '`${alert("A5")}`',
)  # fmt: skip


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("exported")
    memory = load_memory("half/0")
    renamed = Demonstrations(
        NAMES, memory.demonstrations.trajectories, memory.dt_s, memory.joints, {"command": "</script><script>alert(6)"}
    )
    object.__setattr__(memory, "demonstrations", renamed)
    path = memory.save(folder / "<img src=x onerror=alert('N')>.safetensors")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CREATIVE_NAO_CACHE", str(folder / "cache"))
        assert main(["explore", str(path), "--resolution", "10", "--html", str(folder / "page.html")]) == 0
    return folder / "page.html"


def test_the_exported_page_holds_names_as_data_under_a_policy(exported, attempt):
    attempt("exported page", "HTML, script ends and template marks as names of actions and memory", "shown as text")
    page = exported.read_text(encoding="utf-8")
    head = page[: page.index("<title>")]
    (policy,) = re.findall(r'Content-Security-Policy"\s+content="([^"]+)"', head)
    assert policy.startswith("default-src 'none'")
    outside = re.sub(r'(?s)(type="application/json" id="data">).*?(</script>)', r"\1\2", page)
    assert not re.search(r"<img src=x|<svg onload|<script>alert|alert\(6\)", outside)


def test_no_name_becomes_an_element_or_runs(exported, browser):
    opened = browser.new_page()
    said = []
    opened.on("dialog", lambda dialog: said.append(dialog.message) or dialog.dismiss())
    opened.goto(exported.as_uri())
    opened.wait_for_timeout(500)
    for key in "123456":
        opened.keyboard.press(key)
        opened.wait_for_timeout(50)
    assert not said
    assert opened.locator("img[src=x], svg[onload]").count() == 0
    assert "alert" not in opened.evaluate("[...document.scripts].map((s) => s.id == 'data' ? '' : s.text).join('')")
    opened.close()
