"""The runs that nothing disturbs, made once, and the record of what was tried (`--write-faults FILE`)."""

import json
from pathlib import Path

import pytest
from striking import CASES, EXPLORER_CASES, case_name, run
from struck_commands import COMMANDS, RUN_FOLDER
from whole_files import contents

from creative_nao import storage
from creative_nao.runtime import versions


def pytest_addoption(parser):
    parser.addoption("--write-faults", type=Path, help="JSON file to record in what was tried; its other cases stay")


def keep(case, target):
    """Put a case into the record, in the place of an earlier try of it."""
    target = target.absolute()
    with storage.alone(target.parent):
        known = json.loads(target.read_text(encoding="utf-8"))["cases"] if target.exists() else []
        latest = {one["case"]: one for one in (*known, case)}
        order = [case_name(*one) for one in (*CASES, *EXPLORER_CASES)]
        made = {"versions": versions(), "cases": [latest[name] for name in order if name in latest]}
        storage.write_text(target, json.dumps(made, indent=1) + "\n")


@pytest.fixture
def tried(request):
    """What a test tells of its case; whether it was survived is known when the test has ended."""
    told = {"case": request.node.callspec.id, "survived": False}
    yield told
    report = request.node.report_of_call
    told["survived"] = report.passed
    if not report.passed:
        told["why"] = report.longreprtext[-2000:]
    if (target := request.config.getoption("--write-faults", default=None)) is not None:
        keep(told, target)


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory):
    """Return how a command ends and what it writes when nothing disturbs it."""
    known = {}

    def find(name):
        if name not in known:
            folder = tmp_path_factory.mktemp("undisturbed")
            ended = run(COMMANDS[name], folder)
            assert ended.code == 0, ended
            known[name] = ended, contents(folder / RUN_FOLDER)
            assert set(COMMANDS[name].files) <= set(known[name][1])
        return known[name]

    return find
