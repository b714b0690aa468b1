"""The page in the documentation says what the result files beside it say."""

import csv
import re
from pathlib import Path

import pytest

from creative_nao.evaluation.paper.claims import TABLE_I
from creative_nao.evaluation.paper.page import PAGE, RESULTS_AT, make_page, read_content

DOCS = Path(__file__).parents[3] / "docs"
TEXT = (DOCS / PAGE).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def content():
    return read_content(DOCS / RESULTS_AT)


def test_the_page_is_made_from_the_files(content):
    assert make_page(content, results_at=RESULTS_AT) == TEXT


def test_table_i_of_the_page_has_the_means_of_the_result_file(content):
    """Read the numbers back from the text, without the code that wrote them."""
    rows = {row["memory"]: row for row in content["results"]["rows"]}
    for measure in TABLE_I:
        line = next(line for line in TEXT.splitlines() if line.startswith(f"| {measure.title} ["))
        cells = [cell.strip() for cell in line.split("|")][2:-1]
        for place, condition in enumerate(("open", "half", "closed")):
            paper, ours = cells[2 * place], cells[2 * place + 1]
            assert float(paper) == measure.paper[condition]
            mean = float(re.match(r"[\d.,]+", ours)[0].replace(",", ""))
            assert mean == pytest.approx(rows[condition][measure.field]["mean"], rel=0.006)


def test_the_result_file_has_the_means_of_the_networks(content):
    with open(DOCS / RESULTS_AT / "networks.csv", encoding="utf-8") as stream:
        networks = list(csv.DictReader(stream))
    for row in content["results"]["rows"]:
        mine = [one for one in networks if one["condition"] == row["memory"]]
        assert len(mine) == row["n_seeds"]
        for measure in TABLE_I:
            values = [float(one[measure.field]) for one in mine if one[measure.field]]
            assert row[measure.field]["mean"] == pytest.approx(sum(values) / len(values))


def test_every_verdict_stands_on_the_page_beside_its_claim(content):
    for claim in content["claims"]:
        line = next(line for line in TEXT.splitlines() if line.startswith(f"| {claim['says']}"))
        assert claim["verdict"] in line


def test_the_page_stems_from_the_whole_experiment_and_names_no_machine(content):
    assert content["run"]["settings"]["source"] in ("shipped", "retrain")
    assert content["run"]["settings"]["resolution"] == 200
    assert content["figures"]["n_epochs"] == [100_000]
    assert content["sensitivity"] is not None
    assert not re.search(r"/(tmp|home|work|root)/", TEXT + (DOCS / RESULTS_AT / "run.json").read_text())
