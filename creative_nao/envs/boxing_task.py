"""The ring as a dm_control task: joint targets in, senses out, for controllers that box tick by tick.

The only file that needs dm_control. Entity, arena and task are built by composer from the same MJCF files as
`robot.Scene`, and compile to the same physics. The environments of this project perform whole trajectories instead
(`robot.Performer`) and need MuJoCo alone.
"""

# The bindings of MuJoCo and the elements of PyMJCF have no static types; dm_control may be missing.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false, reportMissingImports=false
# pyright: reportIncompatibleMethodOverride=false
from __future__ import annotations

import contextlib
import functools
import os
from collections.abc import Iterator
from typing import Annotated, Any

import creative_nao.robot  # noqa: F401 - it chooses how MuJoCo draws, which must come before MuJoCo

# isort: split
import mujoco
import numpy as np

from creative_nao.errors import MissingDependencyError, SettingsError, nearest_name
from creative_nao.joints import JOINTS, N_JOINTS, limits
from creative_nao.robot import opengl
from creative_nao.robot.performance import has_fallen, tilt_rad
from creative_nao.robot.scene import BAG_FORCE, BAG_XML, NAO_XML, RING_XML, Scene
from creative_nao.schema import Field, NonNegative, Positive, checked

try:
    import dm_env

    try:
        from dm_control import _render
    except ModuleNotFoundError:
        raise
    except Exception:  # its import fails where its back end does; BoxingTask draws by a context of its own
        word = os.environ.get("MUJOCO_GL", "")
        os.environ["MUJOCO_GL"] = "disable"
        from dm_control import _render  # noqa: F401

        os.environ["MUJOCO_GL"] = word
    from dm_control import composer, mjcf
    from dm_control._render import base, executor
    from dm_control.composer import define
    from dm_control.composer.observation import observable
    from dm_control.mujoco import engine
    from dm_control.rl import control
    from dm_env import specs
except ModuleNotFoundError as error:
    if error.name not in ("dm_control", "dm_env"):
        raise
    raise MissingDependencyError(
        "`creative_nao.envs.load` needs dm-control, which pip cannot install on Python 3.13 (labmaze, which it asks "
        "for, has no wheel there); `gymnasium.make` and everything else work without it"
    ) from None

CONTROL_STEP_S = 0.05
TIME_LIMIT_S = 7.5


class Ring(composer.Arena):
    """The empty ring of `ring.xml`, with its physics options."""

    def _build(self, name: str = "ring") -> None:
        super()._build(name, str(RING_XML))


class Nao(composer.Entity):
    """The robot of `nao.xml`; give it a free joint when attaching it. The torso frame is the root."""

    def _build(self) -> None:
        self._mjcf_root = mjcf.from_path(str(NAO_XML))

    def _build_observables(self) -> NaoObservables:
        return NaoObservables(self)

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        """The robot alone: no floor, no light, no option."""
        return self._mjcf_root

    @property
    def arm_joints(self) -> list[Any]:
        """The eight arm hinges, in the order of `joints.JOINTS`."""
        return [self._mjcf_root.find("joint", joint) for joint in JOINTS]


class NaoObservables(composer.Observables):
    """What the robot senses of itself; all are off until enabled."""

    @define.observable
    def joint_positions(self) -> observable.MJCFFeature:
        """Angles of the eight arm joints [rad], shape (8,)."""
        return observable.MJCFFeature("qpos", self._entity.arm_joints)

    @define.observable
    def joint_velocities(self) -> observable.MJCFFeature:
        """Speeds of the eight arm joints [rad/s], shape (8,)."""
        return observable.MJCFFeature("qvel", self._entity.arm_joints)

    @define.observable
    def touch(self) -> observable.MJCFFeature:
        """Normal force on left fist, left foot, right fist, right foot [N], shape (4,)."""
        sensors = [sensor for sensor in self._entity.mjcf_model.find_all("sensor") if sensor.tag == "touch"]
        return observable.MJCFFeature("sensordata", sensors)


class Bag(composer.Entity):
    """The punching bag of `bag.xml`; its root is the hook."""

    def _build(self) -> None:
        self._mjcf_root = mjcf.from_path(str(BAG_XML))

    def _build_observables(self) -> BagObservables:
        return BagObservables(self)

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        """The bag alone."""
        return self._mjcf_root


class BagObservables(composer.Observables):
    """How the bag swings about x (sideways) and y (away from the robot) at its hook; off until enabled."""

    @define.observable
    def swing(self) -> observable.MJCFFeature:
        """Angles of both hinges [rad], shape (2,)."""
        return observable.MJCFFeature("qpos", self._entity.mjcf_model.find_all("joint"))

    @define.observable
    def swing_velocity(self) -> observable.MJCFFeature:
        """Angular speeds of both hinges [rad/s], shape (2,)."""
        return observable.MJCFFeature("qvel", self._entity.mjcf_model.find_all("joint"))


class RingContext(base.ContextBase):
    """Draws for dm_control as `robot.Renderer` does: in any thread, whatever was imported before."""

    def __init__(self, gl: opengl.EGLContext | opengl.MujocoContext) -> None:
        self._pid, self._gl = os.getpid(), gl
        super().__init__(0, 0, executor.PassthroughRenderExecutor)

    def _platform_init(self, width: int, height: int) -> None:
        """Nothing: OpenGL was started before, which may fail."""

    def _platform_make_current(self) -> None:
        """Nothing: the context is current only while something is drawn."""

    def _platform_free(self) -> None:
        if self._pid == os.getpid():
            self._gl.free()

    @contextlib.contextmanager
    def make_current(self) -> Iterator[Any]:
        """Draw here; SettingsError says that this process was forked after the first picture."""
        if self._pid != os.getpid():
            raise SettingsError("a process that was forked after the first picture cannot draw; make a new environment")
        with self._render_executor.execution_context() as context, opengl.lock, self._gl.current():
            yield context


def _make_contexts(physics: Any) -> None:
    """Do what `physics` would to draw, with a `RingContext`."""
    size = physics.model.vis.global_
    context = RingContext(opengl.start(size.offwidth, size.offheight))
    drawing = engine.wrapper.MjrContext(physics.model, context)
    physics._contexts = engine.Contexts(gl=context, mujoco=drawing)


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

    Attributes:
        robot, bag: The composer entities.
        scene: The `robot.Scene` of the model that the environment compiled.

    Raises:
        SettingsError: If `control_step_s` is not a whole number of physics steps or `start_noise_rad` is negative.
    """

    def __init__(self, *, control_step_s: float = CONTROL_STEP_S, start_noise_rad: float = 0.0) -> None:
        self._arena = Ring()
        self._step_s = float(self._arena.mjcf_model.option.timestep)
        control_step_s = checked(Positive, control_step_s, "control_step_s")
        steps = round(control_step_s / self._step_s)
        if steps < 1 or abs(control_step_s - steps * self._step_s) > 1e-9:
            raise SettingsError(
                f"`control_step_s` should be a whole number of physics steps of {self._step_s} s, "
                f"but is {control_step_s}."
            )
        start_noise_rad = checked(NonNegative, start_noise_rad, "start_noise_rad")
        self.robot, self.bag = Nao(), Bag()
        self._arena.add_free_entity(self.robot)
        self._arena.attach(self.bag, self._arena.mjcf_model.find("site", "hook"))
        self._arena.mjcf_model.sensor.add(
            "contact", name=BAG_FORCE, geom1=self.bag.mjcf_model.find("geom", "leather"),
            subtree2=self.robot.mjcf_model.find("body", "Torso"), data="force", reduce="netforce",
        )  # fmt: skip
        self.scene = Scene()
        self._noise_rad = start_noise_rad
        self._impulse_ns = 0.0
        self._settled: np.ndarray | None = None
        self.set_timesteps(control_timestep=steps * self._step_s, physics_timestep=self._step_s)
        self.robot.observables.enable_all()
        self.bag.observables.enable_all()

    @property
    def root_entity(self) -> composer.Entity:
        """The ring, with robot and bag in it."""
        return self._arena

    def action_spec(self, physics: Any) -> specs.BoundedArray:
        """Targets of the eight arm joints [rad]."""
        low, high = limits()
        return specs.BoundedArray((N_JOINTS,), np.float64, low, high, name="\t".join(JOINTS))

    def after_compile(self, physics: Any, random_state: np.random.RandomState) -> None:
        """Let the scene use the model that the environment compiled."""
        self.scene = Scene.from_model(physics.model.ptr)
        self._settled = None
        physics._make_rendering_contexts = functools.partial(_make_contexts, physics)

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
        """Return the state of standing in the guard at rest, reached after 2 s; computed once."""
        data = mujoco.MjData(model)
        self.scene.place(data, "Guard")
        mujoco.mj_step(model, data, nstep=round(2.0 / self._step_s))
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
        self._impulse_ns += float(np.linalg.norm(force)) * self._step_s

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


class BoxingEnvironment(composer.Environment):
    """The ring as an environment of dm_control; with `flat` its observation is one array, `observations`."""

    def __init__(self, task: BoxingTask, flat: bool, **settings: Any) -> None:
        super().__init__(task, **settings)
        self._flat = False
        self.reset()  # composer compiles once more at the first reset; from here on the model stays
        self._reset_next_step, self._flat = True, flat  # the first `step` begins an episode, as dm_env asks

    def observation_spec(self) -> Any:
        """Return what `reset` and `step` observe."""
        spec = super().observation_spec()
        if not self._flat:
            return spec
        size = sum(int(np.prod(one.shape)) for one in spec.values())
        return {control.FLAT_OBSERVATION_KEY: specs.Array((size,), np.float64, control.FLAT_OBSERVATION_KEY)}

    def reset(self) -> dm_env.TimeStep:
        """Begin an episode."""
        return self._flattened(super().reset())

    def step(self, action: np.ndarray) -> dm_env.TimeStep:
        """Go on by a control step, or begin an episode after one has ended and at first."""
        return super().step(action) if self._reset_next_step else self._flattened(super().step(action))

    def _flattened(self, step: dm_env.TimeStep) -> dm_env.TimeStep:
        return step._replace(observation=control.flatten_observation(step.observation)) if self._flat else step


_ENVIRONMENT_KWARGS = (
    "flat_observation", "raise_exception_on_physics_error", "strip_singleton_obs_buffer_dim", "max_reset_attempts",
    "recompile_mjcf_every_episode", "fixed_initial_state", "delayed_observation_padding", "legacy_step",
)  # fmt: skip


def load(
    *,
    seed: int | None = None,
    control_step_s: float = CONTROL_STEP_S,
    time_limit_s: float = TIME_LIMIT_S,
    start_noise_rad: float = 0.0,
    environment_kwargs: dict[str, Any] | None = None,
) -> composer.Environment:
    """Return the ring as a dm_control environment, like `suite.load`.

    The robot's `Scene` is `env.task.scene`; it shares the compiled model, so `robot.Performer(env.task.scene)` performs
    trajectories with the very same physics.

    Args:
        seed: Seeds the start noise; None draws a fresh one.
        control_step_s: Time between actions [s], a whole number of 5 ms physics steps.
        time_limit_s: Length of an episode [s].
        start_noise_rad: Randomness of the first posture [rad].
        environment_kwargs: For `composer.Environment`; ``{"flat_observation": True}`` makes one array of what is
            observed, as in dm_control's suite.

    Raises:
        SettingsError: If a time is not usable, the noise negative, or a name of `environment_kwargs` unknown.

    Example:
        >>> env = load(seed=0)
        >>> env.reset().observation["nao/joint_positions"].shape
        (8,)
    """
    time_limit_s = checked(Positive, time_limit_s, "time_limit_s")
    seed = seed if seed is None else checked(Annotated[int, Field(ge=0, lt=2**32)], seed, "seed")
    task = BoxingTask(control_step_s=control_step_s, start_noise_rad=start_noise_rad)
    if control_step_s > time_limit_s:
        raise SettingsError(
            f"`control_step_s` should be at most `time_limit_s`, {time_limit_s}, but is {control_step_s}"
        )
    settings = dict(checked(dict[str, Any] | None, environment_kwargs, "environment_kwargs") or {})
    for name in settings.keys() - set(_ENVIRONMENT_KWARGS):
        offered = f"{nearest_name(name, _ENVIRONMENT_KWARGS)}; there are {', '.join(_ENVIRONMENT_KWARGS)}"
        raise SettingsError(f"`environment_kwargs`: no `{name}`{offered}")
    flat = checked(bool, settings.pop("flat_observation", False), "flat_observation")
    usual = {"recompile_mjcf_every_episode": False, "strip_singleton_obs_buffer_dim": True}
    # Simulated time is a sum of steps and ends a little below the exact product: half a step makes the count exact.
    limit = time_limit_s - control_step_s / 2
    return BoxingEnvironment(task, flat, time_limit=limit, random_state=seed, **usual | settings)
