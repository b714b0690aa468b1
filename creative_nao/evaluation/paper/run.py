"""The reproduction from start to end: networks, their maps and figures, verdicts, pictures, page and report."""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from creative_nao import storage
from creative_nao.errors import SettingsError
from creative_nao.evaluation.paper.bank import (
    PaperSettings,
    Report,
    entry_of,
    shipped_bank,
    train_bank,
    wanted_networks,
)
from creative_nao.evaluation.paper.claims import judge
from creative_nao.evaluation.paper.page import write_page
from creative_nao.evaluation.paper.summary import make_results, measure_entry, networks_csv
from creative_nao.evaluation.run import hashes, open_folder, write_record
from creative_nao.evaluation.runner import in_threads
from creative_nao.runtime import usable_cores

Watch = Callable[[dict[str, int]], contextlib.AbstractContextManager[Report]]
"""Takes the units of work of each piece by its name, gives what to call as they are done."""


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
    n_workers: int | None = None,
    resume: bool = False,
    command: str | None = None,
    watch: Watch = lambda _: contextlib.nullcontext(lambda *_: None),
) -> Reproduction:
    """Reproduce the paper into a run folder, new or empty, or with `resume` one to be continued: nothing is done twice.

    `n_workers` networks at a time, by default the number of cores, have no influence on results. `command` is how to
    type the run again, by default the running one; `watch` shows progress.

    Raises:
        SettingsError: If the folder holds something else.
        NotFoundError: If there is nothing to resume, or a condition has no network.
        TrainingError: If every network of a condition failed.
        KeyboardInterrupt: After Ctrl-C; what is done stays, checkpoints too.
    """
    cores = usable_cores() if n_workers is None else n_workers
    if cores < 1:
        raise SettingsError(f"`n_workers` should be at least 1, but is {cores}")
    described = {"suite": {"name": "paper"}, **dataclasses.asdict(settings)}
    kept = open_folder(folder, described, resume=resume, command=command)
    start = time.monotonic()
    if settings.source == "shipped":
        bank, failures = shipped_bank(), {}
    else:
        wanted = wanted_networks(settings.n_seeds, settings.n_epochs, settings.seed)
        with watch({entry_of(one, folder).name: one.n_epochs for one in wanted}) as report:
            bank, failures = train_bank(folder, settings, n_workers=cores, report=report)
    memories = {entry.name: entry.sha256 for entry in bank}
    if kept.get("memories", memories) != memories:
        had = kept["memories"]
        changed = min(name for name in {*had, *memories} if had.get(name) != memories.get(name))
        raise SettingsError(
            f"{folder} was started with other networks ({changed} has changed since); choose another folder"
        )
    piece = "networks measured"
    with watch({piece: len(bank)}) as report:
        networks = in_threads(
            bank, lambda entry: measure_entry(entry, folder, settings), cores,
            lambda n_done, entry: report(piece, n_done, entry.name),
        )  # fmt: skip
    results = make_results(networks, resolution=settings.resolution, seed=settings.seed)
    claims = judge(networks, seed=settings.seed)
    storage.write_json(folder / "results.json", results)
    storage.write_json(folder / "claims.json", {"claims": claims})
    storage.write_text(folder / "networks.csv", networks_csv(networks))
    # Drawing is loaded here: a worker draws nothing.
    from creative_nao.evaluation.paper.figures import draw_pictures

    shown = draw_pictures(folder, bank, networks, results["rows"], seed=settings.seed)
    storage.write_json(folder / "figures.json", {**shown, "failures": failures})
    seconds = round(time.monotonic() - start + kept.get("seconds", 0.0), 1)
    finish(folder, {**kept, "memories": memories, "n_workers": cores, "seconds": seconds})
    return Reproduction(folder, results, claims)


def finish(folder: Path, run: Mapping[str, Any]) -> None:
    """Write record, page and report of a run folder, with the hashes of all results but those kept for resuming."""
    write_record(folder, {**run})
    write_page(folder)
    results = {k: v for k, v in hashes(folder).items() if not k.startswith(("sensitivity/", "measured/"))}
    write_record(folder, {**run, "hashes": results})
