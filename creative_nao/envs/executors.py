"""How a generated movement becomes the one that is scored: imagined as it is, or performed by the robot's body.

Also here:
- Threads that help a vector environment: compiled code and MuJoCo run side by side, Python does not.
"""

from __future__ import annotations

import functools
import queue
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from creative_nao.errors import SettingsError
from creative_nao.joints import JOINTS
from creative_nao.robot import PhysicalLimits, first_failure
from creative_nao.runtime import usable_cores

if TYPE_CHECKING:
    from creative_nao.robot.performance import Performance
    from creative_nao.robot.playback import Performer
    from creative_nao.robot.scene import Scene


# MuJoCo tells type checkers nothing about its members.
# pyright: reportAttributeAccessIssue=false


FRAME_DT_S = 0.05
"""Time between two frames of a film [s]."""


@dataclass(frozen=True)
class Performed:
    """One action as it was performed.

    Attributes:
        trajectory: What is scored [rad], shape (n_steps, n_joints): generated in the mind or measured on the robot.
        fault: Physical outcome that makes it inappropriate, or None.
        figures: Further numbers for `info`.
        frames: Snapshots of the whole robot for a film, (n_frames, nq), if asked for.
        frame_dt_s: Time between them [s].
    """

    trajectory: np.ndarray
    fault: str | None = None
    figures: dict[str, Any] = field(default_factory=dict)
    frames: np.ndarray | None = None
    frame_dt_s: float = FRAME_DT_S


class SharedScene:
    """Ring, robot and bag, built when first needed; copies and pickles build their own."""

    @functools.cached_property
    def scene(self) -> Scene:
        """The scene."""
        from creative_nao.robot.scene import Scene

        return Scene()

    def __getstate__(self) -> dict[str, Any]:
        return {}


class Mind:
    """Imagines: what is generated is what is scored."""

    def __init__(self, shared: SharedScene) -> None:
        self._shared = shared

    def perform(self, generated: np.ndarray, dt_s: float, joints: tuple[str, ...], keep_frames: bool) -> Performed:
        """Take a trajectory (n_steps, n_joints) [rad] as performed.

        Raises:
            SettingsError: If frames are wanted of joints that the NAO's arms do not have.
        """
        if not keep_frames:
            return Performed(generated)
        if joints != JOINTS:
            raise SettingsError(
                f"only movements of the joints {', '.join(JOINTS)} can be drawn, "
                f"but this memory has {', '.join(joints)}"
            )
        from creative_nao.robot.film import imagined_frames

        frames = imagined_frames(self._shared.scene, generated, dt_s, frame_dt_s=FRAME_DT_S)
        return Performed(generated, frames=frames)


class Body:
    """Lets the NAO perform what was generated; what its encoders measured is scored.

    Args:
        shared: Where it stands.
        limits: From where on a performance counts as failed.
    """

    def __init__(self, shared: SharedScene, limits: PhysicalLimits) -> None:
        self._shared, self.limits = shared, limits
        self._kept: np.ndarray | None = None

    @functools.cached_property
    def performer(self) -> Performer:
        """The robot in its ring, built when first needed."""
        from creative_nao.robot.playback import Performer

        performer = Performer(self._shared.scene)
        if self._kept is not None:
            performer.set_state(self._kept)
        return performer

    def perform(self, generated: np.ndarray, dt_s: float, joints: tuple[str, ...], keep_frames: bool) -> Performed:
        """Perform a trajectory (n_steps, 8) [rad]."""
        done = self.performer.perform(generated, dt_s, keep_frames=keep_frames)
        figures = {"commanded": generated, **body_figures(done)}
        return Performed(done.measured, first_failure(done, self.limits), figures, done.frames, done.frame_dt_s)

    def reset(self) -> None:
        """Let the robot stand in the settled guard."""
        self.performer.reset()

    def get_state(self) -> np.ndarray:
        """Return MuJoCo's integration state at the end of the last action."""
        return self.performer.get_state()

    def set_state(self, state: np.ndarray) -> None:
        """Put the robot into a state of `get_state`."""
        self._kept = np.array(state)
        if "performer" in self.__dict__:
            self.performer.set_state(self._kept)

    def __getstate__(self) -> dict[str, Any]:
        kept = self.get_state() if "performer" in self.__dict__ else self._kept
        return {"_shared": self._shared, "limits": self.limits, "_kept": kept}


def body_figures(done: Performance) -> dict[str, Any]:
    """Return what `info` and physical maps tell of a performance, in the units of `BoxingEnv`'s page."""
    return {
        "tracking_error": float(done.mean_error_rad.max()),
        "torque_saturated": float(done.saturated_share.max()),
        "self_collision": done.self_collision_share,
        "fell": done.fell,
        "hits": done.hits.count,
        "hit_impulse": done.hits.impulse_ns,
        "fist_speed": float(done.fist_peak_speed_m_s.max()),
    }


def check_arms(joints: tuple[str, ...]) -> None:
    """Refuse memories of other joints than the NAO's arms.

    Raises:
        SettingsError: Naming both.
    """
    if joints != JOINTS:
        raise SettingsError(
            f"the NAO performs memories of the joints {', '.join(JOINTS)}, but this one has {', '.join(joints)}"
        )


LEAST = 8
"""Fewest movements a thread is given: below, handing them over costs more than it saves."""


class Crew:
    """A few threads, started when first needed; copies and pickles start their own.

    Args:
        n_threads: How many; None for one a processor core.

    Raises:
        SettingsError: If it is below 1.
    """

    def __init__(self, n_threads: int | None = None) -> None:
        if n_threads is not None and n_threads < 1:
            raise SettingsError(f"`n_threads` should be at least 1 or None, but is {n_threads}")
        self.n_threads = n_threads or usable_cores()
        self._pool: ThreadPoolExecutor | None = None

    def map(self, function: Callable[[Any], Any], pieces: Sequence[Any]) -> list[Any]:
        """Return what `function` makes of each piece, in order; an error of one is raised here."""
        if self.n_threads == 1 or len(pieces) < 2:
            return [function(piece) for piece in pieces]
        return list(self._threads().map(function, pieces))

    def share(self, work: Callable[[np.ndarray], None], places: np.ndarray) -> None:
        """Cut places into even pieces, one a thread unless they would become too small, and let each be worked on.

        The calling thread takes the first piece, which saves waking another.

        Args:
            work: Called with some of the places; keeps what it finds where no other piece does.
            places: Shape (m,).
        """
        first, *others = np.array_split(places, max(1, min(self.n_threads, len(places) // LEAST)))
        started = [self._threads().submit(work, piece) for piece in others]
        try:
            work(first)
        finally:
            wait(started)  # also after an error: nobody may still write when the caller goes on
        for one in started:
            one.result()

    def _threads(self) -> ThreadPoolExecutor:
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.n_threads, thread_name_prefix="creative-nao")
        return self._pool

    def close(self) -> None:
        """End the threads; a later call of `map` starts new ones."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def __getstate__(self) -> dict[str, Any]:
        return {"n_threads": self.n_threads, "_pool": None}


class Bodies:
    """A robot a thread, all in one scene; each performs from the settled guard, so it does not matter which one does.

    Args:
        crew: The threads.
        shared: Where the robots stand.
        limits: From where on a performance counts as failed.
    """

    def __init__(self, crew: Crew, shared: SharedScene, limits: PhysicalLimits) -> None:
        self._crew, self._shared, self.limits = crew, shared, limits
        self._idle: queue.SimpleQueue[Body] | None = None
        self._guard: np.ndarray | None = None

    def perform(
        self, generated: np.ndarray, dt_s: Sequence[float], joints: tuple[str, ...], keep_frames: bool
    ) -> tuple[list[Performed], np.ndarray]:
        """Perform trajectories (m, n_steps, 8) [rad]; return what came of them and the states they ended in, (m, n)."""
        idle = self._ready()

        def one(place: int) -> tuple[Performed, np.ndarray]:
            body = idle.get()
            try:
                return body.perform(generated[place], dt_s[place], joints, keep_frames), body.get_state()
            finally:
                idle.put(body)

        found = self._crew.map(one, range(len(generated)))
        return [performed for performed, _ in found], np.stack([state for _, state in found])

    def guard(self) -> np.ndarray:
        """Return MuJoCo's state of the settled guard, (n,)."""
        self._ready()
        assert self._guard is not None
        return self._guard

    def _ready(self) -> queue.SimpleQueue[Body]:
        if self._idle is None:
            self._idle = queue.SimpleQueue()
            for _ in range(self._crew.n_threads):
                body = Body(self._shared, self.limits)
                body.reset()
                self._guard = body.get_state()
                self._idle.put(body)
        return self._idle

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_idle": None, "_guard": None}
