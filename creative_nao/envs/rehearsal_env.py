"""`CreativeNao/BoxingRehearsal-v0`: imagine movements, and perform the best of them when it is worth it."""

from __future__ import annotations

from typing import Any

from creative_nao.envs.boxing_envs import BoxingVectorEnv, page
from creative_nao.envs.episode_batch import EPISODE_ACTIONS
from creative_nao.envs.memory_set import MemoryLike
from creative_nao.envs.observation import Track
from creative_nao.envs.repertoire_env import RepertoireEnv
from creative_nao.measures import Criteria
from creative_nao.robot import PhysicalLimits
from creative_nao.schema import checked

EPISODE_IMAGINED = 240
"""Movements that may be imagined in an episode: eight for each that is performed."""


@page
class BoxingRehearsalEnv(RepertoireEnv):
    """Imagine movements before performing them: where to imagine, and when to stop.

    ## Description
    The robot builds a repertoire as in `CreativeNao/BoxingMental-v0`, but a step only imagines a movement: the memory
    generates it from the PB point of the action, and the observation tells what came out. With `commit` above 0 the
    robot then performs the best movement that it imagined since its last performance, this step's included, and earns
    its reward. Best is which is worth most, were it performed as it is generated; if none of them is usable, the last.
    So an agent decides where to imagine and for how long, within two budgets: movements performed and movements
    imagined.

    ## Action space
    `Box(-1, 1, (3,), float32)`

    | index | meaning | min | max | unit |
    | --- | --- | --- | --- | --- |
    | 0 | activation of PB unit 1 | -1 | 1 | 1 |
    | 1 | activation of PB unit 2 | -1 | 1 | 1 |
    | 2 | commit: above 0 the best movement imagined is performed | -1 | 1 | 1 |

    One more than the PB units of the memory.

    {rehearsal_observation}

    ## Rewards
    0 unless a movement is performed; then as in `CreativeNao/BoxingMental-v0`. With `physics=True` the robot performs
    it, and the body may refuse it as in `CreativeNao/Boxing-v0`.

    `info` of a step: `pb`, `step`, `n_imagined` (both: movements imagined so far), and of the movement imagined the
    terms of `CreativeNao/BoxingMental-v0` with `imagined_` before their names (`imagined_outcome`, ...,
    `imagined_trajectory`; `imagined_reward_novelty` is what it would earn now). When a movement is performed also these
    terms of it, without `imagined_`, and `performed_pb`; with physics those of `CreativeNao/Boxing-v0`; and at the end
    of an episode `episode_measures`.

    ## Starting state
    The repertoire is empty, nothing is imagined. Nothing is random but the draw of a memory from a split of the bank.

    ## Episode end
    Truncated when `n_actions` (30) movements are performed or `n_imagined` (240) are imagined, so after at most 240
    steps; never terminated. What was imagined and not performed by then is lost.

    ## Arguments
    | argument | default | meaning |
    | --- | --- | --- |
    {common_arguments}
    | n_imagined | 240 | movements to imagine in an episode, its most steps |
    | observation | `"trajectories"` | `"outcomes"`, `"points"` or `"trajectories"`: see above |
    | physics | False | whether the robot performs the movements |
    | limits | None | `robot.PhysicalLimits`, for `physics=True` |

    {rendering}

    ## Version history
    * v0: first version.
    """

    _rehearsal = True

    def __init__(
        self,
        memory: MemoryLike = "half/0",
        n_actions: int = EPISODE_ACTIONS,
        render_mode: str | None = None,
        criteria: Criteria | None = None,
        overlay: bool = False,
        n_imagined: int = EPISODE_IMAGINED,
        observation: str = Track.TRAJECTORIES.value,
        physics: bool = False,
        limits: PhysicalLimits | None = None,
        **drawing: Any,
    ) -> None:
        self.physics = checked(bool, physics, "physics")
        self.limits = checked(PhysicalLimits | None, limits, "limits") or PhysicalLimits()
        super().__init__(memory, n_actions, render_mode, criteria, overlay, n_imagined, observation, **drawing)


class BoxingRehearsalVectorEnv(BoxingVectorEnv):
    """Vector environment of `CreativeNao/BoxingRehearsal-v0`; see `BoxingRehearsalEnv`.

    Args:
        num_envs: Number of sub-environments.
        physics: Whether the robot performs the movements.
        n_imagined: How many movements each sub-environment may imagine in an episode.
        observation: What is observed, as of the single environment.
        arguments: Those of `BoxingVectorEnv`.
    """

    single_class = BoxingRehearsalEnv

    def __init__(
        self,
        num_envs: int = 1,
        *,
        physics: bool = False,
        n_imagined: int = EPISODE_IMAGINED,
        observation: str = Track.TRAJECTORIES.value,
        **arguments: Any,
    ) -> None:
        self.physics = checked(bool, physics, "physics")
        super().__init__(num_envs, n_imagined=n_imagined, observation=observation, **arguments)
