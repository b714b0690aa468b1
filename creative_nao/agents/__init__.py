"""Agents that search the robot's memory for new actions, behind one ask-and-tell interface and one budget.

Interface: `Agent`, `Context`, `AgentOrderError`. Agents: `SupervisedAgent` (the paper's baseline), `RandomAgent`, PPO
(`PPOSettings`, `train_ppo`). By name: `NAMES`, `make_agent`. Files: `save_bundle`, `load_bundle`, `load_agent`,
`shipped_agents`. Training of PPO, SAC, TD3, RecurrentPPO, TQC and CrossQ: `agents.training`, `agents.hyperparameters`.
Other programs' policies: `PolicyAgent`; our agents as a policy: `AgentPolicy`. torch is loaded when a policy is needed.
"""

from creative_nao.agents.adapters import AgentPolicy, Policy, PolicyAgent
from creative_nao.agents.base import Agent, AgentOrderError, Context
from creative_nao.agents.bundle import BundleHeader, TrainedPolicy, load_bundle, save_bundle
from creative_nao.agents.ppo import PPOSettings, TrainingCurve, train_ppo
from creative_nao.agents.random_search import RandomAgent
from creative_nao.agents.registry import NAMES, TRAINED, UNTRAINED, make_agent
from creative_nao.agents.shipped import shipped_agents
from creative_nao.agents.supervised import SupervisedAgent

load_agent = load_bundle

__all__ = [  # noqa: RUF022 - in reading order
    "Agent",
    "Context",
    "AgentOrderError",
    "SupervisedAgent",
    "RandomAgent",
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
    "PolicyAgent",
    "AgentPolicy",
]
