"""The ring as a dm_control task: joint targets in, senses out, for controllers that box tick by tick.

The environments of this project perform whole trajectories instead (`robot.Performer`); they run the same compiled
model.
"""

# MuJoCo and PyMJCF tell type checkers nothing about their members.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false, reportMissingImports=false
# pyright: reportIncompatibleMethodOverride=false
from __future__ import annotations

from typing import Any

from creative_nao.robot import headless  # first: it chooses how MuJoCo draws before MuJoCo is imported

# isort: split
import mujoco
import numpy as np
from dm_env import specs

from creative_nao.errors import SettingsError
from creative_nao.joints import JOINTS, N_JOINTS, limits
from creative_nao.robot.arena import PHYSICS_STEP_S
from creative_nao.robot.modelling import composer
from creative_nao.robot.performance import has_fallen, tilt_rad
from creative_nao.robot.scene import BAG_FORCE, Scene

CONTROL_STEP_S = 0.05
TIME_LIMIT_S = 7.5

_SETTLE_S = 2.0

__all__ = ["CONTROL_STEP_S", "TIME_LIMIT_S", "BoxingTask", "headless", "load"]


class BoxingTask(composer.Task):
    """The NAO boxes the bag, standing on its own feet; legs and head hold the guard.

    | | |
    | --- | --- |
    | action | targets of the eight arm joints [rad], shape (8,), order and bounds of `joints` |
    | `nao/joint_positions` | angles of the eight arm joints [rad], shape (8,) |
    | `nao/joint_velocities` | their speeds [rad/s], shape (8,) |
    | `nao/touch` | force on left fist, left foot, right fist, right foot [N], shape (4,) |
    | `bag/swing` | angles of the bag at its hook [rad], shape (2,) |
    | `bag/swing_velocity` | its angular speeds [rad/s], shape (2,) |
    | reward | impulse that robot and bag exchanged during the step [N s], at least 0 |
    | end | the robot falls (discount 0), or the time is over |

    An episode starts in the settled guard; `start_noise_rad` turns each arm joint by a uniform random angle of up to
    that size.

    Args:
        control_step_s: Time between actions [s], a whole number of 5 ms physics steps.
        start_noise_rad: Randomness of the first posture [rad].

    Raises:
        SettingsError: If `control_step_s` is not a whole number of physics steps or `start_noise_rad` is negative.
    """

    def __init__(self, *, control_step_s: float = CONTROL_STEP_S, start_noise_rad: float = 0.0) -> None:
        steps = round(control_step_s / PHYSICS_STEP_S)
        if steps < 1 or abs(control_step_s - steps * PHYSICS_STEP_S) > 1e-9:
            raise SettingsError(
                f"`control_step_s` should be a whole number of physics steps of {PHYSICS_STEP_S} s, "
                f"but is {control_step_s}."
            )
        if start_noise_rad < 0:
            raise SettingsError(f"`start_noise_rad` should be at least 0, but is {start_noise_rad}.")
        self.scene = Scene()
        self._noise_rad = start_noise_rad
        self._impulse_ns = 0.0
        self._settled: np.ndarray | None = None
        self.set_timesteps(control_timestep=steps * PHYSICS_STEP_S, physics_timestep=PHYSICS_STEP_S)
        self.scene.robot.observables.enable_all()
        assert self.scene.bag is not None
        self.scene.bag.observables.enable_all()

    @property
    def root_entity(self) -> composer.Entity:
        """The ring, with robot and bag in it."""
        return self.scene.arena

    def action_spec(self, physics: Any) -> specs.BoundedArray:
        """Targets of the eight arm joints [rad]."""
        low, high = limits()
        return specs.BoundedArray((N_JOINTS,), np.float64, low, high, name="\t".join(JOINTS))

    def after_compile(self, physics: Any, random_state: np.random.RandomState) -> None:
        """Let the scene use the model that the environment compiled."""
        self.scene.adopt(physics)
        self._settled = None

    def initialize_episode(self, physics: Any, random_state: np.random.RandomState) -> None:
        """Stand in the settled guard, with the arms turned by the start noise."""
        model, data, index = physics.model.ptr, physics.data.ptr, self.scene.index
        if self._settled is None:
            self._settled = self._settle(model)
        mujoco.mj_setState(model, data, self._settled, mujoco.mjtState.mjSTATE_INTEGRATION)
        if self._noise_rad > 0:
            low, high = limits()
            noise = random_state.uniform(-self._noise_rad, self._noise_rad, N_JOINTS)
            start = np.clip(data.qpos[index.arm_qpos] + noise, low, high)
            data.qpos[index.arm_qpos] = start
            data.ctrl[index.arm_actuator] = start
        self._impulse_ns = 0.0

    def _settle(self, model: Any) -> np.ndarray:
        """Return the state of standing in the guard at rest, computed once."""
        data = mujoco.MjData(model)
        self.scene.place(data, "Guard")
        mujoco.mj_step(model, data, nstep=round(_SETTLE_S / PHYSICS_STEP_S))
        data.time = 0.0
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(mujoco.mj_stateSize(model, kind))
        mujoco.mj_getState(model, data, state, kind)
        return state

    def before_step(self, physics: Any, action: np.ndarray, random_state: np.random.RandomState) -> None:
        """Give the arms their targets."""
        physics.data.ctrl[self.scene.index.arm_actuator] = action
        self._impulse_ns = 0.0

    def after_substep(self, physics: Any, random_state: np.random.RandomState) -> None:
        """Add up what the bag feels."""
        force = physics.named.data.sensordata[BAG_FORCE]
        self._impulse_ns += float(np.linalg.norm(force)) * PHYSICS_STEP_S

    def get_reward(self, physics: Any) -> float:
        """Impulse between robot and bag during the step [N s]."""
        return self._impulse_ns

    def should_terminate_episode(self, physics: Any) -> bool:
        """The episode ends when the robot falls."""
        return self._fell(physics)

    def get_discount(self, physics: Any) -> float:
        """0 after a fall, else 1."""
        return 0.0 if self._fell(physics) else 1.0

    def _fell(self, physics: Any) -> bool:
        start = self.scene.index.torso_qpos
        torso = physics.data.qpos[start : start + 7][None]
        return has_fallen(torso[:, 2], tilt_rad(torso[:, 3:]))


def load(
    *,
    seed: int | None = None,
    control_step_s: float = CONTROL_STEP_S,
    time_limit_s: float = TIME_LIMIT_S,
    start_noise_rad: float = 0.0,
) -> composer.Environment:
    """Return the ring as a dm_control environment, like `suite.load`.

    The robot's `Scene` is `env.task.scene`; it shares the compiled model, so `robot.Performer(env.task.scene)` performs
    trajectories with the very same physics.

    Args:
        seed: Seeds the start noise; None draws a fresh one.
        control_step_s: Time between actions [s], a whole number of 5 ms physics steps.
        time_limit_s: Length of an episode [s].
        start_noise_rad: Randomness of the first posture [rad].

    Raises:
        SettingsError: If a time is not usable or the noise negative.

    Example:
        >>> env = load(seed=0)
        >>> env.reset().observation["nao/joint_positions"].shape
        (8,)
    """
    if time_limit_s <= 0:
        raise SettingsError(f"`time_limit_s` should be positive, but is {time_limit_s}.")
    task = BoxingTask(control_step_s=control_step_s, start_noise_rad=start_noise_rad)
    env = composer.Environment(
        task,
        # Simulated time is a sum of steps and ends a little below the exact product: half a step makes the count exact.
        time_limit=time_limit_s - control_step_s / 2,
        random_state=seed,
        recompile_mjcf_every_episode=False,
        strip_singleton_obs_buffer_dim=True,
    )
    env.reset()  # composer compiles once more at the first reset; from here on the model stays
    return env
