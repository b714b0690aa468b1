"""The memory: a PB-MTRNN (Hwang & Tani 2018) that learns a handful of actions and imagines others.

In reading order:

- Network: `config` (settings and parameters), `encoding` (Eq. 6, 7), `network` (Eq. 1-5 in torch, the reference).
- Training: `training` (one network or many, with checkpoints), `compiled_training` (an epoch, compiled).
- Generation: `memory`, `generation` (in closed loop, at once or a few ticks at a time), `compiled_generation`.
- Recognition: `recognition` (error regression, with derivatives from `compiled_generation`).
- What compiled code shares: `matmul` (the matrix product), `simd` (vectors; exp, tanh, log).

torch is loaded by the reference network only, numba by the first compiled computation.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
