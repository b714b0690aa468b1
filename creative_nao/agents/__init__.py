"""Agents that search the robot's memory for new actions, behind one ask-and-tell interface and one budget.

Interface: `Agent`, `Context`, `AgentOrderError`.
Without rewards: `SupervisedAgent` (the paper's baseline), `ReplayAgent`, `RandomAgent`, `SobolAgent`; the ceiling:
`OracleAgent`. Searches: `CmaEsAgent`, `CmaMeAgent`, `MapElitesAgent`, `NoveltySearchAgent`, `BayesianAgent`; the
settings of each are a record in its file.
PPO: `PPOSettings`, `train_ppo`; training of PPO, SAC, TD3, RecurrentPPO, TQC and CrossQ: `agents.training`,
`agents.settings`. By name: `NAMES`, `make_agent`. Files: `save_bundle`, `load_bundle`, `load_agent`,
`shipped_agents`. Your own: `as_agent`, `PolicyAgent`, `FunctionAgent`, `load_entry_point`; our agents as a policy:
`AgentPolicy`. torch and the packages of the searches are loaded when they are needed.
"""

from typing import Any

from creative_nao.agents.base import Agent, AgentOrderError, Context, Policy, PolicyAgent
from creative_nao.agents.black_box import (
    BayesianAgent,
    CmaEsAgent,
    OracleAgent,
    RandomAgent,
    ReplayAgent,
    SobolAgent,
    SupervisedAgent,
)
from creative_nao.agents.bundle import BundleHeader, TrainedPolicy, load_bundle, save_bundle, shipped_agents
from creative_nao.agents.quality_diversity import CmaMeAgent, MapElitesAgent, NoveltySearchAgent
from creative_nao.agents.registry import (
    NAMES,
    TRAINED,
    UNTRAINED,
    AgentPolicy,
    FunctionAgent,
    as_agent,
    load_entry_point,
    make_agent,
)
from creative_nao.agents.training import PPOSettings, TrainingCurve, train_ppo

load_agent = load_bundle


def __getattr__(name: str) -> Any:
    """Load what needs torch when it is named: RL Zoo imports it from here."""
    if name in ("CellPolicy", "CellSACPolicy", "FlippedSwappedAxes"):
        from creative_nao.agents import cells

        return getattr(cells, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = [  # noqa: RUF022 - in reading order
    "Agent", "Context", "AgentOrderError", "SupervisedAgent", "ReplayAgent", "RandomAgent", "SobolAgent",
    "OracleAgent", "CmaEsAgent", "CmaMeAgent", "MapElitesAgent", "NoveltySearchAgent", "BayesianAgent",
    "PPOSettings", "TrainingCurve", "train_ppo", "NAMES", "UNTRAINED", "TRAINED", "make_agent",
    "BundleHeader", "TrainedPolicy", "save_bundle", "load_bundle", "load_agent", "shipped_agents", "Policy",
    "as_agent", "PolicyAgent", "FunctionAgent", "load_entry_point", "AgentPolicy",
]  # fmt: skip
