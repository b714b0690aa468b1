"""Agents that search the robot's memory for new actions, behind one ask-and-tell interface and one budget.

Interface: `Agent`, `Context`, `AgentOrderError`.
Without rewards: `SupervisedAgent` (the paper's baseline), `ReplayAgent`, `RandomAgent`, `SobolAgent`; the ceiling:
`OracleAgent`. Searches: `CmaEsAgent`, `CmaMeAgent`, `MapElitesAgent`, `NoveltySearchAgent`, `BayesianAgent`; the
settings of each are a dataclass in its file.
PPO: `PPOSettings`, `train_ppo`; training of PPO, SAC, TD3, RecurrentPPO, TQC and CrossQ: `agents.training`,
`agents.hyperparameters`. By name: `NAMES`, `make_agent`. Files: `save_bundle`, `load_bundle`, `load_agent`,
`shipped_agents`. Your own: `as_agent`, `PolicyAgent`, `FunctionAgent`, `load_entry_point`; our agents as a policy:
`AgentPolicy`. torch and the packages of the searches are loaded when they are needed.
"""

from creative_nao.agents.adapters import AgentPolicy, FunctionAgent, Policy, PolicyAgent, as_agent
from creative_nao.agents.base import Agent, AgentOrderError, Context
from creative_nao.agents.bayesian import BayesianAgent
from creative_nao.agents.bundle import BundleHeader, TrainedPolicy, load_bundle, save_bundle
from creative_nao.agents.cma_es import CmaEsAgent
from creative_nao.agents.cma_me import CmaMeAgent
from creative_nao.agents.entry_point import load_entry_point
from creative_nao.agents.learned_replay import ReplayAgent
from creative_nao.agents.map_elites import MapElitesAgent
from creative_nao.agents.novelty_search import NoveltySearchAgent
from creative_nao.agents.oracle import OracleAgent
from creative_nao.agents.ppo import PPOSettings, TrainingCurve, train_ppo
from creative_nao.agents.random_search import RandomAgent
from creative_nao.agents.registry import NAMES, TRAINED, UNTRAINED, make_agent
from creative_nao.agents.shipped import shipped_agents
from creative_nao.agents.sobol import SobolAgent
from creative_nao.agents.supervised import SupervisedAgent

load_agent = load_bundle

__all__ = [  # noqa: RUF022 - in reading order
    "Agent",
    "Context",
    "AgentOrderError",
    "SupervisedAgent",
    "ReplayAgent",
    "RandomAgent",
    "SobolAgent",
    "OracleAgent",
    "CmaEsAgent",
    "CmaMeAgent",
    "MapElitesAgent",
    "NoveltySearchAgent",
    "BayesianAgent",
    "PPOSettings",
    "TrainingCurve",
    "train_ppo",
    "NAMES",
    "UNTRAINED",
    "TRAINED",
    "make_agent",
    "BundleHeader",
    "TrainedPolicy",
    "save_bundle",
    "load_bundle",
    "load_agent",
    "shipped_agents",
    "Policy",
    "as_agent",
    "PolicyAgent",
    "FunctionAgent",
    "load_entry_point",
    "AgentPolicy",
]
