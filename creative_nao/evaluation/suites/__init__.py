"""Suites: what is compared, as data. A TOML file each, here or of your own.

`Suite` and `Taught` say what a suite holds; `read_suite` reads a file, `suite_from_values` a record. `SUITES` are the
shipped ones by name; `find_suite` takes a shipped name or a path.
"""

from __future__ import annotations

from pathlib import Path

from creative_nao.errors import NotFoundError, nearest_name
from creative_nao.evaluation.suites.model import Suite, Taught
from creative_nao.evaluation.suites.reading import SUFFIX, read_suite, refuse_modules, suite_from_values

SUITE_NAMES: tuple[str, ...] = tuple(
    sorted((path.stem for path in Path(__file__).parent.glob(f"*{SUFFIX}")), key=lambda name: (name != "quick", name))
)
"""Names of the shipped suites, `quick` first."""


def find_suite(name: str, *, trusted: bool = False) -> Suite:
    """Return the shipped suite called `name`, or the one in the TOML file at `name`.

    Args:
        name: Name or file.
        trusted: Whether modules that a file names are imported.

    Raises:
        NotFoundError: If there is none; the message offers the nearest name.
        FileFormatError: If a file is no TOML.
        SettingsError: If a file's content is no suite; the message names the key.
    """
    if name in SUITE_NAMES:
        return read_suite(Path(__file__).parent / f"{name}{SUFFIX}")
    if name.endswith(SUFFIX):
        return read_suite(Path(name), trusted=trusted)
    raise NotFoundError(
        f"no suite `{name}`{nearest_name(name, SUITE_NAMES)}; there are: {', '.join(SUITE_NAMES)}, "
        f"or a file of your own ending in {SUFFIX}"
    )


def shipped_suites() -> dict[str, Suite]:
    """Return all shipped suites by name."""
    return {name: find_suite(name) for name in SUITE_NAMES}


__all__ = [
    "SUFFIX",
    "SUITE_NAMES",
    "Suite",
    "Taught",
    "find_suite",
    "read_suite",
    "refuse_modules",
    "shipped_suites",
    "suite_from_values",
]
