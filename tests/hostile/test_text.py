"""Text of files is text: in figures, in Markdown, in pages."""

import json
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from markdown_it import MarkdownIt
from matplotlib.figure import Figure
from matplotlib.text import Text

import creative_nao
from creative_nao.cli import main
from creative_nao.demonstrations import Demonstrations
from creative_nao.evaluation.leaderboard import leaderboard, with_record
from creative_nao.evaluation.pages import CONTENT_POLICY, code, md, render
from creative_nao.evaluation.paper.page import to_html
from creative_nao.maps.figure_style import STYLE, figure, save, styled
from creative_nao.model import load_memory

NAMES = (
    r"$\nosuch{$", "$", "$$", r"\frac{", "^_", "<img src=x onerror=alert(1)>", "</script><script>alert(2)</script>",
    "a|b|c", "`code`", "**bold** [link](javascript:alert(3)) ![](file:///etc/passwd)", "{{ 7 * 7 }}{% raw %}", "~~~",
    "# heading", "- item", "===", "1. one", "> quote", "\\", "&lt;b&gt;", "=HYPERLINK(\"http://evil\")", "http://evil.example",
)  # fmt: skip
HIDDEN = "\u202egnp.exe\u2066\u200b\x1b[31m\x00\x07"


@pytest.fixture(scope="module")
def hostile_memory(tmp_path_factory):
    """A memory file whose action names are NAMES, as many as it has actions."""
    memory = load_memory("half/0")
    path = tmp_path_factory.mktemp("memory") / "$\\nosuch{$.safetensors"
    names = tuple(NAMES[: memory.demonstrations.n_actions])
    renamed = Demonstrations(names, memory.demonstrations.trajectories, memory.dt_s, memory.joints)
    object.__setattr__(memory, "demonstrations", renamed)
    return memory.save(path)


@pytest.mark.slow
def test_commands_draw_any_name(hostile_memory, tmp_path, monkeypatch, attempt):
    attempt("figures", "mathematics, markup and template marks as names of actions", "drawn as text")
    monkeypatch.chdir(tmp_path)
    assert main(["map", str(hostile_memory), "--resolution", "4", "--out", "map.npz"]) == 0
    memory = load_memory(hostile_memory)
    creative_nao.demonstrations.save_trajectory("a.csv", memory.demonstrations.trajectories[0], dt_s=memory.dt_s)
    assert main(["infer", "a.csv", "--memory", str(hostile_memory), "--n-restarts", "1", "--out", "a.png"]) == 0
    assert memory.demonstrations._repr_png_().startswith(b"\x89PNG")
    assert memory._repr_html_().count("<img ") == 1, "its own picture"


def test_a_figure_shows_names_as_they_stand(tmp_path):
    with styled(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # there is little room for so many names
        drawn, (axes,) = figure(40, 12)
        axes.set(title=NAMES[0], xlabel=NAMES[1], ylabel=NAMES[2])
        axes.set_xticks(range(len(NAMES)), NAMES, rotation=45)
        for place, name in enumerate(NAMES):
            axes.plot([0, place], label=f"{name} ")
            axes.text(place, place, name)
        axes.legend()
        save(drawn, tmp_path / "a.png")
    assert all(text.get_parse_math() is False for text in drawn.findobj(Text))
    assert "<script" not in (tmp_path / "a.svg").read_text(encoding="utf-8")


def test_only_one_place_says_how_text_is_drawn():
    """Whoever makes a figure of its own is `plain_text` or switches mathematics off text by text."""
    assert STYLE["text.parse_math"] is STYLE["text.usetex"] is False
    for path in Path(creative_nao.__file__).parent.rglob("*.py"):
        source = path.read_text(encoding="utf-8")
        for function in re.findall(r"(?:^@\w+\n)?^def (?:(?!^def )[\s\S])*?\bFigure\(figsize", source, re.MULTILINE):
            plain = function.startswith("@plain_text") or "styled()" in source or "parse_math=False" in source
            assert plain or path.name == "figure_style.py", path
    assert Figure


@pytest.mark.parametrize("text", [*NAMES, HIDDEN, "\n\n# x\n\n~~~\n\n| a | b |\n| - | - |\n"])
def test_text_in_markdown_is_no_markup_wherever_it_stands(text, attempt):
    attempt("Markdown pages", "HTML, tables, code fences, headings, links and hidden marks as text", "shown as text")
    parser = MarkdownIt("gfm-like", {"linkify": False})
    for place in ("{}", "words {} words", "- {}\n", "| a | {} |\n| --- | --- |\n| {} | b |\n"):
        kinds = [
            [token.type for one in parser.parse(place.format(shown, shown)) for token in (one, *(one.children or []))]
            for shown in (md(text), "x")
        ]
        assert set(kinds[0]) == set(kinds[1]) | ({"text_special"} & set(kinds[0])), place
        assert kinds[0].count("paragraph_open") == kinds[1].count("paragraph_open")
        assert kinds[0].count("td_open") == kinds[1].count("td_open")
        told = parser.render(place.format(code(text), "x").split("|")[0])
        assert not re.search("<(?!/?(p|code|li|ul|table|thead|tbody|tr|th|td)>)", told)
    assert md(text).isprintable()


def test_a_leaderboard_of_hostile_results_has_the_form_of_any(victims, attempt):
    attempt("leaderboard", "HTML, tables, code fences and hidden marks in a result file", "shown as text")
    good = with_record(victims["results"].path.parent)
    forms = []
    for text in ("plain", "a ~~~\n\n# x | <script>alert(1)</script> `` [x](y) \u202e \x1b[2J"):
        found = json.loads(json.dumps(good))
        found["suite"] = found["record"]["command"] = found["record"]["settings"]["suite"]["about"] = text
        for entry in (*found["rows"], *found["summary"]):
            if entry["agent"] == found["rows"][0]["agent"]:
                entry["agent"] = text
        page = leaderboard({f"{text}.json": found})
        assert not re.search("[\u202e\x1b]", page)
        tokens = MarkdownIt("gfm-like", {"linkify": False}).parse(page)
        assert not any("html" in token.type for one in tokens for token in (one, *(one.children or [])))
        forms.append([token.type for token in tokens])
    assert forms[0] == forms[1]


def test_reports_run_no_script_and_load_nothing(tmp_path, attempt):
    attempt("report.html", "a page with a script in it", "a content security policy forbids it")
    templates = Path(creative_nao.__file__).parent / "evaluation" / "templates"
    for path in templates.glob("*.html.jinja"):
        source = path.read_text(encoding="utf-8")
        assert "safe" not in re.findall(r"\|\s*(\w+)", source)
        assert ("<head>" in source) == ('http-equiv="Content-Security-Policy" content="{{ csp }}"' in source)
    page = to_html("# A\n\n<script>alert(1)</script> [x](javascript:alert(2)) <b>", tmp_path)
    assert "script-src" not in CONTENT_POLICY
    assert "default-src &#39;none&#39;" in page
    assert "<script" not in page
    assert "href" not in page.split("<main>")[-1]
    (tmp_path / "x.html.jinja").write_text("<p title='{{ x }}'>{{ x }}</p>")
    told = render("x.html.jinja", tmp_path, x=f"'><script>{HIDDEN}")
    assert "<script" not in told
    assert told.count("'") == 2
    assert told.isprintable()


def test_names_are_drawn_in_points_of_a_map(hostile_memory, tmp_path):
    memory = load_memory(hostile_memory)
    chart = creative_nao.pb_map(memory, 4)
    chart.plot(tmp_path / "a.svg", points=np.zeros((1, 2)), title=NAMES[0], colour="novelty")
    assert (tmp_path / "a.svg").stat().st_size > 1000
