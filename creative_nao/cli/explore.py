"""`creative-nao explore`: a page on which a person touches a memory and the robot performs what is there."""

from __future__ import annotations

import csv
import io
import itertools
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from creative_nao.errors import FileFormatError, MissingDependencyError, NotFoundError, SettingsError, printable, shown
from creative_nao.model import load_memory, shipped_memories
from creative_nao.runtime import sha256
from creative_nao.storage import note_unsealed, read_text

INSTALL = 'pip install "creative-nao[explore]"'
MAX_AGENT_POINTS = 5000
MAX_LINE = 10_000  # characters of a line of a table
CHOSEN = ("pb_1", "pb_2")
"""Columns with the PB point of an action."""


@dataclass(frozen=True)
class ExploreSettings:
    """Open a memory, or two side by side, in the browser: touch the map and the NAO performs what is there."""

    memories: tyro.conf.Positional[tuple[str, ...]] = ("half/0",)
    """Shipped name, such as half/0, or a memory file; two of them stand side by side."""
    port: int = 8765
    """Port to listen on."""
    host: str = "127.0.0.1"
    """Address to listen on; with 0.0.0.0 other machines can reach the page, which has no password."""
    allow_host: tuple[str, ...] = ()
    """Names, besides this machine's own and `--host`, under which other machines may ask for the page."""
    open: bool = True
    """Open the page in your browser."""
    resolution: int = 200
    """Points along each axis of the map."""
    run: Path | None = None
    """Run folder of `evaluate` whose agents' choices are laid over the map."""
    physical: tuple[Path, ...] = ()
    """Physical maps of the memories, as `creative-nao map MEMORY --physical` writes them: the page can then colour by
    what the body makes of each movement."""
    session: Path | None = None
    """JSON file of the favourites; default: creative_nao/explorer.json in this user's folder for data."""
    html: Path | None = None
    """Write the page as one file that works offline, instead of serving it; into a folder, a file for each memory named
    (`all` names every shipped one)."""


def run(settings: ExploreSettings) -> int:
    """Serve the page until Ctrl-C, or write it to a file."""
    if not 1 <= settings.port <= 65535:
        raise SettingsError(f"--port should be from 1 to 65535, but is {settings.port}")
    if settings.html is not None:
        return _write_pages(settings, settings.html)
    if not 1 <= len(set(settings.memories)) == len(settings.memories) <= 2:
        raise SettingsError(
            f"explore shows one memory, or two different ones side by side, but got {' '.join(settings.memories)!r:.80}"
        )
    memories = [load_memory(name) for name in settings.memories]
    try:
        from creative_nao.explorer.server import Explorer, claim_port, serve
    except MissingDependencyError:  # of the robot, and it says so better
        raise
    except ImportError as error:
        raise MissingDependencyError(f"the explorer needs {error.name or 'starlette'}: {INSTALL}") from error
    from creative_nao.explorer.favourites import Session, default_path
    from creative_nao.explorer.registry import MemoryRegistry, check_shown, load_physical

    for memory in memories:
        check_shown(memory)
    physical = load_physical(settings.physical, memories)
    claim_port(settings.host, settings.port)
    explorer = Explorer(
        lambda: MemoryRegistry(memories, settings.resolution, physical),
        Session(settings.session or default_path()),
        None if settings.run is None else choices(settings.run),
    )
    memories_shown = printable(" beside ".join(settings.memories))
    print(f"{memories_shown} is at http://{settings.host}:{settings.port}/  (Ctrl-C ends)")
    if settings.host not in ("127.0.0.1", "localhost", "::1"):
        print("warning: other machines can reach this page, and it asks nobody for a password", file=sys.stderr)
    sys.stdout.flush()
    serve(
        explorer, host=settings.host, port=settings.port, show=settings.open, allowed=settings.allow_host,
        told=lambda line: print(printable(line), flush=True),
    )  # fmt: skip
    return 0


def choices(folder: Path) -> np.ndarray:
    """Return the PB points that the agents of a run folder chose, shape (n, 2), at most the first 5,000."""
    path = folder / "episodes.csv"
    if not path.is_file():
        raise NotFoundError(f"no {path}; --run takes a folder that `creative-nao evaluate` wrote")
    text = read_text(path, "table of episodes")
    _check_sum(path)
    reader = csv.DictReader(_lines(path, text))
    points = []
    try:
        for name in CHOSEN:
            if list(reader.fieldnames or ()).count(name) != 1:
                raise FileFormatError(
                    f"{path}: the first line should name the columns pb_1 and pb_2 once, between commas, "
                    f"but is {', '.join(reader.fieldnames or ())[:200]}"
                )
        for row, _ in zip(reader, range(MAX_AGENT_POINTS), strict=False):
            points.append([_coordinate(row[name], f"{path}: line {reader.line_num}: {name}") for name in CHOSEN])
    except csv.Error as error:
        raise FileFormatError(f"{path}: line {reader.line_num}: not a line of CSV ({error})") from None
    found = np.array(points, dtype=np.float64).reshape(-1, len(CHOSEN))
    return found[(np.abs(found) <= 1).all(axis=1)]  # an agent may ask for a point that is on no map


def _lines(path: Path, text: str) -> Iterator[str]:
    """Yield the first lines of a table; empty ones count too: a file of nothing else is not read to its end."""
    for number, line in enumerate(itertools.islice(io.StringIO(text, newline=""), 2 * MAX_AGENT_POINTS), start=1):
        if len(line) > MAX_LINE:
            raise FileFormatError(f"{path}: line {number}: has {len(line)} characters, expected at most {MAX_LINE}")
        yield line


def _check_sum(path: Path) -> None:
    """Compare a table of a run folder with the hash that `run.json` has of it."""
    from creative_nao.evaluation.run import RECORD, read_record

    told = read_record(path.parent).get("hashes") if (path.parent / RECORD).is_file() else None
    if not isinstance(told, dict) or path.name not in told:
        note_unsealed(f"table of episodes {path}")
    elif told[path.name] != sha256(path):
        raise FileFormatError(f"{path}: damaged, or changed by hand: it does not fit its SHA-256 in {RECORD}")


def _coordinate(cell: str | None, where: str) -> float:
    try:
        return float(cell or "")
    except ValueError:
        raise FileFormatError(f"{where} should be a number, but is {shown(cell)}") from None


def _write_pages(settings: ExploreSettings, target: Path) -> int:
    from creative_nao.envs.physical_map import fingerprint
    from creative_nao.explorer.registry import load_physical
    from creative_nao.explorer.static_export import write_page

    alone = target.suffix.lower() in (".html", ".htm")
    if alone and len(settings.memories) > 1:
        raise SettingsError(f"a file holds one memory, but got {' and '.join(settings.memories)}; name a folder")
    if target.suffix and not alone and not target.is_dir():
        raise SettingsError(f"--html should be a folder or end in .html, but is {target}")
    names = shipped_memories() if settings.memories == ("all",) else settings.memories
    memories = [load_memory(name) for name in names]
    physical = load_physical(settings.physical, memories)
    for memory in memories:
        path = target if alone else target / f"{memory.name.replace('/', '_')}.html"
        written = write_page(memory, path, settings.resolution, physical.get(fingerprint(memory)))
        size = written.stat().st_size / 1e6
        print(f"written: {written}, {size:.1f} MB; it opens by double click, without a network", flush=True)
    return 0
