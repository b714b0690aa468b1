"""Evaluate your own agent by the protocol of the project: equal budgets, seeds, unseen memories, intervals.

python examples/05_evaluate_your_own_agent.py

An agent is a class whose `choose` maps an observation to a PB point. This one prefers points far from those it tried.
Policies with the `predict` method of Stable-Baselines3 are wrapped by `creative_nao.agents.PolicyAgent`.
`creative-nao evaluate leaderboard` compares the run folders of the suites.
"""

import argparse

import gymnasium as gym
import numpy as np

import creative_nao  # noqa: F401 - registers the environments
from creative_nao.agents import Agent, RandomAgent
from creative_nao.evaluation.protocol import play
from creative_nao.evaluation.statistics import estimate
from creative_nao.model import split_memories


class FarFromTried(Agent):
    """Of 32 random points, choose the one farthest from all points tried in this episode."""

    name = "far-from-tried"
    learns_within_episode = True

    def start(self, context):
        """Forget the previous episode."""
        self.tried = [np.zeros(context.action_space.shape)]

    def choose(self, observation):
        """Return the PB point to try next."""
        space = self.context.action_space
        candidates = self.context.rng.uniform(space.low, space.high, (32, *space.shape))
        distances = np.linalg.norm(candidates[:, None] - np.array(self.tried), axis=-1).min(axis=1)
        return candidates[distances.argmax()].astype(space.dtype)

    def learn(self, pb, observation, reward, info):
        """Store the point; `reward` and `info` hold the result."""
        self.tried.append(np.asarray(pb))


parser = argparse.ArgumentParser()
parser.add_argument("--env", default="CreativeNao/BoxingMental-v0")
parser.add_argument("--memories", nargs="+", default=list(split_memories("test")), help="default: the test split")
parser.add_argument("--n-seeds", type=int, default=3)
chosen = parser.parse_args()

for agent in (RandomAgent(), FarFromTried()):
    rewards = np.zeros((chosen.n_seeds, len(chosen.memories)))
    for column, memory in enumerate(chosen.memories):
        env = gym.make(chosen.env, memory=memory)
        for seed in range(chosen.n_seeds):
            rewards[seed, column] = play(agent, env, env_id=chosen.env, memory=memory, seed=seed).reward
        env.close()
    found = estimate(rewards, rng=np.random.default_rng(0))
    interval = "" if found["low"] is None else f" [{found['low']:.2f}, {found['high']:.2f}]"
    print(f"{agent.name:<16} {found['mean']:.2f}{interval}")
