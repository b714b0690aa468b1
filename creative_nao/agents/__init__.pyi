from .base import (
    Agent,
    AgentOrderError,
    Context,
    Policy,
    PolicyAgent,
)
from .black_box import (
    BayesianAgent,
    CmaEsAgent,
    OracleAgent,
    RandomAgent,
    ReplayAgent,
    SobolAgent,
    SupervisedAgent,
)
from .bundle import (
    BundleHeader,
    TrainedPolicy,
    load_agent,
    load_bundle,
    save_bundle,
    shipped_agents,
)
from .cells import (
    CellPolicy,
    CellSACPolicy,
    FlippedSwappedAxes,
)
from .quality_diversity import (
    CmaMeAgent,
    MapElitesAgent,
    NoveltySearchAgent,
)
from .registry import (
    NAMES,
    TRAINED,
    UNTRAINED,
    AgentPolicy,
    FunctionAgent,
    as_agent,
    load_entry_point,
    make_agent,
)
from .training import (
    PPOSettings,
    TrainingCurve,
    train_ppo,
)

__all__ = [
    "NAMES",
    "TRAINED",
    "UNTRAINED",
    "Agent",
    "AgentOrderError",
    "AgentPolicy",
    "BayesianAgent",
    "BundleHeader",
    "CellPolicy",
    "CellSACPolicy",
    "CmaEsAgent",
    "CmaMeAgent",
    "Context",
    "FlippedSwappedAxes",
    "FunctionAgent",
    "MapElitesAgent",
    "NoveltySearchAgent",
    "OracleAgent",
    "PPOSettings",
    "Policy",
    "PolicyAgent",
    "RandomAgent",
    "ReplayAgent",
    "SobolAgent",
    "SupervisedAgent",
    "TrainedPolicy",
    "TrainingCurve",
    "as_agent",
    "load_agent",
    "load_bundle",
    "load_entry_point",
    "make_agent",
    "save_bundle",
    "shipped_agents",
    "train_ppo",
]
