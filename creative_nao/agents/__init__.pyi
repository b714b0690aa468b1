from .augmentation import (
    FlippedSwappedAxes,
)
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
    LatticeAgent,
    OracleAgent,
    RandomAgent,
    ReplayAgent,
    SobolAgent,
    SpreadAgent,
    SpreadPointsAgent,
    SupervisedAgent,
)
from .body_sense import (
    BodySense,
    shipped_sense,
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
)
from .learned_map.agent import (
    LearnedMapAgent,
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
from .rehearsal import (
    BodySettings,
    ImagineAgent,
    ImagineWithBodyAgent,
    PlanAgent,
    PlanningAgent,
    PlanWithBodyAgent,
    PlanWithSenseAgent,
    Rehearsal,
    RehearsalSettings,
    rehearse,
)
from .surrogate import (
    SurrogateAgent,
)
from .training import (
    PPOSettings,
    TrainingCurve,
    train_ppo,
)
from .tries import (
    TryPolicy,
)

__all__ = [
    "NAMES",
    "TRAINED",
    "UNTRAINED",
    "Agent",
    "AgentOrderError",
    "AgentPolicy",
    "BayesianAgent",
    "BodySense",
    "BodySettings",
    "BundleHeader",
    "CellPolicy",
    "CellSACPolicy",
    "CmaEsAgent",
    "CmaMeAgent",
    "Context",
    "FlippedSwappedAxes",
    "FunctionAgent",
    "ImagineAgent",
    "ImagineWithBodyAgent",
    "LatticeAgent",
    "LearnedMapAgent",
    "MapElitesAgent",
    "NoveltySearchAgent",
    "OracleAgent",
    "PPOSettings",
    "PlanAgent",
    "PlanWithBodyAgent",
    "PlanWithSenseAgent",
    "PlanningAgent",
    "Policy",
    "PolicyAgent",
    "RandomAgent",
    "Rehearsal",
    "RehearsalSettings",
    "ReplayAgent",
    "SobolAgent",
    "SpreadAgent",
    "SpreadPointsAgent",
    "SupervisedAgent",
    "SurrogateAgent",
    "TrainedPolicy",
    "TrainingCurve",
    "TryPolicy",
    "as_agent",
    "load_agent",
    "load_bundle",
    "load_entry_point",
    "make_agent",
    "rehearse",
    "save_bundle",
    "shipped_agents",
    "shipped_sense",
    "train_ppo",
]
