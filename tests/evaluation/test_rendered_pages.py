"""Pages are templates: text from files cannot become markup in them, and what is missing is an error."""

import jinja2
import pytest

from creative_nao.evaluation.pages import code, interval, markdown_table, md, render

HOSTILE = "a|b `c` <script>x</script> [l](http://evil) *d* \u202egnp.exe\x1b[31m\nnext"


def test_text_from_a_file_has_no_markup_in_markdown():
    assert md(HOSTILE) == (
        r"a\|b \`c\` &lt;script&gt;x&lt;/script&gt; \[l\](http://evil) \*d\* "
        "\N{REPLACEMENT CHARACTER}gnp.exe\N{REPLACEMENT CHARACTER}\\[31m next"
    )
    assert md("ppo/BoxingMental-v0, map_elites") == "ppo/BoxingMental-v0, map_elites"


@pytest.mark.parametrize(("text", "span"), [("a b", "`a b`"), ("a`b", "`` a`b ``"), ("a``b\n", "``` a``b ```")])
def test_a_code_span_cannot_be_left(text, span):
    assert code(text) == span


def test_a_name_cannot_break_a_table():
    row = {
        "agent": HOSTILE, "env": "x|y", "memory": "m", "n_actions": 30, "n_actions_training": 0, "seconds": 1.0,
        "seconds_training": 0.0, "appropriateness_pct": None, "novelty": None, "diversity": None,
        "reward": {"mean": 1.0, "low": None, "high": None}, "oracle_share": None,
        "best": None, "coverage_pct": None, "regret": None, "refused_pct": None, "n_imagined": 0.0, "track": "outcomes",
    }  # fmt: skip
    lines = markdown_table({"rows": [row]}).splitlines()
    assert len(lines) == 3
    assert "<script>" not in lines[2]
    assert lines[2].replace(r"\|", "").count("|") == lines[1].count("|")


@pytest.fixture
def page(tmp_path):
    def page(name, text, /, **values):
        (tmp_path / name).write_text(text)
        return render(name, tmp_path, **values)

    return page


def test_html_escapes_every_value_and_shows_hidden_marks(page):
    told = page("x.html.jinja", "<p>{{ name }}</p>", name="<b>\u202e")
    assert told == "<p>&lt;b&gt;\N{REPLACEMENT CHARACTER}</p>"


def test_a_value_that_is_not_given_is_an_error(page):
    with pytest.raises(jinja2.UndefinedError, match="'name' is undefined"):
        page("x.md.jinja", "{{ name }}")


def test_blocks_of_markdown_are_one_empty_line_apart(page):
    text = "# A\n\n\n{% filter paragraph %}\nb\n c\n{% endfilter %}\n\n{% filter bullet %}d{% endfilter %}\n\n\n"
    assert page("x.md.jinja", text) == "# A\n\nb c\n\n- d\n"


def test_an_interval_is_told_as_far_as_it_is_known():
    assert interval(None, 1) == "\N{EN DASH}"
    assert interval({"mean": 1.0, "low": None, "high": None}, 1, sign="+") == "+1.0"
