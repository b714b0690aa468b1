"""`CreativeNao/BoxingModulation-v0`: the PB may change while a movement unfolds."""

from __future__ import annotations

from typing import Any

import numpy as np

from creative_nao.envs.bank import MemoryLike
from creative_nao.envs.performers import Body, Mind, check_arms
from creative_nao.envs.repertoire_env import EPISODE_ACTIONS, ONLY_ROBOT, RepertoireEnv, checked_pb
from creative_nao.envs.state import EnvState
from creative_nao.envs.unfolding import Movements
from creative_nao.measures import Criteria
from creative_nao.robot import PhysicalLimits


class BoxingModulationEnv(RepertoireEnv):
    """Make new boxing movements out of a robot's memory by turning its PB while they unfold.

    ## Description
    As in `CreativeNao/BoxingMental-v0` the robot builds a repertoire, but here the agent chooses a new PB vector every
    5 ticks (0.75 s) of a movement: 10 decisions for the 50 ticks of one. The state of the network goes on through every
    change, so that actions arise by modulating and combining what was learned. With the PB held constant a movement has
    the very bits it has in `CreativeNao/BoxingMental-v0`. When the last tick has unfolded the movement is scored, and
    the next one starts from the guard with the network at rest.

    ## Action space
    `Box(-1, 1, (2,), float32)`

    | index | meaning | min | max | unit |
    | --- | --- | --- | --- | --- |
    | 0 | activation of PB unit 1 | -1 | 1 | 1 |
    | 1 | activation of PB unit 2 | -1 | 1 | 1 |

    ## Observation space
    `Box(104,) float32`; at the start of an episode everything but the posture is zero. Indices 0 to 84 are those of
    `CreativeNao/BoxingMental-v0`; all but `pb` and `step` change only when a movement is scored.

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
    | 85-92 | posture | joint angles now, -1 and 1 are the ends of the basic actions' range | -1 | 1 | 1 |
    | 93-102 | slow | activity of the slowest layer P_S | -1 | 1 | 1 |
    | 103 | phase | share of the movement that has unfolded, 0 before a new one | 0 | 1 | 1 |

    The sizes are those of a memory with six basic actions. `scale` is the mean DTW distance between basic actions.
    `OUTCOMES` are `learned`, `unlearned`, `fluctuating`, `non_moving`, `joint_limit`, `torque_saturated`,
    `tracking_error`, `self_collision`, `fell`.

    The cell of a point is in column floor((pb1 + 1) / 2 * 8) of row floor((pb2 + 1) / 2 * 8), rows one after the other;
    a cell in which something appropriate was found reads at least 0.1.
    A movement marks the cells of all its PB vectors. After the last decision of a movement the posture is the one it
    ended in and P_S is at rest again.

    ## Rewards
    0 until a movement has unfolded; then as in `CreativeNao/BoxingMental-v0`. With `physics=True` the robot performs
    the movement when it has unfolded, and the body may refuse it as in `CreativeNao/Boxing-v0`.

    `info` of a step: `pb`, `step` (decisions so far), `tick` (of the movement), `posture` (joint angles now
    [rad], (8,)). When a movement is scored also what `CreativeNao/BoxingMental-v0` tells (`outcome`, ...,
    `trajectory`) and `pb_path`, its PB vectors (10, 2); with physics also the terms of `CreativeNao/Boxing-v0`; and at
    the end of an episode `episode_measures`.

    ## Starting state
    The repertoire is empty, nothing has unfolded. Nothing is random but the draw of a memory from a part of the bank.

    ## Episode end
    Truncated after `n_actions` (30) movements, which are 300 steps; never terminated. An episode generates as many
    movements as in the other environments, so that their figures can be compared.

    ## Arguments
    | argument | default | meaning |
    | --- | --- | --- |
    | memory | `"half/0"` | name, file or memory; `"train"`, `"validation"`, `"test"`: drawn per episode |
    | n_actions | 30 | actions in an episode |
    | render_mode | None | `rgb_array`, `rgb_array_list`, `depth_array`, `human`: see below |
    | criteria | None | `measures.Criteria`: where the lines between outcomes are drawn |
    | overlay | False | whether colour frames tell outcome, nearest basic action and reward |
    | physics | False | whether the robot performs each movement |
    | limits | None | `robot.PhysicalLimits`, for `physics=True` |

    `render` returns: `rgb_array` the last movement at its widest, uint8 (480, 640, 3); `depth_array` how far away
    everything is in that picture [m], float32 (480, 640); `rgb_array_list` a film of all movements since the last call;
    `human` None, it plays the movement in a window.

    `gymnasium.make_vec(..., vectorization_mode="vector_entry_point")` makes many copies at once, with the same
    trajectories as separate copies of the same seeds; it also takes `autoreset_mode` and `n_threads`.

    ## Version history
    * v0: first version.
    """

    _unfolding = True

    def __init__(
        self,
        memory: MemoryLike = "half/0",
        n_actions: int = EPISODE_ACTIONS,
        render_mode: str | None = None,
        criteria: Criteria | None = None,
        overlay: bool = False,
        physics: bool = False,
        limits: PhysicalLimits | None = None,
    ) -> None:
        self.physics = physics
        self.limits = PhysicalLimits() if limits is None else limits
        super().__init__(memory, n_actions, render_mode, criteria, overlay)
        if physics:
            check_arms(self.memory.demonstrations.joints)
        self._movements = Movements(self._episodes)

    def _make_performer(self) -> Mind | Body:
        return Body(self._shared, self.limits) if self.physics else Mind(self._shared)

    @property
    def n_decisions(self) -> int:
        """Decisions of one movement."""
        return self._movements.n_decisions

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode with an empty repertoire and nothing unfolded; see `RepertoireEnv.reset`."""
        _, info = super().reset(seed=seed, options=options)
        self._movements.begin(0)
        return self._episodes.observer.vector(), info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Let the movement unfold for five more ticks under a PB vector.

        Args:
            action: PB vector, shape (n_pb,); values beyond [-1, 1] are clipped.

        Returns:
            Observation, reward, terminated (always False), truncated (after `n_actions` movements) and `info`.

        Raises:
            ShapeError: If the action does not have shape (n_pb,) or is not finite.
        """
        pb = checked_pb(action, self.action_space.shape)
        movements = self._movements
        movements.advance(ONLY_ROBOT, pb[None])
        info: dict[str, Any] = {
            "pb": pb,
            "step": int(self._episodes.n_actions[0]) * self.n_decisions + int(movements.n_decided[0]),
            "tick": int(movements.tick(ONLY_ROBOT)[0]),
            "posture": movements.posture(ONLY_ROBOT)[0],
        }
        reward = 0.0
        if movements.finished(ONLY_ROBOT)[0]:
            path = movements.pb_paths(ONLY_ROBOT)
            reward, terms = self._finish(path, movements.trajectories(ONLY_ROBOT))
            info.update(terms, pb_path=path[0])
            movements.next(0)
        done = (int(self._episodes.n_actions[0]) + int(movements.n_decided[0]) / self.n_decisions) / self.n_actions
        movements.tell(ONLY_ROBOT, pb[None], np.array([min(done, 1.0)]))
        if self.render_mode == "human":
            self.render()
        truncated = int(self._episodes.n_actions[0]) >= self.n_actions
        return self._episodes.observer.vector(), reward, False, truncated, info

    def get_state(self) -> EnvState:
        """Return the exact state, the movement under way included."""
        state = super().get_state()
        values, arrays = self._movements.state(0)
        return EnvState(state.kind, {**state.values, **values}, {**state.arrays, **arrays})

    def set_state(self, state: EnvState) -> None:
        """Go back to a state; see `RepertoireEnv.set_state`."""
        super().set_state(state)
        self._movements.restore(0, state.values, state.arrays)
