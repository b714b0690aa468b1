"""`CreativeNao/Boxing-v0`: the NAO performs every action on its own feet in the ring."""

from __future__ import annotations

from typing import Any

from creative_nao.envs.bank import MemoryLike
from creative_nao.envs.performers import Body, check_arms
from creative_nao.envs.repertoire_env import EPISODE_ACTIONS, RepertoireEnv
from creative_nao.measures import Criteria
from creative_nao.robot import PhysicalLimits


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
