"""A physical map for the page: read from a file, if it is one of the memory shown."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from creative_nao.envs.physical_chart import PhysicalMap
from creative_nao.envs.physical_map import fingerprint
from creative_nao.errors import SettingsError
from creative_nao.model import Memory


def physical_map_of(memory: Memory, files: Iterable[Path]) -> PhysicalMap | None:
    """Return the physical map of a memory among files, the last if there are several; None if there is none.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If it is torn, foreign or unfinished.
    """
    own = fingerprint(memory)
    found = None
    for path in files:
        chart = PhysicalMap.load(path)
        if _settings(chart).get("sha256") == own:
            found = chart
    return found


def check_physical(files: Iterable[Path], memories: Iterable[Memory]) -> None:
    """Make sure that every file is the physical map of one of the memories.

    Raises:
        SettingsError: If one is not.
        NotFoundError: If there is no such file.
        FileFormatError: If it is torn, foreign or unfinished.
    """
    shown = {fingerprint(memory): memory.name for memory in memories}
    for path in files:
        settings = _settings(PhysicalMap.load(path))
        if settings.get("sha256") not in shown:
            names = list(shown.values())
            raise SettingsError(
                f"{path} is a physical map of the memory {settings.get('memory', '')!s:.60}, with other weights or "
                f"basic actions than {' or '.join(names)}; make one with "
                f"`creative-nao map {names[0]} --physical --out FILE`"
            )


def _settings(chart: PhysicalMap) -> dict[str, object]:
    found = chart.record.get("settings")
    return found if isinstance(found, dict) else {}
