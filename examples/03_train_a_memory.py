"""Train a memory on basic actions, measure how well it reproduces them, and make its PB map.

python examples/03_train_a_memory.py --out mine.safetensors
python examples/03_train_a_memory.py --demonstrations my_actions --out mine.safetensors

The paper trains for 100,000 epochs. On the command line: `creative-nao train`, which resumes after a crash.
"""

import argparse
from pathlib import Path

import creative_nao as cn

parser = argparse.ArgumentParser()
parser.add_argument("--demonstrations", type=Path, help="folder of CSV files; default: the six boxing actions")
parser.add_argument("--closed-loop-ratio", type=float, default=0.5, help="0 open, 0.5 half closed, 1 closed loop")
parser.add_argument("--n-epochs", type=int, default=20_000)
parser.add_argument("--seed", type=int, default=0)
parser.add_argument("--resolution", type=int, default=50, help="points along each axis of the map")
parser.add_argument("--out", type=Path, default=Path("mine.safetensors"))
chosen = parser.parse_args()

demos = cn.load_demonstrations(chosen.demonstrations)
memory = cn.train(demos, closed_loop_ratio=chosen.closed_loop_ratio, n_epochs=chosen.n_epochs, seed=chosen.seed)
memory.save(chosen.out)
print(f"{chosen.out}: loss {memory.best_loss:.3f} at epoch {memory.best_epoch}")

reproduced = memory.generate(memory.pb)  # from the learned PB point of each basic action
for name, pb, taught, generated in zip(demos.names, memory.pb, demos.trajectories, reproduced, strict=True):
    place = ", ".join(f"{value:+.2f}" for value in pb)
    distance = cn.measures.dtw(taught, generated[: len(taught)])
    print(f"  {name:<16} PB ({place}), DTW distance {distance:.2f}")

pb_map = cn.pb_map(memory, resolution=chosen.resolution)
pb_map.plot(chosen.out.with_suffix(".png"))
for outcome in cn.measures.OUTCOMES:
    print(f"  {outcome:<12} {pb_map.share_pct(outcome):5.1f} %")
