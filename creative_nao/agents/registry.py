"""The agents by name.

Also here:
- Agents of the user's own: `package.module:factory`, typed where the name of an agent is expected.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from creative_nao.agents.adapters import PolicyAgent, as_agent
from creative_nao.agents.algorithms import ALGORITHMS
from creative_nao.agents.base import Agent
from creative_nao.agents.black_box import (
    BayesianAgent,
    CmaEsAgent,
    OracleAgent,
    RandomAgent,
    ReplayAgent,
    SobolAgent,
    SupervisedAgent,
)
from creative_nao.agents.bundle import TrainedPolicy, find_bundle, load_bundle, shipped_agents
from creative_nao.agents.quality_diversity import CmaMeAgent, MapElitesAgent, NoveltySearchAgent
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


UNTRAINED: dict[str, Callable[[], Agent]] = {
    SupervisedAgent.name: SupervisedAgent,
    ReplayAgent.name: ReplayAgent,
    RandomAgent.name: RandomAgent,
    SobolAgent.name: SobolAgent,
    CmaEsAgent.name: CmaEsAgent,
    CmaMeAgent.name: CmaMeAgent,
    MapElitesAgent.name: MapElitesAgent,
    NoveltySearchAgent.name: NoveltySearchAgent,
    BayesianAgent.name: BayesianAgent,
    OracleAgent.name: OracleAgent,
}
"""Agents that need no training."""

TRAINED = tuple(ALGORITHMS)
"""Agents that are trained first and come out of a bundle."""

NAMES: tuple[str, ...] = (*UNTRAINED, *TRAINED)


def check_name(name: str) -> str:
    """Return `name` if an agent is called so.

    Raises:
        NotFoundError: If none is; the message offers the nearest name.
    """
    if name not in NAMES:
        raise NotFoundError(f"no agent `{name}`{nearest_name(name, NAMES)}; there are: {', '.join(NAMES)}")
    return name


def make_agent(name: str, bundle: str | Path | None = None) -> Agent:
    """Make an agent.

    Args:
        name: One of `NAMES`; or a trained agent by shipped name, such as ``ppo/BoxingMental-v0``, or path of a bundle;
            or ``package.module:factory``, the user's own code, which is imported and called (`load_entry_point`).
        bundle: With the name of a trained agent: shipped name or path of its bundle.

    Raises:
        NotFoundError: If no agent is called so, or the bundle does not exist.
        SettingsError: If a trained agent lacks its bundle, or a factory makes no agent.
        FileFormatError: If the bundle is damaged.
    """
    if bundle is None and name not in NAMES:
        if name in shipped_agents() or Path(name).is_file():
            return _trained(load_bundle(name))
        if ":" in name:
            return load_entry_point(name)
        if "/" in name:
            find_bundle(name)
    check_name(name)
    if name in UNTRAINED:
        return UNTRAINED[name]()
    if bundle is None:
        raise SettingsError(f"agent `{name}` is trained first: `bundle` should be the path of its bundle, but is None")
    trained = load_bundle(bundle)
    if trained.header.agent != name:
        raise SettingsError(f"`bundle` should hold a `{name}` agent, but {bundle} holds `{trained.header.agent}`")
    return _trained(trained)


def _trained(trained: TrainedPolicy) -> Agent:
    return PolicyAgent(trained, deterministic=trained.header.deterministic, name=trained.header.agent)
