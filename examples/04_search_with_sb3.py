"""Search a memory with an agent of Stable-Baselines3: train it on the bank, judge it on memories that it has not seen.

python examples/04_search_with_sb3.py
python examples/04_search_with_sb3.py --n-steps 200000 --out my_agent.zip
"""

import argparse
from pathlib import Path

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO

from creative_nao.envs import SB3VecEnv

parser = argparse.ArgumentParser()
parser.add_argument("--n-steps", type=int, default=30_000, help="movements to train on")
parser.add_argument("--n-envs", type=int, default=16, help="sub-environments")
parser.add_argument("--n-episodes", type=int, default=12, help="episodes of the evaluation")
parser.add_argument("--seed", type=int, default=0)
parser.add_argument("--out", type=Path, help="file for the policy, in the format of Stable-Baselines3")
chosen = parser.parse_args()

torch.set_num_threads(1)  # the networks are small: more threads gain nothing
venv = SB3VecEnv("CreativeNao/BoxingMental-v0", num_envs=chosen.n_envs, memory="train")
model = PPO("MlpPolicy", venv, n_steps=30, batch_size=30 * chosen.n_envs // 2, device="cpu", seed=chosen.seed)
model.learn(chosen.n_steps)
venv.close()
if chosen.out is not None:
    model.save(chosen.out)

env = gym.make("CreativeNao/BoxingMental-v0", memory="validation")  # the test memories are for the last figure alone
env.action_space.seed(chosen.seed)


def mean_return(choose) -> float:
    """Return the mean sum of rewards of an episode in which `choose` turns observations into PB points."""
    returns = []
    for episode in range(chosen.n_episodes):
        observation, _ = env.reset(seed=episode)
        total, ended = 0.0, False
        while not ended:
            observation, reward, terminated, truncated, _ = env.step(choose(observation))
            total, ended = total + float(reward), terminated or truncated
        returns.append(total)
    return float(np.mean(returns))


print(f"validation memories, {chosen.n_episodes} episodes of 30 movements, mean sum of rewards")
print(f"  uniform  {mean_return(lambda observation: env.action_space.sample()):.2f}")
print(f"  PPO      {mean_return(lambda observation: model.predict(observation, deterministic=False)[0]):.2f}")
