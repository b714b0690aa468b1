"""The environments of the project, single and vectorised; their docstrings are their pages.

- `CreativeNao/BoxingMental-v0`: movements are generated and scored, as in the paper.
- `CreativeNao/Boxing-v0`: the NAO performs every movement on its own feet in the ring.
- `CreativeNao/BoxingModulation-v0`: the PB may change during a movement.
- `RandomisedRobot`: a wrapper that gives `CreativeNao/Boxing-v0` a slightly different robot every episode.
"""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from textwrap import indent
from typing import Any, TypeVar

import gymnasium as gym
import numpy as np

from creative_nao.envs.episode_batch import EPISODE_ACTIONS
from creative_nao.envs.executors import PhysicsExecutor
from creative_nao.envs.memory_set import MemoryLike
from creative_nao.envs.observation import CELLS, layout, layout_table, try_columns
from creative_nao.envs.repertoire_env import RepertoireEnv
from creative_nao.envs.vector_env import RepertoireVectorEnv
from creative_nao.errors import SettingsError, shown
from creative_nao.measures import Criteria
from creative_nao.model.config import check_kind
from creative_nao.robot import PhysicalLimits, RobotVariation
from creative_nao.schema import checked

Kind = TypeVar("Kind", bound=RepertoireEnv)

_TEXTS = dict(
    re.findall(r"^# (\w+)\n(.*?)\n(?=\n# |\Z)", Path(__file__).with_name("pages.md").read_text("utf-8"), re.M | re.S)
)
"""What the pages of several environments have in common, by its name."""


def _cells(**sizes: Any) -> str:
    """Return what `observation="cells"` holds; the arguments are those of `layout`."""
    parts = layout(**sizes)
    return _TEXTS["cells"].format(size=parts[-1].stop, parts=layout_table(parts))


def _tries(n_rows: int, n_decisions: int = 1, rehearsal: bool = False, **sizes: Any) -> str:
    """Return what `observation="trajectories"` holds; the arguments are those of `layout`."""
    parts = layout(n_rows=n_rows, n_decisions=n_decisions, rehearsal=rehearsal, **sizes)
    columns = try_columns(n_decisions=n_decisions, rehearsal=rehearsal)
    sizes = {"size": parts[-1].stop, "n_columns": columns[-1].stop, "version": "" if rehearsal else " (-v1)"}
    return _TEXTS["tries"].format(parts=layout_table(parts), columns=layout_table(columns), **sizes)


def _observation(*tables: str) -> str:
    return _TEXTS["observation"].format(tables="\n\n".join(tables))


_MODULATED: dict[str, Any] = {"n_joints": 8, "n_slow": 10}
_SHARED = {
    **_TEXTS,
    "observation": _observation(_cells(), _tries(30)),
    "modulated_observation": _observation(_cells(**_MODULATED), _tries(30, 10, **_MODULATED)),
    "rehearsal_observation": _observation(_tries(240, rehearsal=True)),
    "arguments": _TEXTS["arguments"].format_map(_TEXTS),
}
"""What stands in the place of each name in braces in a docstring."""


def page(kind: type[Kind]) -> type[Kind]:
    """Put the common text into the docstring of an environment, which is its page."""
    for name, text in _SHARED.items():
        kind.__doc__ = (kind.__doc__ or "").replace(f"    {{{name}}}", indent(text, "    "))
    return kind


@page
class BoxingMentalEnv(RepertoireEnv):
    """Find new boxing movements in a robot's memory by mental simulation.

    ## Description
    The memory is a recurrent network that learned six boxing actions; every point of its PB space is a movement of the
    robot's arms. One step of the environment is one whole movement: the network generates it in closed
    loop from the PB point that the agent names. Usable movements that are unlike everything the robot knows are
    rewarded and join its repertoire. No physics is involved; `CreativeNao/Boxing-v0` is the same task performed by the
    robot.

    `env.unwrapped.imagine(pb)` generates and scores movements without performing them, up to `n_imagined` an episode.
    What it returns is, to the bit, what the `info` of performing them here would tell; so it is in the other
    environments, where the body or a turn of the PB may still make something else of them.

    {actions}

    {observation}

    ## Rewards
    An appropriate action (outcome `learned` or `unlearned`) earns its smallest DTW distance to everything the robot
    already knows, the basic actions and the repertoire so far, divided by the mean pairwise distance of the basic
    actions; it then joins the repertoire. A `fluctuating` action (faster than 1.5 times the fastest basic action) or a
    `non_moving` one earns 0 and does not join. So novelty counts once, and diversity is what is left to earn.

    `info` of a step: `pb`, `outcome`, `appropriate`, `nearest`, `nearest_name`, `distance` (to the nearest basic action
    [rad]), `basic_distances` (to every basic action [rad]), `known_distance` (to everything known before [rad]),
    `reward_novelty`, `repertoire_size`, `step`, `n_imagined` (movements imagined so far), `trajectory` (the scored one,
    (n_steps, 8) [rad]), `memory` (its name) and `episode_measures`: zeros, at the end of an episode
    `appropriateness_pct`, `novelty` and `diversity` of the repertoire, the paper's three measures, NaN where undefined.
    `reset` tells the same terms: `memory`, else zeros and empty texts.

    ## Starting state
    The repertoire is empty. The task itself has no randomness: one memory and one sequence of PB points, one result.
    Over a split of the bank of memories, each episode draws its memory; `reset(options={"memory": name})` takes a named
    one.

    ## Episode end
    Truncated after `n_actions` (30) steps; never terminated.

    {arguments}

    {rendering}

    {versions}
    """


@page
class BoxingEnv(RepertoireEnv):
    """Find new boxing movements in a robot's memory and let the NAO perform them in physics.

    ## Description
    The same task as `CreativeNao/BoxingMental-v0`, but the generated movement is performed by the simulated NAO,
    standing free on its feet in a ring before a punching bag, and the joint angles that its encoders measured are
    scored. Every action starts from the same settled guard, so what happens depends on the PB point alone.

    {actions}

    {observation}

    ## Rewards
    As in `CreativeNao/BoxingMental-v0`. Beside `fluctuating` (judged on the commanded angles) and `non_moving`, an
    action is inappropriate, earns 0 and does not join the repertoire when the body refuses it. The first of these that
    holds is the outcome; the thresholds are those of `robot.PhysicalLimits`:

    | outcome | when |
    | --- | --- |
    | joint_limit | the commanded angles leave a joint's range by more than 0.03 rad |
    | fell | the torso sinks below 0.24 m or leans more than 0.6 rad |
    | self_collision | the robot touches itself for more than 5 % of the time |
    | torque_saturated | one motor works at its torque limit for more than 20 % of the time |
    | tracking_error | the mean error of the worst joint exceeds 0.08 rad |

    `info` of a step: as in `CreativeNao/BoxingMental-v0`, where `trajectory` is what the encoders measured, and
    `commanded` (the generated angles [rad]), `tracking_error` (mean of the worst joint [rad]), `torque_saturated`
    (share of the time of the worst motor), `self_collision` (share of the time), `fell`, `hits` (on the bag),
    `hit_impulse` [N s], `fist_speed` (largest [m/s]).

    ## Starting state
    The robot stands in the guard, the repertoire is empty. Nothing is random but the draw of a memory from a split of
    the bank.

    ## Episode end
    Truncated after `n_actions` (30) steps; never terminated: after a fall the next action starts from the guard again.

    {arguments}
    | limits | None | `robot.PhysicalLimits` or its values as a dictionary: from where on a performance failed |

    {rendering}
    Their performances run in `n_threads` threads.

    {versions}
    """

    physics = True

    def __init__(
        self,
        memory: MemoryLike = "half/0",
        n_actions: int = EPISODE_ACTIONS,
        render_mode: str | None = None,
        criteria: Criteria | None = None,
        overlay: bool = False,
        limits: PhysicalLimits | None = None,
        n_imagined: int = 0,
        observation: str = CELLS,
        **drawing: Any,
    ) -> None:
        self.limits = checked(PhysicalLimits | None, limits, "limits") or PhysicalLimits()
        super().__init__(memory, n_actions, render_mode, criteria, overlay, n_imagined, observation, **drawing)

    @property
    def performer(self) -> Any:
        """The `robot.Performer` in its ring, built when first needed."""
        assert isinstance(self._batch.executor, PhysicsExecutor)
        return self._batch.executor.performer(self._env_id)

    @property
    def model(self) -> Any:
        """The compiled `mujoco.MjModel` of ring, robot and bag."""
        return self.performer.scene.model

    @property
    def data(self) -> Any:
        """The `mujoco.MjData`: the state at the end of the last action, or the settled guard."""
        return self.performer.data


@page
class BoxingModulationEnv(RepertoireEnv):
    """Make new boxing movements out of a robot's memory by turning its PB while they unfold.

    ## Description
    As in `CreativeNao/BoxingMental-v0` the robot builds a repertoire, but here the agent chooses a new PB vector every
    5 ticks (0.75 s) of a movement: 10 decisions for the 50 ticks of one. The state of the network goes on through every
    change, so that actions arise by modulating and combining what was learned. With the PB held constant a movement has
    the very bits it has in `CreativeNao/BoxingMental-v0`. When the last tick has unfolded the movement is scored, and
    the next one starts from the guard with the network at rest.

    {actions}

    {modulated_observation}

    At the start of an episode the posture is that of the guard. All but `pb`, `path`, `step` and what follows them
    change only when a movement is scored. A movement marks the cells of all its PB vectors; after its last decision the
    posture is the one it ended in and P_S is at rest again.

    ## Rewards
    0 until a movement has unfolded; then as in `CreativeNao/BoxingMental-v0`. With `physics=True` the robot performs
    the movement when it has unfolded, and the body may refuse it as in `CreativeNao/Boxing-v0`.

    `info` of a step: `pb`, `step` (decisions so far), `tick` (of the movement), `posture` (joint angles now
    [rad], (8,)). When a movement is scored also the terms of `CreativeNao/BoxingMental-v0` (`outcome`, ...,
    `trajectory`) and `pb_path`, its PB vectors (10, 2); with physics also the terms of `CreativeNao/Boxing-v0`; and at
    the end of an episode `episode_measures`.

    ## Starting state
    The repertoire is empty, nothing has unfolded. Nothing is random but the draw of a memory from a split of the bank.

    ## Episode end
    Truncated after `n_actions` (30) movements, which are 300 steps; never terminated. An episode generates as many
    movements as in the other environments, so that their figures can be compared.

    {arguments}
    | physics | False | whether the robot performs each movement |
    | limits | None | `robot.PhysicalLimits`, for `physics=True` |

    {rendering}

    {versions}
    """

    _modulated = True

    def __init__(
        self,
        memory: MemoryLike = "half/0",
        n_actions: int = EPISODE_ACTIONS,
        render_mode: str | None = None,
        criteria: Criteria | None = None,
        overlay: bool = False,
        physics: bool = False,
        limits: PhysicalLimits | None = None,
        n_imagined: int = 0,
        observation: str = CELLS,
        **drawing: Any,
    ) -> None:
        self.physics = checked(bool, physics, "physics")
        self.limits = checked(PhysicalLimits | None, limits, "limits") or PhysicalLimits()
        super().__init__(memory, n_actions, render_mode, criteria, overlay, n_imagined, observation, **drawing)


class BoxingMentalVectorEnv(RepertoireVectorEnv):
    """Vector environment of `CreativeNao/BoxingMental-v0`; see `BoxingMentalEnv` and `RepertoireVectorEnv`."""

    single_class = BoxingMentalEnv


class BoxingVectorEnv(RepertoireVectorEnv):
    """Vector environment of `CreativeNao/Boxing-v0`, performed in threads; see `BoxingEnv`.

    Args:
        num_envs: Number of sub-environments.
        limits: From where on a performance counts as failed.
        arguments: Those of `RepertoireVectorEnv`.
    """

    single_class = BoxingEnv
    physics = True

    def __init__(self, num_envs: int = 1, *, limits: PhysicalLimits | None = None, **arguments: Any) -> None:
        self.limits = checked(PhysicalLimits | None, limits, "limits") or PhysicalLimits()
        super().__init__(num_envs, **arguments)


class BoxingModulationVectorEnv(BoxingVectorEnv):
    """Vector environment of `CreativeNao/BoxingModulation-v0`; see `BoxingModulationEnv`.

    Args:
        num_envs: Number of sub-environments.
        physics: Whether the robot performs each movement.
        arguments: Those of `BoxingVectorEnv`.
    """

    single_class = BoxingModulationEnv

    def __init__(self, num_envs: int = 1, *, physics: bool = False, **arguments: Any) -> None:
        self.physics = checked(bool, physics, "physics")
        super().__init__(num_envs, **arguments)


@dataclasses.dataclass(frozen=True)
class VariationRanges:
    """From where to where each figure of the robot is drawn, evenly; the names are those of `robot.RobotVariation`."""

    mass: tuple[float, float] = (0.97, 1.03)
    """The complete robot is sold 2.2 % heavier than the sum of its links."""
    friction: tuple[float, float] = (0.55, 1.33)
    """Sliding friction 0.5, of one published description, to 1.2, the upper end of another's range."""
    kp: tuple[float, float] = (0.8, 1.25)
    """Gains are not published; beyond this the basic actions fail on the body (benchmarks/physics.py)."""
    kd: tuple[float, float] = (0.8, 1.25)
    latency_s: tuple[float, float] = (0.0, 0.02)
    """None to two cycles of the robot's device controller."""
    encoder_noise_rad: tuple[float, float] = (0.0, 0.0015)
    """Up to about one count of the 12-bit encoders."""

    def __post_init__(self) -> None:
        """Refuse ranges that are none, or whose ends are no robot."""
        for field in dataclasses.fields(self):
            ends = getattr(self, field.name)
            if not isinstance(ends, tuple | list) or len(ends) != 2:
                raise SettingsError(f"`{field.name}` should be a range (low, high), but is {shown(ends)}")
            for end in ends:
                RobotVariation(**{field.name: end})
            if not ends[0] <= ends[1]:
                raise SettingsError(f"`{field.name}` should be a range (low, high), but is ({ends[0]}, {ends[1]})")

    def draw(self, rng: np.random.Generator) -> RobotVariation:
        """Draw a robot; every figure takes one number of the generator, also where a range is a point."""
        names = [field.name for field in dataclasses.fields(self)]
        return RobotVariation(**{name: float(rng.uniform(*getattr(self, name))) for name in names})


class RandomisedRobot(gym.Wrapper[np.ndarray, np.ndarray, np.ndarray, np.ndarray], gym.utils.RecordConstructorArgs):
    """Draws a new robot at every reset: mass, friction, gains, latency and encoder noise.

    What was drawn is in the `info` of `reset` under `variation`, as a dictionary. The draws depend on the seed of
    `reset` alone; without a seed they go on from the one before. States of the wrapped environment (`get_state`) do not
    hold the robot that was drawn.

    Args:
        env: A `CreativeNao/Boxing-v0`, wrapped or not.
        ranges: From where to where each figure is drawn.

    Raises:
        SettingsError: If no robot performs in the environment.

    Example:
        >>> import gymnasium as gym
        >>> import creative_nao
        >>> from creative_nao.envs.boxing_envs import RandomisedRobot, VariationRanges
        >>> env = RandomisedRobot(gym.make("CreativeNao/Boxing-v0"), VariationRanges(mass=(1.1, 1.1)))
        >>> env.reset(seed=0)[1]["variation"]["mass"]
        1.1
    """

    def __init__(self, env: gym.Env[np.ndarray, np.ndarray], ranges: VariationRanges | None = None) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, ranges=ranges)
        check_kind(env, gym.Env, "env")
        gym.Wrapper.__init__(self, env)
        if not hasattr(env.unwrapped, "performer"):
            raise SettingsError(
                f"only an environment in which a robot performs can vary it, CreativeNao/Boxing-v0, but this is {env}"
            )
        self.ranges = VariationRanges() if ranges is None else ranges
        check_kind(self.ranges, VariationRanges, "ranges")
        self._rng: np.random.Generator | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode with a robot drawn anew; `seed` is also that of the environment, which gets `options`."""
        observation, info = self.env.reset(seed=seed, options=options)
        if seed is not None or self._rng is None:
            self._rng = np.random.default_rng(seed)
        variation = self.ranges.draw(self._rng)
        body: Any = self.env.unwrapped
        body.performer.vary(variation, self._rng)
        return observation, {**info, "variation": dataclasses.asdict(variation)}
