"""What the robot was taught, again and again: the learned PB vectors, then points close to them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from creative_nao.agents.base import Context
from creative_nao.agents.checks import positive
from creative_nao.agents.movement import MovementAgent
from creative_nao.errors import SettingsError


@dataclass(frozen=True)
class ReplaySettings:
    """How far replay strays.

    Raises:
        SettingsError: If a value is out of range; the message names the field.
    """

    spread: float = 0.1
    """Standard deviation of the steps away from a learned PB vector, in each PB unit; the square is 2 wide."""

    def __post_init__(self) -> None:
        positive(self, "spread")


class ReplayAgent(MovementAgent):
    """Plays each learned PB vector once, then goes round them with a normal deviation, clipped to the space.

    What comes of doing what was taught, and of doing it inexactly. It needs a memory that tells its learned PB vectors.
    """

    name: ClassVar[str] = "replay"

    def __init__(self, settings: ReplaySettings | None = None):
        self.settings = settings or ReplaySettings()

    def start(self, context: Context) -> None:
        """Read the learned PB vectors.

        Raises:
            SettingsError: If the context has no memory.
        """
        super().start(context)
        if context.memory is None:
            raise SettingsError(f"agent `{self.name}` plays learned PB vectors: `context.memory` should tell them")
        self._learned = np.asarray(context.memory.pb, np.float64)
        self._place = 0

    def next_pb(self) -> np.ndarray:
        """Return a learned PB vector or a point close to one, shape (n_pb,)."""
        turn, which = divmod(self._place, len(self._learned))
        self._place += 1
        space, pb = self.context.action_space, self._learned[which]
        if turn:
            pb = pb + self.context.rng.normal(0.0, self.settings.spread, pb.shape)
        return np.clip(pb, space.low, space.high)
