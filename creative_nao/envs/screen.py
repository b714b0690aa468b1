"""What `render` shows: the movements since the last call, as a picture, a film, distances or in a window."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from creative_nao.envs.performers import FRAME_DT_S, Performed, SharedScene
from creative_nao.envs.stage import Stage
from creative_nao.errors import SettingsError

RENDER_MODES = ("human", "rgb_array", "rgb_array_list", "depth_array")


@dataclass(frozen=True)
class Take:
    """One performed movement on film."""

    frames: np.ndarray
    frame_dt_s: float
    text: str


class Screen:
    """Keeps the films of one or many robots and shows them.

    Args:
        shared: Ring, robot and bag.
        mode: One of `RENDER_MODES` or None.
        overlay: Whether colour frames tell outcome, nearest basic action and reward.
        n_robots: How many robots.

    Raises:
        SettingsError: If there is no such mode.
    """

    def __init__(self, shared: SharedScene, mode: str | None, overlay: bool = False, n_robots: int = 1) -> None:
        if mode is not None and mode not in RENDER_MODES:
            raise SettingsError(f"`render_mode` should be one of {', '.join(RENDER_MODES)} or None, but is {mode!r}")
        self._shared, self.mode, self._overlay = shared, mode, overlay
        self._films: list[list[Take]] = [[] for _ in range(n_robots)]
        self._stage: Stage | None = None

    @property
    def wanted(self) -> bool:
        """Whether movements have to be filmed."""
        return self.mode is not None

    def clear(self, robot: int = 0) -> None:
        """Forget the film of a robot."""
        self._films[robot] = []

    def remember(self, robot: int, performed: Performed, text: str) -> None:
        """Keep the snapshots of a performance for `show`."""
        if performed.frames is None:
            return
        if self.mode in ("rgb_array", "depth_array"):
            self._films[robot].clear()  # only the last movement is ever asked for
        self._films[robot].append(Take(performed.frames, performed.frame_dt_s, text))

    def show(self, robot: int = 0) -> Any:
        """Show the film of a robot since the last call, as the environment's `render` tells."""
        if self.mode is None or (self.mode == "human" and not self._films[robot]):
            return None
        if self._stage is None:
            self._stage = Stage(self._shared.scene)
        stage = self._stage
        film = self._films[robot] or [Take(self._shared.scene.guard_qpos()[None], FRAME_DT_S, "")]
        if self.mode in ("rgb_array", "depth_array"):
            widest = stage.widest(film[-1].frames)
            return stage.depth(widest) if self.mode == "depth_array" else self._drawn(stage, widest, film[-1].text)
        self._films[robot] = []
        if self.mode == "human":
            for take in film:
                stage.play(take.frames, take.frame_dt_s)
            return None
        return [self._drawn(stage, snapshot, take.text) for take in film for snapshot in take.frames]

    def _drawn(self, stage: Stage, snapshot: np.ndarray, text: str) -> np.ndarray:
        frame = stage.draw(snapshot)
        if not (self._overlay and text):
            return frame
        from creative_nao.envs.overlay import caption

        return caption(frame, text)

    def close(self) -> None:
        """Close the window and free what drawing took; may be called again."""
        if self._stage is not None:
            self._stage.close()
            self._stage = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_stage": None}  # windows and drawing contexts stay where they are
