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
from .recognition import (
    Recognition,
)
from .training import (
    Trained,
    checkpoint_of,
    reproduction,
    train,
    train_many,
    train_network,
)

__all__ = [
    "CONDITIONS",
    "SPLITS",
    "Memory",
    "NetworkSettings",
    "Recognition",
    "Trained",
    "TrainingSettings",
    "Walk",
    "checkpoint_of",
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
