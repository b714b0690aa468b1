"""From a PB point to a program for a real NAO: generate, perform in physics, check, write.

python examples/06_put_an_action_on_a_nao.py --pb 0.3 -0.1 --out new_action.py

The written program holds angles and times and calls NAOqi's `angleInterpolation`. Without `--ip` it is a
dry run that sends nothing.
"""

import argparse
from pathlib import Path

import gymnasium as gym
import numpy as np

import creative_nao as cn
from creative_nao import exchange

parser = argparse.ArgumentParser()
parser.add_argument("--memory", default="half/0")
parser.add_argument("--pb", type=float, nargs=2, default=[0.3, -0.1], help="a point of the PB space")
parser.add_argument("--out", type=Path, default=Path("new_action.py"))
chosen = parser.parse_args()

env = gym.make("CreativeNao/Boxing-v0", memory=chosen.memory)
env.reset(seed=0)
_, reward, _, _, info = env.step(np.array(chosen.pb, dtype=np.float32))
env.close()
print(f"in physics: {info['outcome']}, most like {info['nearest_name']}, reward {reward:.2f}")

memory = cn.load_memory(chosen.memory)
motion = exchange.Motion(memory.generate([chosen.pb])[0], dt_s=memory.demonstrations.dt_s)
for finding in exchange.inspect(motion):
    print(f"beyond the robot: {finding}")
written = exchange.write(chosen.out, motion, unsafe="clip")  # clip ranges, slow down to speed limits
for change in written.changes:
    print(f"changed: {change}")
print(f"{written.path}: {written.motion.duration_s:.1f} s for the robot")
