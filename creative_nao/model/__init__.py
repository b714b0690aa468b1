"""The memory: a PB-MTRNN (Hwang & Tani 2018) that learns a handful of actions and imagines others.

Using: `load_memory`, `shipped_memories`, `Memory`.
Making: `train`, `train_network`, `NetworkSettings`, `TrainingSettings`.
Inside: `encoding` (Eq. 6, 7), `mtrnn` (Eq. 1-3, 5, in torch), `loss` (Eq. 4), `fused` (the same compiled),
`generation`.

torch is loaded by the reference network only, not by using or training a memory with the compiled engine.
"""

from creative_nao.model.config import NetworkSettings, TrainingSettings
from creative_nao.model.memory import Memory
from creative_nao.model.shipped import CONDITIONS, load_memory, shipped_memories
from creative_nao.model.training import train, train_network, train_side_by_side

__all__ = [
    "CONDITIONS",
    "Memory",
    "NetworkSettings",
    "TrainingSettings",
    "load_memory",
    "shipped_memories",
    "train",
    "train_network",
    "train_side_by_side",
]
