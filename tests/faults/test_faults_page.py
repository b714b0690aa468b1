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
    return json.loads(maker.RECORDS["faults"].read_text(encoding="utf-8"))


def test_every_case_was_tried_and_survived(record):
    assert [case["case"] for case in record["cases"]] == [case_name(*case) for case in (*CASES, *EXPLORER_CASES)]
    assert [case["case"] for case in record["cases"] if not case["survived"]] == []


def test_the_page_tells_what_was_recorded(maker, record):
    page = maker.RELIABILITY.read_text(encoding="utf-8")

    assert maker.with_tables(page, "faults", record) == page


def test_the_page_tells_the_recorded_attempts_which_all_held(maker):
    page = maker.RELIABILITY.read_text(encoding="utf-8")
    attempts = json.loads(maker.RECORDS["attempts"].read_text(encoding="utf-8"))

    assert [case["id"] for case in attempts["cases"] if not case["held"]] == []
    assert maker.with_tables(page, "attempts", attempts) == page
    worse = [{**case, "held": False} for case in attempts["cases"]]
    assert maker.attempt_table({"cases": worse}) != maker.attempt_table(attempts)


def test_a_case_that_was_not_survived_shows_in_the_table(maker, record):
    worse = [{**case, "survived": case["fault"] != "full disk"} for case in record["cases"]]

    assert "| 0 of 1 |" in maker.fault_table({"cases": worse})
    assert "| 0 of 1 |" not in maker.fault_table(record)
