"""The memory: a PB-MTRNN (Hwang & Tani 2018) that learns a handful of actions and imagines others.

In reading order:

- Network: `config` (settings and parameters), `encoding` (Eq. 6, 7), `network` (Eq. 1-5 in torch, the reference).
- Training: `training` (one network or many, with checkpoints), `compiled_training` (an epoch, compiled).
- Generation: `memory`, `generation` (in closed loop, at once or a few ticks at a time), `compiled_generation`.
- Recognition: `recognition` (error regression, with derivatives from `compiled_generation`).
- What compiled code shares: `matmul` (the matrix product), `simd` (vectors; exp, tanh, log).

torch is loaded by the reference network only, numba by the first compiled computation.
"""

from creative_nao.model.config import NetworkSettings, TrainingSettings
from creative_nao.model.memory import (
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
from creative_nao.model.recognition import Recognition
from creative_nao.model.training import Trained, checkpoint_of, reproduction, train, train_many, train_network

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
