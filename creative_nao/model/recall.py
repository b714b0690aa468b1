"""Recall: does a memory give its basic actions back? And the conditions by name under which memories are trained."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from creative_nao.errors import SettingsError, shown
from creative_nao.measures import Criteria, dtw
from creative_nao.model.config import AUTO, TrainingSettings, check_kind
from creative_nao.model.memory import CONDITIONS, Memory


def reproduction(memory: Any) -> list[float]:
    """Return the DTW distance of each basic action to what its learned PB generates in closed loop [rad].

    Takes a `Memory` or whatever else generates movements, as a control does.
    """
    if not (hasattr(memory, "generate") and hasattr(memory, "pb")):
        check_kind(memory, Memory, "memory")
    pairs = zip(memory.generate(memory.pb), memory.demonstrations.trajectories, strict=True)
    return [dtw(generated[: len(action)], action) for generated, action in pairs]


@dataclasses.dataclass(frozen=True)
class RecallReport:
    """How well a memory gives its basic actions back from their learned PB values, and the verdict on it in words.

    Attributes:
        distances: DTW distance of each action, by name, to what its PB value generates in closed loop [rad].
        training: How the memory was trained.
        threshold: Up to which distance an action comes back [rad].
    """

    distances: dict[str, float]
    training: TrainingSettings
    threshold: float = Criteria().learned_threshold

    @classmethod
    def of(cls, memory: Memory) -> RecallReport:
        """Measure a memory."""
        return cls(dict(zip(memory.demonstrations.names, reproduction(memory), strict=True)), memory.training)

    @property
    def missing(self) -> tuple[str, ...]:
        """The actions that do not come back."""
        return tuple(name for name, distance in self.distances.items() if not distance <= self.threshold)

    def __str__(self) -> str:
        """Return the verdict: how many come back, which do not, and what to try."""
        n, limit, missing = len(self.distances), f"within DTW {self.threshold:g} in closed loop", self.missing
        if not missing:
            return f"all {n} basic actions come back {limit}, the worst at {max(self.distances.values()):.2f}"
        named = ", ".join(f"{name} ({self.distances[name]:.1f})" for name in missing)
        told = f"{n - len(missing)} of {n} basic actions come back {limit}; not: {named}"
        if {name: getattr(self.training, name) for name in AUTO} != AUTO:
            return f"{told}. Try the condition auto, which trains from the posture where movements are generated"
        return f"{told}. Try more epochs or another seed, fewer actions, or a network with larger layers"


@dataclasses.dataclass(frozen=True, eq=False)
class Trained:
    """The result of training one network.

    Attributes:
        training: How it was to be trained.
        memory: The result; None if training failed.
        failure: Why there is none, for example a loss that is no longer finite; None otherwise.
    """

    training: TrainingSettings
    memory: Memory | None
    failure: str | None

    def reproduction(self) -> list[float]:
        """Return the DTW distance of each basic action to what its learned PB generates in closed loop [rad]."""
        return [] if self.memory is None else reproduction(self.memory)

    def succeeded(self, threshold: float = Criteria().learned_threshold) -> bool:
        """Tell whether every basic action comes back in closed loop within `threshold` [rad]."""
        return self.memory is not None and max(self.reproduction()) <= threshold


def condition_settings(condition: str | None, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of a condition by name; an unknown one, or a ratio given beside it, is a SettingsError."""
    if condition is None:
        return {}
    known = (*CONDITIONS, "auto")
    if condition not in known:
        raise SettingsError(f"`condition` should be one of {', '.join(known)}, but is {shown(condition)}")
    if "closed_loop_ratio" in given:
        raise SettingsError("`condition` and `closed_loop_ratio` say the same thing: leave out one of them")
    return {"condition": "auto"} if condition == "auto" else {"closed_loop_ratio": CONDITIONS[condition]}
