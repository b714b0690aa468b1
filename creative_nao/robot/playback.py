"""Perform a trajectory with the standing robot in physics, always from the same initial state.

The servos of the arms get a new target every 10 ms, the cycle of the robot's device controller, and go there in a
straight line within the cycle; legs and head hold the guard.
Stepping happens inside `mujoco.rollout`: bit for bit the states of a loop over `mj_step`, without its cost in Python.
"""

# The bindings of MuJoCo have no static types.
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

import math
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.joints import JOINTS, MAX_SPEED_RAD_S, N_JOINTS, joint_angles, limits, read_encoder
from creative_nao.robot import interpolation
from creative_nao.robot.performance import Hits, Performance, has_fallen, tilt_rad
from creative_nao.robot.scene import PERFORMANCE_SENSORS, Index, Scene
from creative_nao.schema import NonNegative, Positive, checked, record

CYCLE_S = 0.010  # a new target for the servos every cycle
_WHOLE = 1e-6


@record
class PlaybackSettings:
    """How a performance starts."""

    settle_s: NonNegative = 2.0
    """Standing in the guard before the first performance, once; the state at its end starts every performance [s]."""
    approach_speed_rad_s: Positive = 2.0
    """Largest speed on the way from the guard to the first posture."""
    approach_min_s: NonNegative = 0.2
    """Shortest time for that way."""
    frame_dt_s: Positive = 0.05
    """Time between the snapshots kept for a film [s]."""


@record
class RobotVariation:
    """How one robot differs from the published one; the defaults are the published robot itself.

    No two robots are alike, and several figures of this one are estimates: domain randomisation.
    """

    mass: Positive = 1.0
    """Factor of the mass and inertia of every link."""
    friction: Positive = 1.0
    """Factor of the friction of soles, gloves, floor and bag."""
    kp: Positive = 1.0
    """Factor of the proportional gains of all servos."""
    kd: Positive = 1.0
    """Factor of their derivative gains."""
    latency_s: NonNegative = 0.0
    """Time from a command to its arrival at the servos of the arms [s]; rounded to whole cycles of 10 ms."""
    encoder_noise_rad: NonNegative = 0.0
    """Standard deviation of what is added to an angle before the encoder counts it [rad]."""


class Varied:
    """Applies variations to one compiled `mujoco.MjModel`, and restores it, for everyone who simulates with it."""

    def __init__(self, model: Any, index: Index) -> None:
        self._model = model
        self._links = np.flatnonzero(model.body_rootid == model.body_rootid[index.torso])
        self._mass, self._inertia = model.body_mass.copy(), model.body_inertia.copy()
        self._friction = model.geom_friction.copy()
        self._gain, self._bias = model.actuator_gainprm.copy(), model.actuator_biasprm.copy()

    def apply(self, variation: RobotVariation) -> None:
        """Give the model this variation, whatever it had before; the default one restores every bit."""
        model, links = self._model, self._links
        model.body_mass[links] = variation.mass * self._mass[links]
        model.body_inertia[links] = variation.mass * self._inertia[links]
        model.geom_friction[:] = variation.friction * self._friction
        model.actuator_gainprm[:] = variation.kp * self._gain
        # A position servo is gain kp and bias (0, -kp, -kd).
        model.actuator_biasprm[:] = self._bias
        model.actuator_biasprm[:, 1] *= variation.kp
        model.actuator_biasprm[:, 2] *= variation.kd
        mujoco.mj_setConst(model, mujoco.MjData(model))


class Performer:
    """Performs trajectories with the robot of one scene.

    Every performance starts from the same settled guard, so that equal trajectories give equal bits in any order. From
    the guard the arms first move smoothly (minimum jerk) to the first posture; if it is the guard, they just start.
    Between ticks the targets follow a monotone cubic; they are clipped to the joint ranges and move no faster than the
    joints' no-load speed.

    Not safe to share between threads; make one performer a thread, they may share a scene; None is a new one.

    Attributes:
        data: The `mujoco.MjData` after the last performance, or in the settled guard.
        guard: Arm angles that the servos hold in the guard [rad], shape (8,).
    """

    def __init__(self, scene: Scene | None = None, settings: PlaybackSettings | None = None) -> None:
        self.scene = scene or Scene()
        self.settings = settings or PlaybackSettings()
        model = self.scene.model
        self.data = mujoco.MjData(model)
        self._substeps = round(CYCLE_S / model.opt.timestep)
        self._step_s = CYCLE_S / self._substeps
        self._sensors = _sensor_columns(model)
        self._varied: Varied | None = None
        self._latency_cycles, self._noise_rad = 0, 0.0
        self._rng: np.random.Generator | None = None
        self._settle()

    def vary(self, variation: RobotVariation, rng: np.random.Generator) -> None:
        """Perform from now on with a robot that differs, and settle it anew; `RobotVariation()` restores the published.

        The model of the scene is changed for everyone who simulates with it. `rng` draws the noise of the encoders.
        """
        if self._varied is None:
            self._varied = Varied(self.scene.model, self.scene.index)
        self._varied.apply(variation)
        self._latency_cycles = round(variation.latency_s / CYCLE_S)
        self._noise_rad, self._rng = variation.encoder_noise_rad, rng
        self._settle()
        self.reset()

    def _settle(self) -> None:
        """Stand in the guard until at rest and keep that state: the start of every performance."""
        model, data = self.scene.model, self.data
        self.scene.place(data, "Guard")
        mujoco.mj_step(model, data, nstep=round(self.settings.settle_s / self._step_s))
        data.time = 0.0
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        self._start = np.empty(mujoco.mj_stateSize(model, kind))
        mujoco.mj_getState(model, data, self._start, kind)
        self._warmstart = data.qacc_warmstart.copy()
        self._control = data.ctrl.copy()
        self.guard = data.ctrl[self.scene.index.arm_actuator].copy()

    def reset(self) -> None:
        """Put `data` back into the settled guard; a performance does not need it."""
        model, data = self.scene.model, self.data
        mujoco.mj_setState(model, data, self._start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        data.qacc_warmstart[:] = self._warmstart
        data.ctrl[:] = self._control
        mujoco.mj_forward(model, data)

    def get_state(self) -> np.ndarray:
        """Return MuJoCo's whole integration state of `data`, shape (n,), for `set_state`."""
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(mujoco.mj_stateSize(self.scene.model, kind))
        mujoco.mj_getState(self.scene.model, self.data, state, kind)
        return state

    def set_state(self, state: np.ndarray) -> None:
        """Put `data` into a state of `get_state`, else ShapeError; performances start from the settled guard anyway."""
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        size = mujoco.mj_stateSize(self.scene.model, kind)
        if np.shape(state) != (size,):
            raise ShapeError(f"`state` should have shape ({size},), but has {np.shape(state)}.")
        mujoco.mj_setState(self.scene.model, self.data, np.asarray(state, np.float64), kind)
        mujoco.mj_forward(self.scene.model, self.data)
        # Forward dynamics leave a warm start of their own; the state that was set is the one to give back.
        mujoco.mj_setState(self.scene.model, self.data, np.asarray(state, np.float64), kind)

    def perform(self, trajectory: np.ndarray, dt_s: float, *, keep_frames: bool = False) -> Performance:
        """Perform a trajectory and measure it.

        Args:
            trajectory: Joint angles [rad], shape (n_steps, 8), columns in the order of `joints.JOINTS`.
            dt_s: Time between rows [s]; a whole number of 10 ms cycles.
            keep_frames: Keep snapshots of the whole robot for a film.

        Raises:
            ShapeError: If the trajectory is not (n_steps >= 1, 8) finite angles.
            SettingsError: If `dt_s` is not a whole number of cycles.
        """
        trajectory = joint_angles(trajectory, "trajectory", JOINTS)
        cycles_per_tick = _cycles(dt_s)
        targets, approach = self._targets(trajectory, dt_s, cycles_per_tick)
        late = min(self._latency_cycles, len(targets))  # cycles until a target has reached the servos
        delayed = np.concatenate([np.repeat(self.guard[None], late, axis=0), targets[: len(targets) - late]])
        states, sensors = self._run(delayed)

        asked = targets[approach:]
        index = self.scene.index
        low, high = limits()
        qpos = states[:, 1 : 1 + self.scene.model.nq]
        n_steps = len(asked) * self._substeps
        during = qpos[len(qpos) - 1 - n_steps :]
        felt = {name: sensors[len(sensors) - n_steps :, columns] for name, columns in self._sensors.items()}
        each_cycle = during[:: self._substeps, index.arm_qpos]
        error = np.abs(each_cycle[1:] - asked) if len(asked) else np.abs(each_cycle - trajectory)
        torso = qpos[:, index.torso_qpos : index.torso_qpos + 7]
        tilt = tilt_rad(torso[:, 3:])
        saturated = np.abs(felt["torque"]) >= 0.999 * index.arm_effort_nm
        frame_every = max(1, round(self.settings.frame_dt_s / self._step_s))
        angles = each_cycle[::cycles_per_tick]
        if self._noise_rad > 0 and self._rng is not None:
            angles = angles + self._rng.normal(0.0, self._noise_rad, angles.shape)
        return Performance(
            measured=read_encoder(angles),
            commanded=trajectory,
            dt_s=dt_s,
            mean_error_rad=error.mean(axis=0),
            max_error_rad=error.max(axis=0),
            saturated_share=_share(saturated),
            limit_excess_rad=float(np.maximum(low - trajectory, trajectory - high).max(initial=0.0)),
            self_collision_share=float(_share(felt["self"][:, 0] > 0)),
            fell=has_fallen(torso[:, 2], tilt),
            lowest_torso_m=float(torso[:, 2].min()),
            largest_tilt_rad=float(tilt.max()),
            hits=Hits.from_force(np.linalg.norm(felt["bag"], axis=1), self._step_s),
            fist_peak_speed_m_s=np.linalg.norm(felt["fists"].reshape(-1, 2, 3), axis=2).max(axis=0, initial=0.0),
            frames=during[::frame_every].copy() if keep_frames else None,
            frame_dt_s=frame_every * self._step_s if keep_frames else 0.0,
        )

    def _targets(self, trajectory: np.ndarray, dt_s: float, cycles_per_tick: int) -> tuple[np.ndarray, int]:
        """Return the target at the end of every cycle, shape (n_cycles, 8), and the cycles of the approach."""
        low, high = limits()
        fine = np.clip(interpolation.refine(trajectory, dt_s, cycles_per_tick), low, high)
        away = float(np.abs(fine[0] - self.guard).max())
        n_approach = 0
        if away > 0:
            seconds = max(self.settings.approach_min_s, 1.875 * away / self.settings.approach_speed_rad_s)
            n_approach = math.ceil(seconds / CYCLE_S)
        way = interpolation.minimum_jerk(self.guard, fine[0], n_approach) if n_approach else np.empty((0, N_JOINTS))
        fastest = np.array([MAX_SPEED_RAD_S[joint] for joint in JOINTS]) * CYCLE_S
        return interpolation.limit_speed(np.concatenate([way, fine[1:]]), self.guard, fastest), n_approach

    def _run(self, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Step through all cycles; return the state after and the sensors within every physics step."""
        n_steps = len(targets) * self._substeps
        if n_steps == 0:
            return self._start[None], np.zeros((0, self.scene.model.nsensordata))
        control = np.broadcast_to(self._control, (n_steps, len(self._control))).copy()
        control[:, self.scene.index.arm_actuator] = interpolation.ramp(self.guard, targets, self._substeps)
        states = np.empty((1, n_steps, len(self._start)))
        sensors = np.empty((1, n_steps, self.scene.model.nsensordata))
        mujoco.rollout.rollout(
            self.scene.model,
            self.data,
            self._start[None],
            control[None],
            initial_warmstart=self._warmstart[None],
            state=states,
            sensordata=sensors,
        )
        return np.concatenate([self._start[None], states[0]]), sensors[0]


def _share(flags: np.ndarray) -> np.ndarray:
    return flags.mean(axis=0) if len(flags) else np.zeros(flags.shape[1:])


def _sensor_columns(model: Any) -> dict[str, np.ndarray]:
    """Return where the sensors that a performance reads stand in `sensordata`."""

    def columns(*names: str) -> np.ndarray:
        found = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, name) for name in names]
        starts = [(int(model.sensor_adr[row]), int(model.sensor_dim[row])) for row in found if row >= 0]
        return np.concatenate([np.arange(0)] + [np.arange(start, start + size) for start, size in starts])

    return {purpose: columns(*names) for purpose, names in PERFORMANCE_SENSORS.items()}


def _cycles(dt_s: float) -> int:
    dt_s = checked(float, dt_s, "dt_s")
    cycles = round(dt_s / CYCLE_S)
    if cycles < 1 or abs(dt_s - cycles * CYCLE_S) > _WHOLE:
        raise SettingsError(
            f"`dt_s` should be a whole number of the robot's {CYCLE_S * 1000:g} ms cycles (0.01, 0.02, ...), "
            f"but is {dt_s}; resample the trajectory."
        )
    return cycles
