"""Your own surrogate in 40 lines: an agent that predicts what untried PB points would generate, and looks there.

creative-nao evaluate frontier --agents random,examples.my_surrogate:MySurrogate --n-imagined 1,2

It is of the track `trajectories`: it is told whole movements, its own and those of the basic actions. Radial basis
functions interpolate between the movements seen so far; the agent takes the point whose predicted movement is farthest
from everything the robot knows.
"""

import numpy as np
from scipy.interpolate import RBFInterpolator

from creative_nao.agents import Agent
from creative_nao.measures import dtw_matrix


class MySurrogate(Agent):
    """Of 128 random points, choose the one whose predicted movement is the most novel."""

    name = "my_surrogate"
    track = "trajectories"
    learns_within_episode = True

    def start(self, context):
        """Begin with the basic actions and the points where they were learned."""
        self.points = list(context.points)
        self.movements = list(context.demonstrations.trajectories)
        self.known, self.failed = list(self.movements), []

    def choose(self, observation):
        """Return the PB point to try next."""
        space = self.context.action_space
        drawn = self.context.rng.uniform(space.low, space.high, (128, *space.shape))
        seen = np.array(self.movements)
        points, flat = np.array(self.points), seen.reshape(len(seen), -1)
        predict = RBFInterpolator(points, flat, smoothing=1e-3, kernel="multiquadric", epsilon=2.0)
        novelty = dtw_matrix(predict(drawn).reshape(len(drawn), *seen.shape[1:]), self.known).min(axis=1)
        for failed in self.failed:  # what lies next to a failure fails too
            novelty[np.linalg.norm(drawn - failed, axis=1) < 0.15] *= 0.1
        return drawn[novelty.argmax()]

    def learn(self, pb, observation, reward, info):
        """Keep the movement, imagined or performed; one that was performed and is usable is known from now on."""
        self.points.append(np.asarray(pb, np.float64) + 1e-6 * len(self.points))  # no two alike
        self.movements.append(info["trajectory"])
        if not info["appropriate"]:
            self.failed.append(pb)
        elif not info.get("imagined"):
            self.known.append(info["trajectory"])

    def learn_performed(self, pb, observation, reward, info):
        """Know the movement that was performed after looking ahead."""
        if info["appropriate"]:
            self.known.append(info["trajectory"])
