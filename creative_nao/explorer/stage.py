"""Where an imagined movement meets the body: the robot of the page, and its performances in physics."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from creative_nao.explorer.body import Body
from creative_nao.robot import Performer, first_failure


class Stage:
    """One robot for all tabs; performances happen one after the other."""

    def __init__(self) -> None:
        self.body = Body()
        self._lock = threading.Lock()
        self._performer: Performer | None = None

    def perform(self, trajectory: np.ndarray, dt_s: float) -> tuple[dict[str, Any], str]:
        """Let the robot perform a trajectory in physics.

        Args:
            trajectory: Joint angles [rad], shape (n_steps, 8).
            dt_s: Time between rows [s].

        Returns:
            The clip for the browser, and what the body made of it in words.
        """
        with self._lock:
            if self._performer is None:
                self._performer = Performer(self.body.scene)
            performance = self._performer.perform(trajectory, dt_s, keep_frames=True)
            clip = self.body.clip(performance)
        failure = first_failure(performance)
        hits = performance.hits
        felt = (
            f"{hits.count} hits of the bag, hardest {hits.peak_force_n:.0f} N" if hits.count else "the bag is not hit"
        )
        verdict = f"the body refuses: {failure.replace('_', ' ')}" if failure else "the body can do it"
        return clip, f"{verdict}; {felt}; mean error {performance.mean_error_rad.max():.3f} rad"
