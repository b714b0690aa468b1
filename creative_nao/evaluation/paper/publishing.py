"""Write the page of a run folder, and bring page, pictures and results into the documentation."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from creative_nao import atomic
from creative_nao.errors import SettingsError
from creative_nao.evaluation.folder import read_record
from creative_nao.evaluation.paper.blocks import to_html, to_markdown
from creative_nao.evaluation.paper.page import FILES, make_page, read_content
from creative_nao.evaluation.result_checks import naming

RESULTS_AT = "results/paper"
"""Where the documentation keeps the result files, seen from the page."""

PAGE = "reproduction.md"


def write_page(folder: Path) -> Path:
    """Write `reproduction.md` and `report.html` of a run folder from its result files and pictures."""
    with naming(f"results in {folder}"):
        blocks = make_page(read_content(folder), results_at="")
    style = (Path(__file__).parent / "report.css").read_text(encoding="utf-8")
    atomic.write_text(
        folder / "report.html", to_html(blocks, style=style, image=lambda name: folder / "images" / f"{name}.png")
    )
    return atomic.write_text(folder / PAGE, to_markdown(blocks))


def publish(folder: Path, docs: Path) -> list[Path]:
    """Bring the page of a run folder, its pictures and its result files into a documentation folder.

    Args:
        folder: Finished run folder.
        docs: Folder of the documentation; `reproduction.md`, `images/paper_*.png` and `results/paper/` are replaced.

    Returns:
        What was written.

    Raises:
        SettingsError: If `docs` is no folder.
    """
    if not docs.is_dir():
        raise SettingsError(f"--docs should name the folder of the documentation, but {docs} is none")
    results = docs / RESULTS_AT
    results.mkdir(parents=True, exist_ok=True)
    written = []
    for name in (*(f"{name}.json" for name in FILES), "networks.csv"):
        source, target = folder / name, results / name
        if name == "run.json":
            kept = {key: value for key, value in read_record(folder).items() if key != "hashes"}
            written.append(atomic.write_text(target, json.dumps(kept, indent=2, allow_nan=False) + "\n"))
        elif source.is_file():
            written.append(atomic.write_bytes(target, source.read_bytes()))
        else:
            target.unlink(missing_ok=True)
    (docs / "images").mkdir(exist_ok=True)
    for picture in sorted((folder / "images").glob("paper_*.png")):
        written.append(Path(shutil.copyfile(picture, docs / "images" / picture.name)))
    with naming(f"results in {results}"):
        blocks = make_page(read_content(results), results_at=RESULTS_AT)
    return [*written, atomic.write_text(docs / PAGE, to_markdown(blocks))]
