"""Movements under way, of one or many robots: a decision about the PB every few ticks, the network's state goes on.

Also here:
- `CreativeNao/BoxingModulation-v0`: the PB may change while a movement unfolds.
- Many copies of `CreativeNao/BoxingModulation-v0` at once.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from creative_nao.envs.episode_batch import Episodes
from creative_nao.envs.executors import Bodies, Body, Mind, check_arms
from creative_nao.envs.memory_set import MemoryLike
from creative_nao.envs.repertoire_env import EPISODE_ACTIONS, ONLY_ROBOT, RepertoireEnv, checked_pb
from creative_nao.envs.state import OF_THE_NETWORK, EnvState
from creative_nao.envs.vector_env import RepertoireVectorEnv
from creative_nao.errors import SettingsError
from creative_nao.measures import Criteria
from creative_nao.model.generation import ClosedLoopGenerator, Rollout
from creative_nao.model.memory import Memory
from creative_nao.robot import PhysicalLimits

DECISION_TICKS = 5
"""Ticks from one decision to the next."""


class Movements:
    """The movements under way of the robots of `episodes`, one each.

    Args:
        episodes: Their episodes; every memory has to be a `creative_nao.Memory`.

    Attributes:
        n_decisions: Decisions of a movement; the last one holds for what is left of it.
        n_decided: Decisions taken in the movement under way, shape (n_robots,).
    """

    def __init__(self, episodes: Episodes) -> None:
        facts = episodes.bank.first
        if not isinstance(facts.memory, Memory):
            raise SettingsError(
                "`memory` should be a `creative_nao.Memory`, whose network can be stopped between ticks, "
                f"but is a {type(facts.memory).__name__}"
            )
        n_robots, n_joints = len(episodes.n_actions), len(facts.demonstrations.joints)
        self._episodes = episodes
        self._n_steps = facts.n_steps
        self.n_decisions = -(-facts.n_steps // DECISION_TICKS)
        self.n_decided = np.zeros(n_robots, np.int64)
        self._angles = np.zeros((n_robots, facts.n_steps, n_joints))
        self._pb = np.zeros((n_robots, self.n_decisions, facts.n_pb))
        encoding = facts.memory.encoding
        self._low, self._high = encoding.references[:, 0], encoding.references[:, -1]
        self._under_way: list[Rollout] = [self._generator(robot).begin(1) for robot in range(n_robots)]
        self._posture = np.zeros((n_robots, n_joints))
        for robot in range(n_robots):
            self.begin(robot)

    def _generator(self, robot: int) -> ClosedLoopGenerator:
        return self._episodes.facts[robot].memory.generator

    def begin(self, robot: int) -> None:
        """Begin a robot's episode: it stands in its initial posture, and its observation tells so."""
        self.next(robot)
        self._posture[robot] = self._episodes.facts[robot].demonstrations.initial_posture
        self._tell_body(np.array([robot]))

    def next(self, robot: int) -> None:
        """Begin a robot's next movement: nothing of it has unfolded, the network is at rest."""
        self.n_decided[robot] = 0
        self._under_way[robot] = self._generator(robot).begin(1)

    def advance(self, robots: np.ndarray, pb: np.ndarray) -> None:
        """Let the movements of these robots unfold until their next decision, under PB vectors (m, n_pb)."""
        for robot, point in zip(robots, pb, strict=True):
            under_way, decided = self._under_way[robot], self.n_decided[robot]
            first = under_way.tick
            n_ticks = min(DECISION_TICKS, self._n_steps - first)
            angles = self._generator(robot).advance(under_way, point[None], n_ticks)[0]
            self._angles[robot, first : first + n_ticks] = angles
            self._posture[robot] = angles[-1]
            self._pb[robot, decided] = point
            self.n_decided[robot] = decided + 1

    def finished(self, robots: np.ndarray) -> np.ndarray:
        """Tell whose movement has unfolded, (m,) of bool."""
        return self.n_decided[robots] == self.n_decisions

    def tick(self, robots: np.ndarray) -> np.ndarray:
        """Return how many ticks have unfolded, (m,)."""
        return np.minimum(self.n_decided[robots] * DECISION_TICKS, self._n_steps)

    def posture(self, robots: np.ndarray) -> np.ndarray:
        """Return where the joints stand [rad], a copy of (m, n_joints)."""
        return self._posture[robots]

    def trajectories(self, robots: np.ndarray) -> np.ndarray:
        """Return the movements, a copy of (m, n_steps, n_joints) [rad]."""
        return self._angles[robots]

    def pb_paths(self, robots: np.ndarray) -> np.ndarray:
        """Return their PB vectors, a copy of (m, n_decisions, n_pb)."""
        return self._pb[robots]

    def tell(self, robots: np.ndarray, pb: np.ndarray, progress: np.ndarray) -> None:
        """Bring the observations up to date.

        Args:
            robots: Which robots, (m,).
            pb: Their last PB vectors, (m, n_pb).
            progress: Share of each one's episode that is over, (m,).
        """
        self._episodes.observer.put(robots, "pb", pb)
        self._episodes.observer.put(robots, "step", progress)
        self._tell_body(robots)

    def _tell_body(self, robots: np.ndarray) -> None:
        observer = self._episodes.observer
        share = 2.0 * (self._posture[robots] - self._low) / (self._high - self._low) - 1.0
        observer.put(robots, "posture", np.clip(share, -1.0, 1.0))
        n_slow = self._generator(0).n_slow
        slow = np.concatenate([self._under_way[robot].activity[:, -n_slow:] for robot in robots])
        observer.put(robots, "slow", np.clip(slow, -1.0, 1.0))
        observer.put(robots, "phase", self.n_decided[robots] / self.n_decisions)

    def state(self, robot: int) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Return a robot's movement under way as JSON-able values and arrays, for `restore`."""
        under_way = self._under_way[robot]
        values = {"n_decided": int(self.n_decided[robot]), "tick": under_way.tick}
        arrays = {
            "network_code": under_way.code.copy(),
            "network_state": under_way.state.copy(),
            "network_activity": under_way.activity.copy(),
            "unfolded": self._angles[robot].copy(),
            "pb_path": self._pb[robot].copy(),
            "posture": self._posture[robot].copy(),
        }
        return values, arrays

    def restore(self, robot: int, values: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        """Take over what `state` told; the robot's memory has to be in place already.

        Raises:
            SettingsError: If it does not fit the memory's network.
        """
        decided, tick = values["n_decided"], values["tick"]
        if decided >= self.n_decisions or tick != min(decided * DECISION_TICKS, self._n_steps):
            raise SettingsError(
                f"`state`: its `n_decided` should be below {self.n_decisions}, its `tick` {DECISION_TICKS} times that, "
                f"but they are {decided} and {tick}"
            )
        rest = self._generator(robot).begin(1)
        for name, array in zip(OF_THE_NETWORK, (rest.code, rest.state, rest.activity), strict=True):
            if arrays[name].shape != array.shape:
                raise SettingsError(
                    f"`state`: its array `{name}` should have shape {array.shape}, but has {arrays[name].shape}"
                )
        self.n_decided[robot] = decided
        self._under_way[robot] = Rollout(tick, *(arrays[name].copy() for name in OF_THE_NETWORK))
        self._angles[robot] = arrays["unfolded"]
        self._pb[robot] = arrays["pb_path"]
        self._posture[robot] = arrays["posture"]


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


class BoxingModulationVectorEnv(RepertoireVectorEnv):
    """Many copies of `CreativeNao/BoxingModulation-v0`; see `BoxingModulationEnv` and `RepertoireVectorEnv`.

    Args:
        physics: Whether the robot performs each movement.
        limits: From where on a performance counts as failed.
        arguments: Those of `RepertoireVectorEnv`.
    """

    _unfolding = True
    _kind = "BoxingModulationEnv"

    def __init__(
        self, num_envs: int = 1, *, physics: bool = False, limits: PhysicalLimits | None = None, **arguments: Any
    ) -> None:
        super().__init__(num_envs, **arguments)
        self.physics = physics
        if physics:
            check_arms(self._episodes.bank.first.demonstrations.joints)
            self._performer = Bodies(self._crew, self._shared, PhysicalLimits() if limits is None else limits)
        self._movements = Movements(self._episodes)

    def _begin(self, robots: np.ndarray, wanted: str | None = None) -> None:
        super()._begin(robots, wanted)
        for robot in robots:
            self._movements.begin(robot)

    def _act(
        self, robots: np.ndarray, pb: np.ndarray
    ) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]:
        movements, episodes = self._movements, self._episodes
        movements.advance(robots, pb)
        n = movements.n_decisions
        terms = {
            "pb": pb,
            "step": episodes.n_actions[robots] * n + movements.n_decided[robots],
            "tick": movements.tick(robots),
            "posture": movements.posture(robots),
        }
        rewards, finished = np.zeros(len(robots)), {"robots": robots[:0]}
        through = np.flatnonzero(movements.finished(robots))
        if len(through):
            who = robots[through]
            path = movements.pb_paths(who)
            scored, scored_terms = self._finish(who, path, movements.trajectories(who))
            rewards[through] = scored.reward
            finished = {"robots": who, **scored_terms, "pb_path": path}
            for robot in who:
                movements.next(robot)
        done = (episodes.n_actions[robots] + movements.n_decided[robots] / n) / self.n_actions
        movements.tell(robots, pb, np.minimum(done, 1.0))
        return rewards, terms, finished

    def _state(self, robot: int) -> EnvState:
        state = super()._state(robot)
        values, arrays = self._movements.state(robot)
        return EnvState(state.kind, {**state.values, **values}, {**state.arrays, **arrays})

    def _restore(self, robot: int, state: EnvState) -> None:
        super()._restore(robot, state)
        self._movements.restore(robot, state.values, state.arrays)
