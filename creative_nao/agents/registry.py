"""The agents by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from creative_nao.agents.adapters import PolicyAgent
from creative_nao.agents.base import Agent
from creative_nao.agents.bundle import load_bundle
from creative_nao.agents.random_search import RandomAgent
from creative_nao.agents.supervised import SupervisedAgent
from creative_nao.errors import NotFoundError, SettingsError, nearest_name

UNTRAINED: dict[str, Callable[[], Agent]] = {SupervisedAgent.name: SupervisedAgent, RandomAgent.name: RandomAgent}
"""Agents that need no training."""

TRAINED = ("ppo",)
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
    """Make an agent by name.

    Args:
        name: One of `NAMES`.
        bundle: Agent bundle of a trained agent; the others take none.

    Raises:
        NotFoundError: If no agent is called so, or the bundle does not exist.
        SettingsError: If a trained agent lacks its bundle.
        FileFormatError: If the bundle is damaged.
    """
    check_name(name)
    if name in UNTRAINED:
        return UNTRAINED[name]()
    if bundle is None:
        raise SettingsError(f"agent `{name}` is trained first: `bundle` should be the path of its bundle, but is None")
    trained = load_bundle(bundle)
    if trained.header.agent != name:
        raise SettingsError(f"`bundle` should hold a `{name}` agent, but {bundle} holds `{trained.header.agent}`")
    return PolicyAgent(trained, deterministic=trained.header.settings.deterministic, name=name)
