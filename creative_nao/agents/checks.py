"""What the settings of several agents have in common: ranges, and packages that may be missing."""

from __future__ import annotations

import importlib
import importlib.util
from types import ModuleType
from typing import Any

from creative_nao.errors import MissingDependencyError, SettingsError


def at_least(settings: Any, least: int, *names: str) -> None:
    """Refuse fields of a settings dataclass below `least`.

    Raises:
        SettingsError: Naming the field.
    """
    for name in names:
        if getattr(settings, name) < least:
            raise SettingsError(f"`{name}` should be at least {least}, but is {getattr(settings, name)}")


def positive(settings: Any, *names: str) -> None:
    """Refuse fields of a settings dataclass that are not above 0.

    Raises:
        SettingsError: Naming the field.
    """
    for name in names:
        if not getattr(settings, name) > 0:
            raise SettingsError(f"`{name}` should be above 0, but is {getattr(settings, name)}")


def require_extra(*, package: str, extra: str, agent: str) -> None:
    """Refuse an agent whose optional package is not installed, without importing it.

    Args:
        package: What to look for, by the name under which it is imported.
        extra: The extra of creative-nao that brings it.
        agent: Which agent needs it.

    Raises:
        MissingDependencyError: Naming package and extra.
    """
    if importlib.util.find_spec(package) is None:
        raise _missing(package, extra, agent, "it is not installed")


def load_extra(module: str, *, package: str, extra: str, agent: str) -> ModuleType:
    """Import a module of an optional package.

    Args:
        module: What to import.
        package: The package that holds it.
        extra: The extra of creative-nao that brings it.
        agent: Which agent needs it.

    Raises:
        MissingDependencyError: Naming package and extra.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise _missing(package, extra, agent, error) from error


def _missing(package: str, extra: str, agent: str, why: object) -> MissingDependencyError:
    return MissingDependencyError(
        f'agent `{agent}` needs the package `{package}`: pip install "creative-nao[{extra}]" ({why})'
    )
