"""`CreativeNao/BoxingMental-v0`: the robot acts in its mind only, as in the paper.

Also here:
- `CreativeNao/Boxing-v0`: the NAO performs every action on its own feet in the ring.
- A wrapper that gives `CreativeNao/Boxing-v0` a slightly different robot every episode.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import gymnasium as gym
import numpy as np

from creative_nao.envs.executors import Body, check_arms
from creative_nao.envs.memory_set import MemoryLike
from creative_nao.envs.repertoire_env import EPISODE_ACTIONS, RepertoireEnv
from creative_nao.errors import SettingsError
from creative_nao.measures import Criteria
from creative_nao.robot import PhysicalLimits, Variation


class BoxingMentalEnv(RepertoireEnv):
    """Find new boxing movements in a robot's memory by mental simulation.

    ## Description
    The memory is a recurrent network that learned six boxing actions; every point of its two-dimensional PB space is a
    movement of the robot's arms. One step of the environment is one whole movement: the network generates it in closed
    loop from the PB point that the agent names. Usable movements that are unlike everything the robot knows are
    rewarded and join its repertoire. No physics is involved; `CreativeNao/Boxing-v0` is the same task performed by the
    robot.

    ## Action space
    `Box(-1, 1, (2,), float32)`

    | index | meaning | min | max | unit |
    | --- | --- | --- | --- | --- |
    | 0 | activation of PB unit 1 | -1 | 1 | 1 |
    | 1 | activation of PB unit 2 | -1 | 1 | 1 |

    ## Observation space
    `Box(85,) float32`, all zero at the start of an episode.

    | index | name | meaning | min | max | unit |
    | --- | --- | --- | --- | --- | --- |
    | 0-1 | pb | last PB vector | -1 | 1 | 1 |
    | 2-10 | outcome | last outcome, one-hot in the order of `OUTCOMES` | 0 | 1 | 1 |
    | 11 | novelty | d / (d + scale), d the last action's distance to the nearest basic action | 0 | 1 | 1 |
    | 12-17 | nearest | nearest basic action of the last action, one-hot | 0 | 1 | 1 |
    | 18 | known | d / (d + scale), d its distance to everything known before it | 0 | 1 | 1 |
    | 19-82 | cells | cells of PB space: 0 untried, -1 in vain, else best reward r there as r / (r + 1) | -1 | 1 | 1 |
    | 83 | coverage | share of the cells tried | 0 | 1 | 1 |
    | 84 | step | share of the episode that is over | 0 | 1 | 1 |

    The sizes are those of a memory with six basic actions. `scale` is the mean DTW distance between basic actions.
    `OUTCOMES` are `learned`, `unlearned`, `fluctuating`, `non_moving`, `joint_limit`, `torque_saturated`,
    `tracking_error`, `self_collision`, `fell`.

    The cell of a point is in column floor((pb1 + 1) / 2 * 8) of row floor((pb2 + 1) / 2 * 8), rows one after the other;
    a cell in which something appropriate was found reads at least 0.1.

    ## Rewards
    An appropriate action (outcome `learned` or `unlearned`) earns its smallest DTW distance to everything the robot
    already knows, the basic actions and the repertoire so far, divided by the mean pairwise distance of the basic
    actions; it then joins the repertoire. A `fluctuating` action (faster than 1.5 times the fastest basic action) or a
    `non_moving` one earns 0 and does not join. So novelty counts once, and diversity is what is left to earn.

    `info` of a step: `pb`, `outcome`, `appropriate`, `nearest`, `nearest_name`, `distance` (to the nearest basic action
    [rad]), `known_distance` (to everything known before [rad]), `reward_novelty`, `repertoire_size`, `step`,
    `trajectory` (the scored one, (n_steps, 8) [rad]). At the end of an episode also `episode_measures`:
    `appropriateness_pct`, `novelty` and `diversity` of the repertoire, the paper's three measures.

    ## Starting state
    The repertoire is empty. The task itself has no randomness: one memory and one sequence of PB points, one result.
    Over a part of the bank of memories, each episode draws its memory; `reset(options={"memory": name})` takes a named
    one.

    ## Episode end
    Truncated after `n_actions` (30) steps; never terminated.

    ## Arguments
    | argument | default | meaning |
    | --- | --- | --- |
    | memory | `"half/0"` | name, file or memory; `"train"`, `"validation"`, `"test"`: drawn per episode |
    | n_actions | 30 | actions in an episode |
    | render_mode | None | `rgb_array`, `rgb_array_list`, `depth_array`, `human`: see below |
    | criteria | None | `measures.Criteria`: where the lines between outcomes are drawn |
    | overlay | False | whether colour frames tell outcome, nearest basic action and reward |

    `render` returns: `rgb_array` the last movement at its widest, uint8 (480, 640, 3); `depth_array` how far away
    everything is in that picture [m], float32 (480, 640); `rgb_array_list` a film of all movements since the last call;
    `human` None, it plays the movement in a window.

    `gymnasium.make_vec(..., vectorization_mode="vector_entry_point")` makes many copies at once, with the same
    trajectories as separate copies of the same seeds; it also takes `autoreset_mode` and `n_threads`.

    ## Version history
    * v0: first version.
    """


class BoxingEnv(RepertoireEnv):
    """Find new boxing movements in a robot's memory and let the NAO perform them in physics.

    ## Description
    The same task as `CreativeNao/BoxingMental-v0`, but the generated movement is performed by the simulated NAO,
    standing free on its feet in a ring before a punching bag, and the joint angles that its encoders measured are
    scored. Every action starts from the same settled guard, so what happens depends on the PB point alone.

    ## Action space
    `Box(-1, 1, (2,), float32)`

    | index | meaning | min | max | unit |
    | --- | --- | --- | --- | --- |
    | 0 | activation of PB unit 1 | -1 | 1 | 1 |
    | 1 | activation of PB unit 2 | -1 | 1 | 1 |

    ## Observation space
    `Box(85,) float32`, all zero at the start of an episode.

    | index | name | meaning | min | max | unit |
    | --- | --- | --- | --- | --- | --- |
    | 0-1 | pb | last PB vector | -1 | 1 | 1 |
    | 2-10 | outcome | last outcome, one-hot in the order of `OUTCOMES` | 0 | 1 | 1 |
    | 11 | novelty | d / (d + scale), d the last action's distance to the nearest basic action | 0 | 1 | 1 |
    | 12-17 | nearest | nearest basic action of the last action, one-hot | 0 | 1 | 1 |
    | 18 | known | d / (d + scale), d its distance to everything known before it | 0 | 1 | 1 |
    | 19-82 | cells | cells of PB space: 0 untried, -1 in vain, else best reward r there as r / (r + 1) | -1 | 1 | 1 |
    | 83 | coverage | share of the cells tried | 0 | 1 | 1 |
    | 84 | step | share of the episode that is over | 0 | 1 | 1 |

    The sizes are those of a memory with six basic actions. `scale` is the mean DTW distance between basic actions.
    `OUTCOMES` are `learned`, `unlearned`, `fluctuating`, `non_moving`, `joint_limit`, `torque_saturated`,
    `tracking_error`, `self_collision`, `fell`.

    The cell of a point is in column floor((pb1 + 1) / 2 * 8) of row floor((pb2 + 1) / 2 * 8), rows one after the other;
    a cell in which something appropriate was found reads at least 0.1.

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
    The robot stands in the guard, the repertoire is empty. Nothing is random but the draw of a memory from a part of
    the bank.

    ## Episode end
    Truncated after `n_actions` (30) steps; never terminated: after a fall the next action starts from the guard again.

    ## Arguments
    | argument | default | meaning |
    | --- | --- | --- |
    | memory | `"half/0"` | name, file or memory; `"train"`, `"validation"`, `"test"`: drawn per episode |
    | n_actions | 30 | actions in an episode |
    | render_mode | None | `rgb_array`, `rgb_array_list`, `depth_array`, `human`: see below |
    | criteria | None | `measures.Criteria`: where the lines between outcomes are drawn |
    | overlay | False | whether colour frames tell outcome, nearest basic action and reward |
    | limits | None | `robot.PhysicalLimits`: from where on a performance counts as failed |

    `render` returns: `rgb_array` the last movement at its widest, uint8 (480, 640, 3); `depth_array` how far away
    everything is in that picture [m], float32 (480, 640); `rgb_array_list` a film of all movements since the last call;
    `human` None, it plays the movement in a window.

    `gymnasium.make_vec(..., vectorization_mode="vector_entry_point")` makes many copies at once, with the same
    trajectories as separate copies of the same seeds; it also takes `autoreset_mode` and `n_threads`.
    Their performances run in `n_threads` threads.

    ## Version history
    * v0: first version.
    """

    def __init__(
        self,
        memory: MemoryLike = "half/0",
        n_actions: int = EPISODE_ACTIONS,
        render_mode: str | None = None,
        criteria: Criteria | None = None,
        overlay: bool = False,
        limits: PhysicalLimits | None = None,
    ) -> None:
        self.limits = PhysicalLimits() if limits is None else limits
        super().__init__(memory, n_actions, render_mode, criteria, overlay)
        check_arms(self.memory.demonstrations.joints)

    def _make_performer(self) -> Body:
        return Body(self._shared, self.limits)

    @property
    def performer(self) -> Any:
        """The `robot.Performer` in its ring, built when first needed."""
        assert isinstance(self._performer, Body)
        return self._performer.performer

    @property
    def model(self) -> Any:
        """The compiled `mujoco.MjModel` of ring, robot and bag."""
        return self.performer.scene.model

    @property
    def data(self) -> Any:
        """The `mujoco.MjData`: the state at the end of the last action, or the settled guard."""
        return self.performer.data


@dataclasses.dataclass(frozen=True)
class VariationRanges:
    """From where to where each figure of the robot is drawn, evenly; the names are those of `robot.Variation`."""

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
            low, high = getattr(self, field.name)
            if not low <= high:
                raise SettingsError(f"`{field.name}` should be a range (low, high), but is ({low}, {high})")
            for end in (low, high):
                Variation(**{field.name: end})

    def draw(self, rng: np.random.Generator) -> Variation:
        """Draw a robot; every figure takes one number of the generator, also where a range is a point."""
        names = [field.name for field in dataclasses.fields(self)]
        return Variation(**{name: float(rng.uniform(*getattr(self, name))) for name in names})


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
        gym.Wrapper.__init__(self, env)
        if not hasattr(env.unwrapped, "performer"):
            raise SettingsError(
                f"only an environment in which a robot performs can vary it, CreativeNao/Boxing-v0, but this is {env}"
            )
        self.ranges = ranges or VariationRanges()
        self._rng: np.random.Generator | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode with a robot drawn anew.

        Args:
            seed: Seed of the draws of the robot, and of the environment.
            options: Handed to the environment.
        """
        observation, info = self.env.reset(seed=seed, options=options)
        if seed is not None or self._rng is None:
            self._rng = np.random.default_rng(seed)
        variation = self.ranges.draw(self._rng)
        body: Any = self.env.unwrapped
        body.performer.vary(variation, self._rng)
        return observation, {**info, "variation": dataclasses.asdict(variation)}
