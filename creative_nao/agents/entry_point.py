"""Agents of the user's own: `package.module:factory`, typed where the name of an agent is expected.

The module is imported and the factory called: this runs the user's own code, which is the purpose. Only names typed by
the user come here; no file of this project (bundle, memory, result) names code to run.
"""

from __future__ import annotations

import importlib
import os
import sys
from typing import Any

from creative_nao.agents.adapters import as_agent
from creative_nao.agents.base import Agent
from creative_nao.errors import NotFoundError, SettingsError, nearest_name


def is_entry_point(name: str) -> bool:
    """Return whether a name has the form `package.module:factory`."""
    module, colon, factory = name.partition(":")
    return bool(colon) and all(part.isidentifier() for part in (*module.split("."), *factory.split(".")))


def load_entry_point(name: str) -> Agent:
    """Import a module, call its factory and return the agent, listed in results under the name typed.

    The factory takes no arguments and returns an `Agent`, anything with the `predict` of Stable-Baselines3, or a
    function from observations to PB vectors; a subclass of `Agent` is such a factory. The current directory is
    searched after the installed packages.

    Args:
        name: As `package.module:factory`.

    Raises:
        NotFoundError: If there is no such module or factory; the message offers the nearest name.
        SettingsError: If the name has another form, or what it names is no factory of an agent.
    """
    if not is_entry_point(name):
        raise SettingsError(f"an agent of your own is named `package.module:factory`, but this is `{name}`")
    module_name, _, path = name.partition(":")
    found: Any = _module(module_name, name)
    for part in path.split("."):
        if not hasattr(found, part):
            known = [word for word in dir(found) if not word.startswith("_")]
            raise NotFoundError(f"agent `{name}`: `{module_name}` has no `{part}`{nearest_name(part, known)}")
        found = getattr(found, part)
    if not callable(found):
        raise SettingsError(f"agent `{name}` should name a function that makes an agent, but is {found!r}")
    return as_agent(found(), name=name)


def _module(module: str, name: str) -> Any:
    here = os.getcwd()
    if here not in sys.path and "" not in sys.path:
        # An installed command does not search the directory it is called in, where a script of one's own lies.
        sys.path.append(here)
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is not None and (module == error.name or module.startswith(f"{error.name}.")):
            raise NotFoundError(
                f"agent `{name}`: there is no module `{module}`; it should be installed, or lie in {here}"
            ) from error
        raise
