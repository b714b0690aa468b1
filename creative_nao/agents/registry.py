"""The agents by name."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path

from creative_nao.agents.adapters import PolicyAgent
from creative_nao.agents.algorithms import ALGORITHMS
from creative_nao.agents.base import Agent
from creative_nao.agents.bundle import TrainedPolicy, load_bundle
from creative_nao.agents.random_search import RandomAgent
from creative_nao.agents.shipped import find_bundle, shipped_agents
from creative_nao.agents.supervised import SupervisedAgent
from creative_nao.errors import NotFoundError, SettingsError, nearest_name

UNTRAINED: dict[str, Callable[[], Agent]] = {SupervisedAgent.name: SupervisedAgent, RandomAgent.name: RandomAgent}
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
            or ``module:factory``, something importable that returns an `Agent` or a policy with `predict`.
        bundle: With the name of a trained agent: shipped name or path of its bundle.

    Raises:
        NotFoundError: If no agent is called so, or the bundle does not exist.
        SettingsError: If a trained agent lacks its bundle, or a factory returns something else.
        FileFormatError: If the bundle is damaged.
    """
    if bundle is None and name not in NAMES:
        if name in shipped_agents() or Path(name).is_file():
            return _trained(load_bundle(name))
        if ":" in name:
            return _from_factory(name)
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


def _from_factory(name: str) -> Agent:
    """Return the agent that ``module:factory`` makes; a policy is played as an agent of that name."""
    module_name, _, factory_name = name.partition(":")
    try:
        factory = getattr(importlib.import_module(module_name), factory_name)
    except (ImportError, AttributeError, ValueError) as error:
        raise NotFoundError(f"no agent factory `{name}`: {error}; it should be importable as module:factory") from error
    made = factory()
    if isinstance(made, Agent):
        return made
    if callable(getattr(made, "predict", None)):
        return PolicyAgent(made, name=name)
    raise SettingsError(f"`{name}` should return an Agent or a policy with `predict`, but returned {made!r:.60}")
