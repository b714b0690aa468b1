"""A robot with other joints: a memory of its movements as an environment.

python examples/07_memory_of_another_robot.py

Network, measures and mental environments take any named joints. Only `Boxing-v0`, which simulates physics, needs the
NAO. Here the robot is an arm of two joints with three basic actions.
"""

import argparse

import gymnasium as gym
import numpy as np

import creative_nao as cn
from creative_nao.model import NetworkSettings

parser = argparse.ArgumentParser()
parser.add_argument("--n-epochs", type=int, default=3_000)
parser.add_argument("--seed", type=int, default=0)
chosen = parser.parse_args()

time = np.linspace(0.0, 2 * np.pi, 40)
demos = cn.Demonstrations(
    names=("wave", "circle", "nod"),
    trajectories=[
        np.stack([np.zeros_like(time), 0.8 * np.sin(2 * time)], axis=1),
        np.stack([0.8 * (np.cos(time) - 1), 0.8 * np.sin(time)], axis=1),
        np.stack([0.6 * np.sin(time) ** 2, np.zeros_like(time)], axis=1),
    ],
    dt_s=0.1,
    joints=("shoulder", "elbow"),
)
small = NetworkSettings(layer_sizes=(20, 10, 5))
memory = cn.train(demos, network=small, closed_loop_ratio=0.5, n_epochs=chosen.n_epochs, seed=chosen.seed)
print(f"trained: loss {memory.best_loss:.2f}")

env = gym.make("CreativeNao/BoxingMental-v0", memory=memory)
env.action_space.seed(chosen.seed)
env.reset(seed=chosen.seed)
for _ in range(5):
    _, reward, _, _, info = env.step(env.action_space.sample())
    print(f"{info['outcome']:<12} most like {info['nearest_name']:<8} reward {reward:.2f}")
env.close()
