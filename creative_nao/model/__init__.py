"""The memory: a PB-MTRNN (Hwang & Tani 2018) that learns a handful of actions and imagines others.

Using: `load_memory`, `shipped_memories`, `Memory`; `Recognition` (`recognition`, what `Memory.infer_pb` finds);
`walk`, `Walk` (`paths`, movements along a line through the PB space).
Making: `train`, `train_network`, `NetworkSettings`, `TrainingSettings`.
Inside, in reading order:

- Network: `config` (settings), `encoding` (Eq. 6, 7), `parameters` (the numbers that are learned), `mtrnn` (Eq. 1-3, 5,
  in torch, written to be read), `loss` (Eq. 4).
- Training: `campaign` (many networks), `training` (one, with checkpoints), `schedule`, `targets`, `engine` (compiled or
  readable), `checkpoint`; compiled: `compiled_network`, `fused` (the epoch), `layout` (where its numbers lie),
  `product` (its matrix product); `autograd` (its gradient for torch).
- Generation: `memory`, `generation`, compiled: `lanes`; `stepping` (stopped between ticks), `paths` (a PB that moves).
- Recognition: `recognition`, `slopes`, compiled: `recognition_kernel`; `error_regression` (the descents).
- What compiled code shares: `kernels` (exp, tanh, log), `sums`, `vectors` (SIMD).

torch is loaded by the reference network only, not by using or training a memory with the compiled engine.
"""

from creative_nao.model.config import NetworkSettings, TrainingSettings
from creative_nao.model.memory import (
    CONDITIONS,
    SPLITS,
    Memory,
    load_memory,
    shipped_memories,
    shipped_scores,
    split_memories,
    split_of,
)
from creative_nao.model.multi_seed import Trained, checkpoint_of, reproduction, train, train_many
from creative_nao.model.paths import Walk, walk
from creative_nao.model.recognition import Recognition
from creative_nao.model.training import train_network

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
