"""Bring result files into the documentation, and write the pages that stand on them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from creative_nao import atomic
from creative_nao.errors import FileFormatError, SettingsError
from creative_nao.evaluation.folder import read_record
from creative_nao.evaluation.leaderboard import leaderboard
from creative_nao.evaluation.result_checks import check_summary, naming
from creative_nao.evaluation.result_page import result_page
from creative_nao.evaluation.results import read_results
from creative_nao.fields import Fields, is_plain_name, shown

RESULTS_AT = "results"
"""Where the documentation keeps the result files, seen from its pages."""

ORDER = ("search", "physical", "performed", "modulation", "transfer")
NEEDED = ("summary", "record", "baseline")
KEPT = ("command", "settings", "versions", "platform", "created", "memories", "seeds", "seconds")


def with_record(folder: Path) -> dict[str, Any]:
    """Return the results of a finished run folder together with what made them.

    Raises:
        NotFoundError: If the folder holds no results.
        FileFormatError: If results or record are damaged, or were made by an old version.
    """
    results = read_results(folder / "results.json")
    record = read_record(folder)
    found = {**results, "record": {key: record[key] for key in KEPT if key in record}}
    _check(found, folder / "results.json")
    return found


def publish(folders: Sequence[Path], docs: Path) -> list[Path]:
    """Copy the results of run folders to `docs` and write `leaderboard.md` and `results.md` of all that are there.

    Args:
        folders: Finished run folders of different suites; one of a suite replaces the published one.
        docs: Folder of the documentation.

    Returns:
        What was written.

    Raises:
        SettingsError: If `docs` is no folder, or two runs are of one suite.
    """
    if not docs.is_dir():
        raise SettingsError(f"--docs should name the folder of the documentation, but {docs} is none")
    found = [with_record(folder) for folder in folders]
    names = [results["suite"] for results in found]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise SettingsError(f"the runs should be of different suites, but two are of `{twice[0]}`; give one of them")
    written = [
        atomic.write_text(docs / RESULTS_AT / f"{results['suite']}.json", json.dumps(results, allow_nan=False) + "\n")
        for results in found
    ]
    published = read_published(docs)
    written.append(atomic.write_text(docs / "leaderboard.md", leaderboard(published)))
    if "search" in {results["suite"] for results in published.values()}:
        with naming(f"results in {docs / RESULTS_AT}"):
            page = result_page(published)
        written.append(atomic.write_text(docs / "results.md", page))
    return written


def read_published(docs: Path) -> dict[str, dict[str, Any]]:
    """Return every published result file by its path as seen from the pages, in the order in which they are told."""
    found = {path: read_results(path) for path in sorted((docs / RESULTS_AT).glob("*.json"))}
    for path, results in found.items():
        _check(results, path)
    ranked = sorted(found, key=lambda path: (ORDER.index(path.stem) if path.stem in ORDER else len(ORDER), path.stem))
    return {f"{RESULTS_AT}/{path.name}": found[path] for path in ranked}


def _check(results: dict[str, Any], path: Path) -> None:
    for part in NEEDED:
        if part not in results:
            raise FileFormatError(f"results {path}: `{part}` is missing; it was made by an old version or by hand")
    check_summary(Fields(results, f"results {path}"))
    if not is_plain_name(results["suite"]):
        raise FileFormatError(f"results {path}: `suite` should be a plain name, but is {shown(results['suite'])}")
