"""Make the environment, step it, read its scores.

python examples/01_make_env.py
python examples/01_make_env.py --env CreativeNao/BoxingMental-v0 --n-steps 30
"""

import argparse

import gymnasium as gym

import creative_nao as cn

parser = argparse.ArgumentParser()
parser.add_argument("--env", default="CreativeNao/Boxing-v0", choices=sorted(cn.envs.ENVIRONMENTS))
parser.add_argument("--n-steps", type=int, default=5, help="movements to try")
parser.add_argument("--seed", type=int, default=0)
chosen = parser.parse_args()

env = gym.make(chosen.env)  # the memory half/0; gym.make(..., memory="train") draws one of the bank each episode
env.action_space.seed(chosen.seed)
observation, info = env.reset(seed=chosen.seed)
print(f"one observation: {observation.shape}, one action: {env.action_space}")

total = 0.0
for step in range(1, chosen.n_steps + 1):
    pb = env.action_space.sample()  # a PB point, which generates one whole movement
    observation, reward, terminated, truncated, info = env.step(pb)
    total += float(reward)
    if "outcome" in info:  # with BoxingModulation-v0 a movement takes ten steps
        print(f"{step:>3}  {info['outcome']:<12} most like {info['nearest_name']:<16} reward {reward:.2f}")
    if terminated or truncated:
        measures = info["episode_measures"]
        print(f"novelty {measures['novelty']:.1f}, diversity {measures['diversity']:.1f}")
        observation, info = env.reset()
print(f"sum of rewards {total:.2f}")
env.close()
