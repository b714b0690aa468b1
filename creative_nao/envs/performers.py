"""How a generated movement becomes the one that is scored: imagined as it is, or performed by the robot's body."""

# MuJoCo tells type checkers nothing about its members.
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from creative_nao.errors import SettingsError
from creative_nao.joints import JOINTS
from creative_nao.robot import PhysicalLimits, first_failure

if TYPE_CHECKING:
    from creative_nao.robot.performance import Performance
    from creative_nao.robot.playback import Performer
    from creative_nao.robot.scene import Scene

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
