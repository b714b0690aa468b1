"""The report of a run in a real browser: what the first screen holds, the phone, and axe-core."""

from pathlib import Path

import pytest
from test_accessibility import violations

from creative_nao.evaluation.paper.page import to_html
from creative_nao.evaluation.run import evaluate
from creative_nao.evaluation.runner import LocalExecutor
from creative_nao.evaluation.suites import suite_from_values

pytestmark = pytest.mark.slow

INSIDE = """(selector) => [...document.querySelectorAll(selector)].map((element) => {
    const box = element.getBoundingClientRect();
    return box.width > 50 && box.top > -1 && box.bottom <= innerHeight && box.right <= innerWidth;
})"""
SMALLEST = """() => Math.min(...[...document.querySelectorAll("main *")]
    .filter((element) => [...element.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim()))
    .map((element) => parseFloat(getComputedStyle(element).fontSize)))"""


@pytest.fixture(scope="module", params=[["half/10"], ["half/10", "open/10"]], ids=["one memory", "two memories"])
def report(request, tmp_path_factory):
    values = {"name": "small", "agents": ["supervised", "random", "spread", "plan"], "memories": request.param}
    values |= {"envs": ["CreativeNao/BoxingMental-v0"], "n_seeds": 2, "n_actions": 6, "seeds_per_job": 2}
    suite = suite_from_values({**values, "resolution": 20, "memories_per_job": 2}, where="here")
    folder = tmp_path_factory.mktemp("run") / "small"
    return evaluate(suite, folder, executor=LocalExecutor(1), command="creative-nao evaluate small").folder


def test_the_first_screen_holds_the_sentence_the_rewards_and_a_movement(visit, report):
    tab = visit((report / "report.html").as_uri())
    for part in (".lead", ".bars", ".bars li", ".lead + .first .find img"):
        inside = tab(INSIDE, part)
        assert inside, part
        assert all(inside), part
    assert tab("() => document.querySelector('.find img').naturalWidth") > 600
    assert all(url.startswith(("file:", "data:")) for url in tab.requests)
    tab.page.get_by_role("link", name="What this does not show").click()
    assert tab(INSIDE, "#limits") == [True]


@pytest.mark.parametrize("size", [(390, 844), (320, 640), (1280, 720)])
def test_the_page_never_scrolls_sideways_and_no_letter_is_small(visit, report, size):
    tab = visit((report / "report.html").as_uri(), size=size)
    tab("() => document.querySelectorAll('details').forEach((one) => { one.open = true })")
    assert tab("() => document.documentElement.scrollWidth") == size[0]
    assert tab("() => [...document.images].every((one) => one.getBoundingClientRect().right <= innerWidth)")
    assert tab(SMALLEST) >= 16


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [(1280, 720), (390, 844)])
def test_the_report_has_no_violation(visit, report, scheme, size):
    tab = visit((report / "report.html").as_uri(), color_scheme=scheme, size=size)
    tab("() => document.querySelectorAll('details').forEach((one) => { one.open = true })")
    assert violations(tab) == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_about_the_paper_is_as_readable(visit, tmp_path, scheme):
    docs = Path(__file__).parents[2] / "docs"
    (tmp_path / "report.html").write_text(to_html((docs / "reproduction.md").read_text(encoding="utf-8"), docs))
    tab = visit((tmp_path / "report.html").as_uri(), color_scheme=scheme, size=(390, 844))
    assert violations(tab) == []
    assert tab("() => document.documentElement.scrollWidth") == 390
    assert tab(SMALLEST) >= 16
