"""`CreativeNao/Boxing-v0`: the NAO performs every action on its own feet in the ring."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from creative_nao.envs.repertoire_env import EPISODE_ACTIONS, Performed, RepertoireEnv
from creative_nao.errors import SettingsError
from creative_nao.joints import JOINTS
from creative_nao.measures import Criteria
from creative_nao.model import Memory
from creative_nao.robot import PhysicalLimits, first_failure

if TYPE_CHECKING:
    from creative_nao.robot.playback import Performer


class BoxingEnv(RepertoireEnv):
    """Find new boxing movements in a robot's memory and let the NAO perform them in physics.

    ## Description
    The same task as `CreativeNao/BoxingMental-v0`, but the generated movement is performed by the simulated NAO,
    standing free on its feet in a ring before a punching bag, and the joint angles that its encoders measured are
    scored. Every action starts from the same settled guard, so what happens depends on the PB point alone.

    ## Action space
    `Box(-1, 1, (2,), float32)`

    | index | meaning | min | max |
    | --- | --- | --- | --- |
    | 0 | activation of PB unit 1 | -1 | 1 |
    | 1 | activation of PB unit 2 | -1 | 1 |

    ## Observation space
    `Box(85,) float32`, all zero at the start of an episode. The sizes are those of a memory with six basic actions.
    `scale` is the mean DTW distance between basic actions.

    | index | name | meaning | min | max |
    | --- | --- | --- | --- | --- |
    | 0-1 | pb | last PB vector | -1 | 1 |
    | 2-10 | outcome | last outcome, one-hot in the order of `OUTCOMES` | 0 | 1 |
    | 11 | novelty | d / (d + scale), d the last action's distance to the nearest basic action | 0 | 1 |
    | 12-17 | nearest | nearest basic action of the last action, one-hot | 0 | 1 |
    | 18 | known | d / (d + scale), d its distance to everything known before it | 0 | 1 |
    | 19-82 | cells | PB space in cells: 0 untried, -1 tried in vain, else best reward r there as r / (r + 1) | -1 | 1 |
    | 83 | coverage | share of the cells tried | 0 | 1 |
    | 84 | step | share of the episode that is over | 0 | 1 |

    ## Rewards
    As in `CreativeNao/BoxingMental-v0`. Beside `fluctuating` (judged on the commanded angles) and `non_moving`, an
    action is inappropriate, earns 0 and does not join the repertoire when the body refuses it. The first of these that
    holds is the outcome; the thresholds are those of `robot.PhysicalLimits`:

    | outcome | when |
    | --- | --- |
    | joint_limit | the commanded angles leave a joint's range by more than 0.03 rad |
    | fell | the torso sinks below 0.24 m or leans more than 0.6 rad |
    | self_collision | the robot touches itself for more than 5 % of the time |
    | torque_saturated | one motor works at its torque limit for more than 15 % of the time |
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
    | memory | `"half/0"` | name, file or `Memory`; `"train"`, `"validation"`, `"test"`: drawn per episode |
    | n_actions | 30 | actions in an episode |
    | render_mode | None | `rgb_array` (the last movement at its widest), `rgb_array_list` (a film), `human` |
    | criteria | None | `measures.Criteria`: where the lines between outcomes are drawn |
    | limits | None | `robot.PhysicalLimits`: from where on a performance counts as failed |

    ## Version history
    * v0: first version.
    """

    def __init__(
        self,
        memory: str | os.PathLike[str] | Memory = "half/0",
        n_actions: int = EPISODE_ACTIONS,
        render_mode: str | None = None,
        criteria: Criteria | None = None,
        limits: PhysicalLimits | None = None,
    ) -> None:
        super().__init__(memory, n_actions, render_mode, criteria)
        if self.memory.joints != JOINTS:
            raise SettingsError(
                f"the NAO performs memories of the joints {', '.join(JOINTS)}, "
                f"but this one has {', '.join(self.memory.joints)}"
            )
        self.limits = PhysicalLimits() if limits is None else limits
        self._performer: Performer | None = None

    @property
    def performer(self) -> Performer:
        """The robot in its ring, built when first needed."""
        if self._performer is None:
            from creative_nao.robot.playback import Performer

            self._performer = Performer(self.scene)
        return self._performer

    @property
    def model(self) -> Any:
        """The compiled `mujoco.MjModel` of ring, robot and bag."""
        return self.performer.scene.model

    @property
    def data(self) -> Any:
        """The `mujoco.MjData`: the state at the end of the last action, or the settled guard."""
        return self.performer.data

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode: the robot stands in the guard, the repertoire is empty."""
        result = super().reset(seed=seed, options=options)
        self.performer.reset()
        return result

    def _perform(self, generated: np.ndarray) -> Performed:
        done = self.performer.perform(generated, self.memory.dt_s, keep_frames=self.render_mode is not None)
        if done.frames is not None:
            self._remember(done.frames, done.frame_dt_s)
        figures = {
            "commanded": generated,
            "tracking_error": float(done.mean_error_rad.max()),
            "torque_saturated": float(done.saturated_share.max()),
            "self_collision": done.self_collision_share,
            "fell": done.fell,
            "hits": done.hits.count,
            "hit_impulse": done.hits.impulse_ns,
            "fist_speed": float(done.fist_peak_speed_m_s.max()),
        }
        return Performed(done.measured, first_failure(done, self.limits), figures)
