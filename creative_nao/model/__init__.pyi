from .config import (
    NetworkSettings,
    TrainingSettings,
)
from .memory import (
    CONDITIONS,
    SPLITS,
    Memory,
    Walk,
    load_memory,
    shipped_memories,
    shipped_scores,
    split_memories,
    split_of,
    walk,
)
from .recall import (
    RecallReport,
    Trained,
    condition_settings,
    reproduction,
)
from .recognition import (
    Recognition,
)
from .training import (
    checkpoint_of,
    train,
    train_many,
    train_network,
)

__all__ = [
    "CONDITIONS",
    "SPLITS",
    "Memory",
    "NetworkSettings",
    "RecallReport",
    "Recognition",
    "Trained",
    "TrainingSettings",
    "Walk",
    "checkpoint_of",
    "condition_settings",
    "load_memory",
    "reproduction",
    "shipped_memories",
    "shipped_scores",
    "split_memories",
    "split_of",
    "train",
    "train_many",
    "train_network",
    "walk",
]
