"""The ceiling: an agent that has computed the whole map of the memory before it chooses."""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from creative_nao.agents.base import Context
from creative_nao.agents.checks import at_least
from creative_nao.agents.movement import MovementAgent
from creative_nao.errors import SettingsError
from creative_nao.measures import farthest_points
from creative_nao.pb_space import PAPER_RESOLUTION, pb_map


@dataclass(frozen=True)
class OracleSettings:
    """How much the oracle computes beforehand.

    Raises:
        SettingsError: If a value is out of range; the message names the field.
    """

    resolution: int = PAPER_RESOLUTION
    """Points along each axis of the map; 200 are 40,000 generated movements that no other agent is granted."""
    n_planned: int = 30
    """Choices worked out at a time; the next ones follow when they are needed."""

    def __post_init__(self) -> None:
        at_least(self, 2, "resolution")
        at_least(self, 1, "n_planned")


class OracleAgent(MovementAgent):
    """Plays the greedy selection: each movement the farthest from the basic actions and from those before it.

    It imagines the map, so that it is the ceiling where the imagined movement is scored; in physics it is a plan that
    the body may refuse. It draws nothing at random: every seed gives the same choices. Where fewer movements are
    appropriate than the budget allows, the last is repeated, which earns nothing.
    """

    name: ClassVar[str] = "oracle"
    _last_plan: ClassVar[tuple[weakref.ref[Any], OracleSettings, np.ndarray] | None] = None
    """The last plan made, of any oracle: repetitions of an episode chart their memory once."""

    def __init__(self, settings: OracleSettings | None = None):
        self.settings = settings or OracleSettings()

    def start(self, context: Context) -> None:
        """Compute the map, unless the last episode of an oracle was one of the same memory.

        Raises:
            SettingsError: If the context has no memory that can be charted, or nothing on the map is appropriate.
        """
        super().start(context)
        if not hasattr(context.memory, "generate"):
            raise SettingsError(
                f"agent `{self.name}` charts the memory first: `context.memory` should generate movements, "
                f"but is {type(context.memory).__name__}"
            )
        self._plan = self._plan_of(context.memory)
        self._place = 0

    def next_pb(self) -> np.ndarray:
        """Return the next choice of the plan, shape (2,)."""
        if self._place == len(self._plan) and len(self._plan) % self.settings.n_planned == 0:
            self._plan = self._chosen(self.context.memory, self._place + self.settings.n_planned)
        pb = self._plan[min(self._place, len(self._plan) - 1)]
        self._place += 1
        return pb

    def _plan_of(self, memory: Any) -> np.ndarray:
        last = OracleAgent._last_plan
        if last is not None and last[0]() is memory and last[1] == self.settings:
            return last[2]
        plan = self._chosen(memory, self.settings.n_planned)
        OracleAgent._last_plan = (weakref.ref(memory), self.settings, plan)
        return plan

    def _chosen(self, memory: Any, n_actions: int) -> np.ndarray:
        """Return the first `n_actions` greedy choices; those of a shorter plan are their beginning."""
        chart = pb_map(memory, resolution=self.settings.resolution)
        assert chart.trajectories is not None
        if not chart.appropriate.any():
            raise SettingsError(f"agent `{self.name}`: nothing on the map of this memory is appropriate")
        best = farthest_points(chart.trajectories, memory.demonstrations, n_actions, chart.appropriate)
        return chart.pb[best.indices]
