"""How results become words: numbers, sentences, HTML."""

import copy
from pathlib import Path

import pytest

from creative_nao.errors import FileFormatError, NotFoundError
from creative_nao.evaluation.paper.page import (
    RESULTS_AT,
    by_condition,
    interval,
    make_page,
    mean_cell,
    number,
    read_content,
    to_html,
)

DOCS = Path(__file__).parents[3] / "docs"
MARKDOWN = """# A & B

Is **1 < 2**? See [here](decisions.md) and [there](https://example.org/x), `a_b` <script>alert()</script>.

- one
- two

| name | value |
| --- | ---: |
| x | 1<br>2 |

![A title](images/some_picture.png)

**A title.** A caption.

```sh
creative-nao evaluate paper
```
"""


@pytest.fixture
def content():
    return copy.deepcopy(read_content(DOCS / RESULTS_AT))


def line_with(page, *parts):
    return next(line for line in page.splitlines() if all(part in line for part in parts))


def test_html_needs_nothing_else_and_escapes_what_it_is_given(tmp_path):
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "some_picture.png").write_bytes(b"picture")
    page = to_html(MARKDOWN, tmp_path)
    assert "<h1>A &amp; B</h1>" in page
    assert "Is <strong>1 &lt; 2</strong>? See <a>here</a> and" in page  # the documentation is not beside a report
    assert '<a href="https://example.org/x">there</a>, <code>a_b</code> &lt;script&gt;' in page
    assert '<td>x</td>\n<td style="text-align:right">1<br>2</td>' in page
    assert "<li>one</li>" in page
    assert "data:image/png;base64,cGljdHVyZQ==" in page
    assert "src=" not in page.replace('src="data:', "")


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (1234.5, "1,234"),
        (12.345, "12.3"),
        (1.2345, "1.23"),
        (0.01234, "0.0123"),
        (-3.456, "\N{MINUS SIGN}3.46"),
        (-0.00001, "0.0000"),
        (None, "\N{EN DASH}"),
    ],
)
def test_numbers_have_about_three_digits(value, text):
    assert number(value) == text


def test_numbers_in_sentences():
    assert number(26.0199, 2) == "26.02"
    assert (interval(1.0, 2.5), interval(None, None)) == (" [1.00, 2.50]", "")
    assert mean_cell({"mean": 20.0, "low": 18.0, "high": 22.5}) == "20.0 [18.0, 22.5]"
    assert mean_cell({"mean": 20.0, "low": None, "high": None}) == "20.0"
    assert by_condition({"open": 1.0, "half": None, "closed": {"mean": 30.0}}) == "1.00 / \N{EN DASH} / 30.0"


def test_evidence_names_what_is_compared(content):
    order = next(one for one in content["claims"] if one["key"] == "half-novel")
    order["differences"] = [
        {"above": "half", "below": "open", "mean": -5.0, "low": -8.0, "high": -2.0, "superiority": 0.125}
    ]
    share = next(one for one in content["claims"] if one["key"] == "learned")
    share |= {
        "rates": [{"condition": "open", "n_yes": 1, "n": 4, "low": 0.0, "high": 0.6}], "verdict": "undecided",
        "unit": "actions", "means": {"open": 2.0, "half": 3.0, "closed": 4.0},
    }  # fmt: skip
    page = make_page(content)
    told = (
        "novelty: half \N{MINUS SIGN} open: \N{MINUS SIGN}5.00 [\N{MINUS SIGN}8.00, \N{MINUS SIGN}2.00], "
        "larger in 12 % of pairs |"
    )
    assert told in line_with(page, "| Half closed training makes the most novel")
    assert "Here open is above half by 5.00 [2.00, 8.00] rad (novelty)." in line_with(page, "- **does not hold**: Half")
    assert "open 1 of 4; actions: 2.00 / 3.00 / 4.00 |" in line_with(page, "| The network learns")
    order["differences"] = []
    assert "novelty: nothing to compare |" in make_page(content)


def test_conditions_with_other_numbers_of_networks_are_told_apart(content):
    for row, n in zip(content["results"]["rows"], (3, 1, 2), strict=True):
        row["n_seeds"] = n
    page = make_page(content)
    assert "repeated with 3 / 1 / 2 networks (open / half / closed) in each condition" in page
    assert "- 1 network in a condition is few" in page
    for row in content["results"]["rows"]:
        row["n_seeds"] = 1
    assert "repeated with one network in each condition" in make_page(content)


def test_networks_that_failed_are_named_without_their_markup(content):
    content["figures"]["failures"] = {"half/3": "loss is nan", "open/1": "no <b>memory</b>"}
    assert "left out: half/3 (loss is nan) and open/1 (no &lt;b&gt;memory&lt;/b&gt;)." in make_page(content)


def test_a_verdict_that_turns_with_an_open_choice_is_told(content):
    rows = content["sensitivity"]["scoring"] = content["sensitivity"]["scoring"][:2]
    rows[0]["verdicts"]["half-novel"]["verdict"] = "holds"
    rows[1]["verdicts"]["half-novel"]["verdict"] = "does not hold"
    for row in rows:
        row["order"]["novelty"] = ["half", "open", "closed"]
    line = (
        "- 'Half closed training makes the most novel actions.' depends on how it is scored: holds with the defaults; "
        "does not hold with DTW: a path of its own for each joint. Half has the largest mean in 2 of 2 ways.\n"
    )
    assert make_page(content).count(line) == 2  # in short, and in the part about the study


def test_a_verdict_that_never_changes_is_told_once(content):
    study = content["sensitivity"]
    for row in (*study["scoring"], *study["training"]):
        for one in row["verdicts"].values():
            one["verdict"] = "undecided"
    page = make_page(content)
    assert page.count("however it is scored: undecided") == 4
    assert "No verdict that Table I decides depends on them." in page
    assert "([more below]" not in page


def test_a_page_without_a_study_says_nothing_about_it(content):
    content["sensitivity"] = None
    page = make_page(content)
    assert "open choice" not in page.split("## How to repeat it")[0]
    assert "sensitivity.json" not in page


@pytest.mark.parametrize("part", ["rows", "shown_seed"])
def test_a_missing_part_of_the_results_is_one_clear_error(content, part):
    content["results"].pop(part, None)
    content["figures"].pop(part, None)
    with pytest.raises(FileFormatError, match=part):
        make_page(content)


def test_results_that_are_not_there_are_named(tmp_path):
    with pytest.raises(NotFoundError, match=r"results\.json; make it with `creative-nao evaluate paper`"):
        read_content(tmp_path)
