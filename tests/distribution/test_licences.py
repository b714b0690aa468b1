"""The page of licences leaves nothing out, and the bill of materials is one that other programs can read."""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
FOR_USERS = {name: needs for name, needs in PROJECT["optional-dependencies"].items() if name not in ("dev", "docs")}
PAGE = (ROOT / "docs" / "licences.md").read_text(encoding="utf-8")
ROWS = {
    name: (licence, extras)
    for name, licence, extras in re.findall(r"^\| ([\w.-]+) \| (.+?) \| (.*?) ?\|$", PAGE, re.MULTILINE)
    if name not in ("package", "---")
}


def names(needs):
    wanted = map(Requirement, needs)
    return {need.name for need in wanted if need.marker is None or need.marker.evaluate()}


@pytest.fixture(scope="module")
def bill(tmp_path_factory):
    target = tmp_path_factory.mktemp("bill") / "sbom.json"
    subprocess.run([sys.executable, ROOT / "docs" / "make_pages.py", "licences", "--sbom", target], check=True)
    return target.read_text(encoding="utf-8")


def test_the_page_names_every_dependency_and_every_extra_that_brings_one():
    assert names(PROJECT["dependencies"]) <= ROWS.keys()
    for extra, needs in FOR_USERS.items():
        for name in names(needs):
            assert extra in ROWS[name][1].split(", "), f"`docs/make_pages.py licences` with extra `{extra}` installed"


def test_every_package_of_the_page_declares_a_licence():
    assert not [name for name, (licence, _) in ROWS.items() if licence == "see its files"]


def test_the_bill_of_materials_fits_its_schema_and_a_broken_one_does_not(bill):
    validator = JsonStrictValidator(SchemaVersion.V1_5)

    assert validator.validate_str(bill) is None
    for part in ("bomFormat", "specVersion"):
        assert validator.validate_str(json.dumps({k: v for k, v in json.loads(bill).items() if k != part}))


def test_the_bill_says_what_needs_what(bill):
    read = json.loads(bill)
    references = [one["bom-ref"] for one in read["components"]]
    needed = {one["ref"]: one["dependsOn"] for one in read["dependencies"]}
    root = read["metadata"]["component"]["bom-ref"]

    assert len(set(references)) == len(references)
    assert set(references) | {root} == needed.keys()
    found = {reference.removeprefix("pkg:pypi/").partition("@")[0] for reference in needed[root]}
    assert found >= names(PROJECT["dependencies"]) | {"starlette", "uvicorn", "ribs", "optuna", "distributed"}
