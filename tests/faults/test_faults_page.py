"""The table of faults on the page is what the tests recorded, and every case of theirs is in it and was survived."""

import importlib.util
import json
from pathlib import Path

import pytest
from striking import CASES, EXPLORER_CASES, case_name

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def maker():
    spec = importlib.util.spec_from_file_location("make_pages", DOCS / "make_pages.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def record(maker):
    return json.loads(maker.FAULTS_RECORD.read_text(encoding="utf-8"))


def test_every_case_was_tried_and_survived(record):
    assert [case["case"] for case in record["cases"]] == [case_name(*case) for case in (*CASES, *EXPLORER_CASES)]
    assert [case["case"] for case in record["cases"] if not case["survived"]] == []


def test_the_page_tells_what_was_recorded(maker, record):
    page = maker.FAULTS_PAGE.read_text(encoding="utf-8")

    assert maker.with_fault_table(page, record) == page


def test_a_case_that_was_not_survived_shows_in_the_table(maker, record):
    worse = [{**case, "survived": case["fault"] != "full disk"} for case in record["cases"]]

    assert "| 0 of 1 |" in maker.fault_table({"cases": worse})
    assert "| 0 of 1 |" not in maker.fault_table(record)
