"""How results become words: numbers, Markdown, HTML."""

import pytest

from creative_nao.evaluation.paper.blocks import (
    Bullets,
    Code,
    Heading,
    Picture,
    Table,
    Text,
    by_condition,
    compared,
    evidence,
    listed,
    mean_cell,
    number,
    signed,
    to_html,
    to_markdown,
)

PAGE = [
    Heading("A & B", 1),
    Text("Is **1 < 2**? See [here](decisions.md) and [there](https://example.org/x), `a_b`."),
    Bullets(("one", "two")),
    Table(("name", "value"), (("x", "1<br>2"),)),
    Picture("some_picture", "A title", "A caption."),
    Code("creative-nao evaluate paper"),
]


def test_markdown():
    assert to_markdown(PAGE) == (
        "# A & B\n\nIs **1 < 2**? See [here](decisions.md) and [there](https://example.org/x), `a_b`.\n\n"
        "- one\n- two\n\n| name | value |\n| --- | ---: |\n| x | 1<br>2 |\n\n"
        "![A title](images/some_picture.png)\n\n**A title.** A caption.\n\n"
        "```sh\ncreative-nao evaluate paper\n```\n"
    )


def test_html_needs_nothing_else_and_escapes_what_it_is_given(tmp_path):
    (tmp_path / "some_picture.png").write_bytes(b"picture")
    page = to_html(PAGE, style="p {}", image=lambda name: tmp_path / f"{name}.png")
    assert "<title>A &amp; B</title>" in page
    assert "Is <strong>1 &lt; 2</strong>? See here and" in page  # the documentation is not beside a report
    assert '<a href="https://example.org/x">there</a>, <code>a_b</code>' in page
    assert '<td class="left">x</td><td>1<br>2</td>' in page
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
    assert (signed(2.5), signed(-2.5)) == ("+2.50", "\N{MINUS SIGN}2.50")
    assert mean_cell({"mean": 20.0, "low": 18.0, "high": 22.5}) == "20.0 [18.0, 22.5]"
    assert mean_cell({"mean": 20.0, "low": None, "high": None}) == "20.0"
    assert by_condition({"open": 1.0, "half": None, "closed": 30.0}) == "1.00 / \N{EN DASH} / 30.0"
    assert (listed(["a"]), listed(["a", "b", "c"]), listed([])) == ("a", "a, b and c", "")


def test_evidence_names_what_is_compared():
    one = {"above": "half", "below": "open", "mean": -5.0, "low": -8.0, "high": -2.0, "superiority": 0.125}
    assert compared(one) == (
        "half \N{MINUS SIGN} open: \N{MINUS SIGN}5.00 [\N{MINUS SIGN}8.00, \N{MINUS SIGN}2.00], larger in 12 % of pairs"
    )
    rates = [{"condition": "open", "n_yes": 1, "n": 4, "low": 0.0, "high": 0.6}]
    means = {"open": 2.0, "half": 3.0, "closed": 4.0}
    assert evidence({"rates": rates, "unit": "actions", "means": means}) == "open 1 of 4; actions: 2.00 / 3.00 / 4.00"
