"""Teach your own actions: write CSV files, check and load them.

python examples/02_teach_your_own_actions.py --out my_actions

Here two waves are computed; yours may come from a robot (record its encoders while you move its limp arms), from motion
capture, or from a spreadsheet. A CSV file needs a header `time_s,RShoulderPitch,...`, seconds and radians, at any
rate.
"""

import argparse
from pathlib import Path

import numpy as np

import creative_nao as cn
from creative_nao.demonstrations import save_trajectory
from creative_nao.joints import GUARD_ARM_RAD, JOINTS, MIRROR_SIGN

parser = argparse.ArgumentParser()
parser.add_argument("--out", type=Path, default=Path("my_actions"), help="folder for the CSV files")
chosen = parser.parse_args()

dt_s, n_steps = 0.02, 376  # 50 times a second, 7.5 s; loading resamples it to the tick of 0.15 s
guard = np.concatenate([np.array(GUARD_ARM_RAD), np.array(GUARD_ARM_RAD) * MIRROR_SIGN])
swing = 0.5 - 0.5 * np.cos(np.linspace(0.0, 6 * np.pi, n_steps))  # three times out and back, from 0 to 1

for side in ("Right", "Left"):
    trajectory = np.tile(guard, (n_steps, 1))
    pitch, roll = JOINTS.index(f"{side[0]}ShoulderPitch"), JOINTS.index(f"{side[0]}ElbowRoll")
    trajectory[:, pitch] -= 1.2 * swing  # the arm rises
    trajectory[:, roll] *= 1.0 - 0.7 * swing  # and straightens
    save_trajectory(chosen.out / f"{side.lower()}_wave.csv", trajectory, dt_s=dt_s)

demos = cn.load_demonstrations(chosen.out)
for name, trajectory in zip(demos.names, demos.trajectories, strict=True):
    print(f"{name}: {len(trajectory)} postures of {demos.dt_s} s")
print(f"largest speed {demos.max_speed:.2f} rad/s")
print(f"distance between the two: {cn.measures.dtw(*demos.trajectories):.1f}")
