"""The reproduction from start to end: networks, their maps and figures, verdicts, pictures, page and report."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from creative_nao import storage
from creative_nao.errors import NotFoundError, SettingsError
from creative_nao.evaluation.paper.bank import (
    Entry,
    PaperSettings,
    Report,
    label,
    shipped_bank,
    train_bank,
    wanted_networks,
)
from creative_nao.evaluation.paper.claims import judge
from creative_nao.evaluation.paper.comparisons import make_results, networks_csv
from creative_nao.evaluation.paper.measuring import measure_entry
from creative_nao.evaluation.paper.page import write_page
from creative_nao.evaluation.paper.sensitivity import (
    RESCORE,
    SensitivitySettings,
    epochs_of_training,
    study_scoring,
    study_training,
)
from creative_nao.evaluation.paper.threads import in_threads
from creative_nao.evaluation.run import RECORD, hashes, read_record, refuse_links, write_record
from creative_nao.model import CONDITIONS
from creative_nao.runtime import record, usable_cores

Watch = Callable[[dict[str, int]], contextlib.AbstractContextManager[Report]]
"""Takes the units of work of each piece by its name, gives what to call as they are done."""


@contextlib.contextmanager
def _unwatched(_: dict[str, int]) -> Iterator[Report]:
    yield lambda *_: None


@dataclass(frozen=True)
class Reproduction:
    """A finished reproduction: its run folder, and the content of `results.json` and `claims.json`."""

    folder: Path
    results: dict[str, Any]
    claims: list[dict[str, Any]]


def reproduce(
    settings: PaperSettings,
    folder: Path,
    *,
    sensitivity: SensitivitySettings | None = None,
    n_workers: int | None = None,
    resume: bool = False,
    command: str | None = None,
    watch: Watch = _unwatched,
) -> Reproduction:
    """Reproduce the paper into a run folder.

    Args:
        settings: Where the networks come from, and how finely their maps are scored.
        folder: Run folder: new or empty, or with `resume` one to be continued.
        sensitivity: Study the open choices too; with `resume` a study can be added to a finished folder.
        n_workers: Networks at a time; default: the number of cores. Has no influence on results.
        resume: Continue the folder: nothing is done twice.
        command: How to type the run again; default: the running command.
        watch: Shows progress.

    Raises:
        SettingsError: If the folder holds something else.
        NotFoundError: If there is nothing to resume, or a condition has no network.
        TrainingError: If every network of a condition failed.
        KeyboardInterrupt: After Ctrl-C; what is done stays, checkpoints too.
    """
    cores = usable_cores() if n_workers is None else n_workers
    if cores < 1:
        raise SettingsError(f"`n_workers` should be at least 1, but is {cores}")
    kept = _open(folder, settings, resume=resume, command=command)
    start = time.monotonic()
    bank, failures = _bank(folder, settings, cores, watch)
    _same_networks(folder, kept, bank)
    piece = "networks measured"
    with watch({piece: len(bank)}) as report:
        networks = in_threads(
            bank, lambda entry: measure_entry(entry, folder, settings), cores,
            lambda done, entry: report(piece, done, entry.name),
        )  # fmt: skip
    results = make_results(networks, resolution=settings.resolution, seed=settings.seed)
    claims = judge(networks, seed=settings.seed)
    _write(folder / "results.json", results)
    _write(folder / "claims.json", claims)
    storage.write_text(folder / "networks.csv", networks_csv(networks))
    if sensitivity is not None:
        # Two displays: a network scored again and an epoch of training are no common unit of time.
        with watch({RESCORE: len(bank)}) as report:
            scoring = study_scoring(bank, folder, sensitivity, n_workers=cores, report=report)
        with watch(epochs_of_training(sensitivity)) as report:
            training = study_training(folder, sensitivity, n_workers=cores, report=report)
        described = sensitivity.described()
        _write(folder / "sensitivity.json", {"settings": described, "scoring": scoring, "training": training})
    # Drawing is loaded here: a worker draws nothing.
    from creative_nao.evaluation.paper.figures import draw_pictures

    shown = draw_pictures(folder, bank, networks, results["rows"], seed=settings.seed)
    _write(folder / "figures.json", {**shown, "failures": failures})
    whole = {
        **kept,
        "memories": {entry.name: entry.sha256 for entry in bank},
        "n_workers": cores,
        "seconds": round(time.monotonic() - start + kept.get("seconds", 0.0), 1),
    }
    write_record(folder, whole)
    write_page(folder)
    write_record(folder, {**whole, "hashes": _result_hashes(folder)})
    return Reproduction(folder, results, claims)


def _bank(folder: Path, settings: PaperSettings, n_workers: int, watch: Watch) -> tuple[list[Entry], dict[str, str]]:
    if settings.trains:
        with watch({label(one): one.n_epochs for one in wanted_networks(settings)}) as report:
            return train_bank(folder, settings, n_workers=n_workers, report=report)
    bank = shipped_bank()
    missing = [name for name in CONDITIONS if name not in {entry.condition for entry in bank}]
    if missing:
        raise NotFoundError(f"no memory of the condition `{missing[0]}` ships with this installation; add --retrain")
    return bank, {}


def _open(folder: Path, settings: PaperSettings, *, resume: bool, command: str | None) -> dict[str, Any]:
    """Make the run folder or check that it is the one to be continued; return its record."""
    described = {"suite": {"name": "paper"}, **dataclasses.asdict(settings)}
    fresh = record(settings=described, command=command)
    if not resume:
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise SettingsError(
                f"`--out` {folder} exists and is not empty; add --resume to continue it, or choose another folder"
            )
        write_record(folder, fresh)
        return fresh
    if not (folder / RECORD).is_file():
        raise NotFoundError(f"nothing to resume in {folder}: it has no {RECORD}; leave out --resume to start there")
    found = read_record(folder)
    refuse_links(folder)
    for key, wanted in fresh["settings"].items():
        had = found["settings"].get(key)
        if had != wanted:
            raise SettingsError(f"{folder} was started with {key} {had}, not {wanted}; choose another folder")
    for package, version in fresh["versions"].items():
        if found["versions"].get(package) != version:
            raise SettingsError(
                f"{folder} was started with {package} {found['versions'].get(package)}, now it is {version}: "
                "results of two versions would be mixed; choose another folder"
            )
    return {**found, "command": fresh["command"]}


def _same_networks(folder: Path, kept: dict[str, Any], bank: Sequence[Entry]) -> None:
    had, found = kept.get("memories"), {entry.name: entry.sha256 for entry in bank}
    if had is not None and had != found:
        changed = sorted(name for name in {*had, *found} if had.get(name) != found.get(name))
        raise SettingsError(
            f"{folder} was started with other networks ({changed[0]} has changed since); choose another folder"
        )


def _write(path: Path, content: Any) -> None:
    storage.write_text(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def _result_hashes(folder: Path) -> dict[str, str]:
    """Return the hashes of the results; what is only kept to go on from is left out."""
    return {name: value for name, value in hashes(folder).items() if not name.startswith(("sensitivity/", "measured/"))}
