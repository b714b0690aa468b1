"""The agents by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from creative_nao.agents.adapters import PolicyAgent
from creative_nao.agents.algorithms import ALGORITHMS
from creative_nao.agents.base import Agent
from creative_nao.agents.bayesian import BayesianAgent
from creative_nao.agents.bundle import TrainedPolicy, load_bundle
from creative_nao.agents.cma_es import CmaEsAgent
from creative_nao.agents.cma_me import CmaMeAgent
from creative_nao.agents.entry_point import load_entry_point
from creative_nao.agents.learned_replay import ReplayAgent
from creative_nao.agents.map_elites import MapElitesAgent
from creative_nao.agents.novelty_search import NoveltySearchAgent
from creative_nao.agents.oracle import OracleAgent
from creative_nao.agents.random_search import RandomAgent
from creative_nao.agents.shipped import find_bundle, shipped_agents
from creative_nao.agents.sobol import SobolAgent
from creative_nao.agents.supervised import SupervisedAgent
from creative_nao.errors import NotFoundError, SettingsError, nearest_name

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
