"""`CreativeNao/BoxingMental-v0`: the robot acts in its mind only, as in the paper."""

from __future__ import annotations

from creative_nao.envs.repertoire_env import RepertoireEnv


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
