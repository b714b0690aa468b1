"""How a generated movement becomes the one that is scored: taken as it is, or performed by the robot in physics."""

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
from creative_nao.schema import Count, checked

if TYPE_CHECKING:
    from creative_nao.robot.performance import Performance
    from creative_nao.robot.playback import Performer
    from creative_nao.robot.scene import Scene

FRAME_DT_S = 0.05
"""Time between two frames of a film [s]."""
MIN_ROWS = 8
"""Fewest rows a thread is given: below, handing them over costs more than it saves."""


@dataclass(frozen=True)
class Execution:
    """One movement as it was executed.

    Attributes:
        trajectory: What is scored [rad], shape (n_steps, n_joints): as generated, or as measured on the robot.
        fault: Physical outcome that makes it inappropriate, or None.
        figures: Further numbers for `info`.
        frames: Snapshots of the whole robot every `FRAME_DT_S`, (n_frames, nq), if asked for.
    """

    trajectory: np.ndarray
    fault: str | None = None
    figures: dict[str, Any] = field(default_factory=dict)
    frames: np.ndarray | None = None


class SharedScene:
    """Ring, robot and bag, built when first needed; copies and pickles build their own.

    A `bare` one leaves away all that is only drawn, which makes physics a sixth faster.
    """

    def __init__(self, bare: bool = False) -> None:
        self.bare = bare

    @functools.cached_property
    def scene(self) -> Scene:
        """The scene."""
        from creative_nao.robot import Scene, bare_scene

        return bare_scene() if self.bare else Scene()

    def __getstate__(self) -> dict[str, Any]:
        return {"bare": self.bare}


class ThreadPool:
    """Threads that share the work on a batch; started when first needed, copies and pickles start their own.

    Args:
        n_threads: How many, at least 1; None for one a processor core.
    """

    def __init__(self, n_threads: int | None = None) -> None:
        self.n_threads: int = usable_cores() if n_threads is None else checked(Count, n_threads, "n_threads")
        self._executor: ThreadPoolExecutor | None = None

    @property
    def _threads(self) -> ThreadPoolExecutor:
        if self._executor is None:
            self._executor = ThreadPoolExecutor(self.n_threads, thread_name_prefix="creative-nao")
        return self._executor

    def map(self, function: Callable[[Any], Any], items: Sequence[Any]) -> list[Any]:
        """Return what `function` makes of each item, in order; an error of one is raised here."""
        if self.n_threads == 1 or len(items) < 2:
            return [function(item) for item in items]
        return list(self._threads.map(function, items))

    def map_rows(
        self,
        function: Callable[[Any], tuple[np.ndarray, ...]],
        n_rows: int,
        order: Callable[[], np.ndarray] | None = None,
    ) -> tuple[np.ndarray, ...]:
        """Apply a function of arrays to all rows of a batch, an even piece of them a thread.

        The calling thread takes the first piece, which saves waking another. `function` is called with an index of some
        rows and returns arrays over them; returned are those over all rows, (n_rows, ...). `order` returns the rows in
        the order in which they are cut into pieces, if that matters.
        """
        n_pieces = min(self.n_threads, n_rows // MIN_ROWS)
        if n_pieces < 2:
            return function(slice(None))
        rows = np.arange(n_rows) if order is None else order()
        first, *others = np.array_split(rows, n_pieces)
        started = [self._threads.submit(function, piece) for piece in others]
        try:
            results = [function(first)]
        finally:
            wait(started)  # also after an error: no thread may still work when the caller goes on
        results += [future.result() for future in started]
        whole = map(np.concatenate, zip(*results, strict=True))
        if order is None:
            return tuple(whole)
        back = np.argsort(rows)
        return tuple(array[back] for array in whole)

    def close(self) -> None:
        """End the threads; a later call starts new ones."""
        if self._executor is not None:
            self._executor.shutdown(cancel_futures=True)
            self._executor = None

    def __getstate__(self) -> dict[str, Any]:
        return {"n_threads": self.n_threads, "_executor": None}


class PhysicsPool:
    """A simulated robot a thread, all in one scene.

    MuJoCo steps without holding Python back, so two threads on two free cores perform twice as much. Every performance
    starts from the settled guard: it has the same bits whichever robot performs it.
    """

    def __init__(self, threads: ThreadPool, shared: SharedScene) -> None:
        self._threads, self._shared = threads, shared

    @functools.cached_property
    def performers(self) -> list[Performer]:
        """The robots, built when first needed."""
        from creative_nao.robot.playback import Performer

        return [Performer(self._shared.scene) for _ in range(self._threads.n_threads)]

    @property
    def built(self) -> bool:
        """Whether the robots are there already."""
        return "performers" in self.__dict__

    def perform(
        self, trajectories: np.ndarray, dt_s: Sequence[float], keep_frames: bool = False
    ) -> list[tuple[Performance, np.ndarray]]:
        """Perform trajectories (m, n_steps, 8) [rad] at m ticks of `dt_s` [s], if wanted with snapshots for a film.

        Returns the performance of each, and MuJoCo's integration state at its end, (n,).
        """
        idle: queue.SimpleQueue[Performer] = queue.SimpleQueue()
        for performer in self.performers:
            idle.put(performer)

        def perform_one(k: int) -> tuple[Performance, np.ndarray]:
            performer = idle.get()
            try:
                return performer.perform(trajectories[k], dt_s[k], keep_frames=keep_frames), performer.get_state()
            finally:
                idle.put(performer)

        return self._threads.map(perform_one, range(len(trajectories)))

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "performers"}


def imagined_executions(
    shared: SharedScene, joints: tuple[str, ...], generated: np.ndarray, dt_s: Sequence[float]
) -> list[Execution]:
    """Return generated movements (m, n_steps, n_joints) [rad] as if executed, with snapshots; only NAO arms."""
    if joints != JOINTS:
        raise SettingsError(
            f"only movements of the joints {', '.join(JOINTS)} can be drawn, but this memory has {', '.join(joints)}"
        )
    from creative_nao.robot.film import imagined_frames

    return [
        Execution(movement, frames=imagined_frames(shared.scene, movement, dt, frame_dt_s=FRAME_DT_S))
        for movement, dt in zip(generated, dt_s, strict=True)
    ]


class PhysicsExecutor:
    """Lets the simulated NAO perform what was generated; what its encoders measured is scored.

    Args:
        n_envs: Number of environments. With one, the `data` of its robot always is the environment's state.
        threads: Threads, a robot each.
        shared: Where the robots stand.
        limits: From where on a performance counts as failed.
        joints: Joints of the memory.

    Raises:
        SettingsError: If these are not the joints of the NAO's arms.
    """

    def __init__(
        self, n_envs: int, threads: ThreadPool, shared: SharedScene, limits: PhysicalLimits, joints: tuple[str, ...]
    ) -> None:
        if joints != JOINTS:
            raise SettingsError(
                f"the NAO performs memories of the joints {', '.join(JOINTS)}, but this one has {', '.join(joints)}"
            )
        self.limits, self.pool = limits, PhysicsPool(threads, shared)
        self._ends: list[np.ndarray | None] = [None] * n_envs
        """State at the end of each environment's last action; None: the settled guard."""

    def performer(self, env_id: int) -> Performer:
        """Return a robot in the state of this environment; that of an only environment is always its own."""
        if not self.pool.built or len(self._ends) > 1:
            self._show(self._ends[env_id])
        return self.pool.performers[0]

    def _show(self, state: np.ndarray | None) -> None:
        performer = self.pool.performers[0]
        if state is None:
            performer.reset()
        else:
            performer.set_state(state)

    def execute(
        self, env_ids: np.ndarray, generated: np.ndarray, dt_s: Sequence[float], keep_frames: bool
    ) -> list[Execution]:
        """Perform movements (m, n_steps, 8) [rad] at ticks of `dt_s` [s]."""
        executions = []
        performed = self.pool.perform(generated, dt_s, keep_frames)
        for env_id, (performance, end) in zip(env_ids, performed, strict=True):
            self._ends[env_id] = end
            figures = {"commanded": performance.commanded, **physics_figures(performance)}
            fault = first_failure(performance, self.limits)
            executions.append(Execution(performance.measured, fault, figures, performance.frames))
        return executions

    def reset(self, env_id: int) -> None:
        """Let the robot stand in the settled guard."""
        self._ends[env_id] = None
        if len(self._ends) == 1 and self.pool.built:
            self._show(None)

    def get_state(self, env_id: int) -> dict[str, np.ndarray]:
        """Return MuJoCo's integration state at the end of the last action."""
        end = self._ends[env_id]
        if end is None:
            self._show(None)
            end = self.pool.performers[0].get_state()
        return {"physics": end.copy()}

    def set_state(self, env_id: int, arrays: dict[str, np.ndarray]) -> None:
        """Put the robot of an environment into a state of `get_state`."""
        self._ends[env_id] = np.array(arrays["physics"])
        if len(self._ends) == 1 and self.pool.built:
            self._show(self._ends[env_id])


NO_FIGURES: dict[str, Any] = {
    "tracking_error": 0.0, "torque_saturated": 0.0, "self_collision": 0.0, "fell": False, "hits": 0, "hit_impulse": 0.0,
    "fist_speed": 0.0,
}  # fmt: skip
"""What `physics_figures` returns, of no movement."""


def physics_figures(performance: Performance) -> dict[str, Any]:
    """Return the figures of a performance for `info` and physical maps, in the units of the page of `BoxingEnv`."""
    return {
        "tracking_error": float(performance.mean_error_rad.max()),
        "torque_saturated": float(performance.saturated_share.max()),
        "self_collision": performance.self_collision_share,
        "fell": performance.fell,
        "hits": performance.hits.count,
        "hit_impulse": performance.hits.impulse_ns,
        "fist_speed": float(performance.fist_peak_speed_m_s.max()),
    }
