"""The memories of an environment, one or a split of the bank, each with the figures that its reward needs."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import numpy as np

from creative_nao.demonstrations import Demonstrations
from creative_nao.errors import NotFoundError, SettingsError, ShapeError, nearest_name, shown
from creative_nao.measures import Criteria, excursion_limit, reward_scale, speed_limits
from creative_nao.measures.outcome import SPEED_TOLERANCE
from creative_nao.model import SPLITS, load_memory, split_memories
from creative_nao.schema import checked


@runtime_checkable
class GeneratingMemory(Protocol):
    """What an environment needs of a memory: `model.Memory` has it, and so may anything else.

    `creative_nao.testing.check_memory` tells whether an object does what is required.
    """

    @property
    def pb(self) -> np.ndarray:
        """Learned PB value of each basic action, shape (n_actions, n_pb) in [-1, 1]."""
        ...

    @property
    def demonstrations(self) -> Demonstrations:
        """The basic actions."""
        ...

    def generate(self, pb: np.ndarray, n_steps: int | None = None) -> np.ndarray:
        """Return trajectories (n, n_steps, n_joints) [rad] of PB points (n, n_pb)."""
        ...


MemoryLike = str | os.PathLike[str] | GeneratingMemory
"""A shipped name, a file, a split of the bank, or a memory itself."""


class RewardSpec:
    """A memory and the figures that the reward of its movements needs, computed once.

    Attributes:
        memory: The memory.
        demonstrations: Its basic actions.
        name: Its name, or empty.
        n_pb: PB units.
        n_steps: Ticks of what it generates.
        scale: Mean pairwise distance of its basic actions, the unit of the reward [rad].
        speed_limit: Speed above which a joint fluctuates [rad/s], shape (n_joints,).
        excursion_limit: Excursion below which an action does not move [rad].
    """

    def __init__(self, memory: GeneratingMemory, criteria: Criteria) -> None:
        self.memory: Any = memory
        self.demonstrations = basic = checked(Demonstrations, memory.demonstrations, "memory.demonstrations")
        if np.ndim(checked(np.ndarray, memory.pb, "memory.pb")) != 2:
            raise ShapeError(f"`memory.pb` should have shape (n_actions, n_pb), but has {memory.pb.shape}")
        self.name = str(getattr(memory, "name", ""))
        self.n_pb = memory.pb.shape[1]
        self.n_steps = max(len(trajectory) for trajectory in basic.trajectories)
        self.scale = reward_scale(basic)
        self.speed_limit = speed_limits(basic, criteria) * SPEED_TOLERANCE
        self.excursion_limit = excursion_limit(basic, criteria)

    def generate(self, pb: np.ndarray) -> np.ndarray:
        """Return the movements of PB points (n, n_pb), (n, n_steps, n_joints) [rad]; another shape: ShapeError.

        Where the network can be stopped between ticks the PB may move: (n, n_steps, n_pb).
        """
        trajectories = self.memory.generate(pb) if pb.ndim == 2 else self.memory.generator(pb, self.n_steps)
        expected = len(pb), self.n_steps, len(self.demonstrations.joints)
        if np.shape(trajectories) != expected:
            raise ShapeError(
                f"memory `{self.name}` should generate trajectories of shape {expected}, "
                f"but gave {np.shape(trajectories)}"
            )
        return np.ascontiguousarray(trajectories, dtype=np.float64)

    @property
    def form(self) -> tuple[Any, ...]:
        """What all memories of one environment have in common."""
        return self.n_pb, self.n_steps, self.demonstrations.n_actions, self.demonstrations.joints


class MemorySet:
    """The memories that an environment may use.

    Args:
        memory: A memory, its name or file, or a split of the bank: `train`, `validation`, `test`.
        criteria: Where the lines between outcomes are drawn.

    Raises:
        NotFoundError: If there is no such memory.
        SettingsError: If it is no memory.
    """

    def __init__(self, memory: MemoryLike, criteria: Criteria) -> None:
        self._criteria = criteria
        self.names = split_memories(memory) if isinstance(memory, str) and memory in SPLITS else ()
        self._specs: dict[str, RewardSpec] = {}
        if self.names:
            self.first = self._load(self.names[0])
        else:
            loaded = load_memory(memory) if isinstance(memory, str | os.PathLike) else memory
            if not isinstance(loaded, GeneratingMemory):
                raise SettingsError(
                    "`memory` should be a name, a file, or an object with `pb`, `demonstrations` and `generate`, "
                    f"but is {shown(memory)}"
                )
            self.first = RewardSpec(loaded, criteria)
            self._specs[self.first.name] = self.first

    def _load(self, name: str) -> RewardSpec:
        if name not in self._specs:
            spec = RewardSpec(load_memory(name), self._criteria)
            if self._specs and spec.form != self.first.form:
                raise SettingsError(
                    f"memory `{name}` should have the PB units, ticks, actions and joints of `{self.first.name}`, "
                    f"{self.first.form}, to serve in one environment, but has {spec.form}"
                )
            self._specs[name] = spec
        return self._specs[name]

    def named(self, wanted: str, where: str = 'options["memory"]') -> RewardSpec:
        """Return the memory of this name; if it is none of the environment's, it raises NotFoundError."""
        known = self.names or (self.first.name,)
        if not isinstance(wanted, str) or wanted not in known:
            raise NotFoundError(
                f"{where}: no memory `{wanted}`{nearest_name(str(wanted), known)} in this environment; "
                f"there are {', '.join(known)}"
            )
        return self._load(wanted) if self.names else self.first

    def draw(self, rng: Callable[[], np.random.Generator]) -> RewardSpec:
        """Return the memory, or one drawn from the split with `rng()`, a generator made only if it is needed."""
        if not self.names:
            return self.first
        return self._load(self.names[int(rng().integers(len(self.names)))])
