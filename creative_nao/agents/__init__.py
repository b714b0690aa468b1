"""Agents that search the robot's memory for new actions, behind one ask-and-tell interface and one budget.

Interface: `Agent`, `Context`, `AgentOrderError`.
Without rewards: `SupervisedAgent` (the paper's baseline), `ReplayAgent`, `RandomAgent`, `SobolAgent`; the ceiling:
`OracleAgent`. By rule: `LatticeAgent`, `SpreadAgent`, `SpreadPointsAgent`.
Searches: `CmaEsAgent`, `CmaMeAgent`, `MapElitesAgent`, `NoveltySearchAgent`, `BayesianAgent`; the
settings of each are a record in its file. Imagining before performing: `rehearse` any agent, `ImagineAgent`,
`ImagineWithBodyAgent`, `PlanAgent`, `SurrogateAgent`, `LearnedMapAgent`; what the body may refuse: `BodySense`,
`BodySettings`, `PlanWithSenseAgent`, `PlanWithBodyAgent`.
PPO: `PPOSettings`, `train_ppo`; training of PPO, SAC, TD3, RecurrentPPO, TQC and CrossQ: `agents.training`,
`agents.settings`. By name: `NAMES`, `make_agent`. Files: `save_bundle`, `load_bundle`, `load_agent`,
`shipped_agents`. Your own: `as_agent`, `PolicyAgent`, `FunctionAgent`, `load_entry_point`; our agents as a policy:
`AgentPolicy`. torch and the packages of the searches are loaded when they are needed.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
