"""`creative-nao explore`: a page on which a person touches a memory and the robot performs what is there."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from creative_nao.errors import MissingDependencyError, SettingsError, printable
from creative_nao.model import load_memory, shipped_memories

INSTALL = 'pip install "creative-nao[explore]"'


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
    """Run folder of `evaluate` whose agents explore in the page as they did there; the memory is one of the run's."""
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
    from creative_nao.explorer.run_episodes import RunEpisodes

    for memory in memories:
        check_shown(memory)
    physical = load_physical(settings.physical, memories)
    run = None if settings.run is None else RunEpisodes(settings.run)
    if run is not None:
        run.check_name(memories[0])
    claim_port(settings.host, settings.port)
    explorer = Explorer(
        lambda: MemoryRegistry(memories, settings.resolution, physical),
        Session(settings.session or default_path()),
        run,
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
