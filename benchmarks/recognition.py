"""Does a memory find the PB of its own movements again, and what does it make of others'?

    python benchmarks/recognition.py [--n 200] [--memories open/0 half/0 closed/0] [--seed 1] [--full-length-only]

Three tables per memory, CPU time of one core:

- generated: random PB values whose movements are appropriate. *found*: the answer is within one cell of the 200 x 200
  map, 2/199, in every PB value. *equal*: it is elsewhere, but generates the same movement (DTW below 0.05 rad).
- the same with noise of 0.02 rad on every angle; DTW of the answer and of the true PB's movement to the noisy one.
- recordings: the six basic actions led by other hands (timing, reach, drift and tremor vary); DTW of the answer, of the
  best cell of the whole 200 x 200 map, of the PB value learned for that action, and of the basic action itself.
"""

import argparse
import time

import numpy as np

from creative_nao import load_memory
from creative_nao.demonstrations import GuidanceVariation, keyframes, vary
from creative_nao.maps import pb_grid
from creative_nao.measures import dtw, dtw_matrix, score
from creative_nao.model import Memory, recognition

CELL = 2 / 199
SAME_MOVEMENT = 0.05
NOISE_RAD = 0.02


def generated(memory: Memory, n: int, rng: np.random.Generator, noise: float) -> str:
    """Recognise `n` of the memory's own movements."""
    pb = rng.uniform(-1, 1, (5 * n, memory.network.n_pb))
    trajectories = memory.generate(pb)
    chosen = np.flatnonzero(score(trajectories, memory.demonstrations).appropriate)[:n]
    found, equal, errors, truths, seconds = 0, 0, [], [], []
    for k in chosen:
        target = trajectories[k] + noise * rng.standard_normal(trajectories[k].shape)
        start = time.process_time()
        answer = memory.infer_pb(target)
        seconds.append(time.process_time() - start)
        if np.abs(answer.pb - pb[k]).max() <= CELL:
            found += 1
        elif dtw(answer.trajectory, trajectories[k]) < SAME_MOVEMENT:
            equal += 1
        errors.append(answer.error)
        truths.append(dtw(trajectories[k], target))
    share = f"found {found}/{len(chosen)} ({100 * found / len(chosen):.1f} %), equal elsewhere {equal}"
    times = f"{np.mean(seconds):.2f} s each, {max(seconds):.2f} s at most"
    return f"{share}, DTW {np.mean(errors):.4f} (true PB {np.mean(truths):.4f}, worst {max(errors):.4f}), {times}"


def recordings(memory: Memory, n_hands: int, rng: np.random.Generator) -> str:
    """Recognise basic actions as other hands lead them."""
    whole = memory.generate(pb_grid(200))
    rows, right = [], 0
    for _ in range(n_hands):
        for place, name in enumerate(memory.demonstrations.names):
            target = vary(keyframes(name), GuidanceVariation(), rng).at(np.arange(memory.n_steps) * memory.dt_s)
            answer = memory.infer_pb(target)
            basic = memory.demonstrations.trajectories[place]
            right += int(dtw_matrix([answer.trajectory], memory.demonstrations.trajectories).argmin() == place)
            learned = memory.generate(memory.pb[place : place + 1])[0]
            rows.append([answer.error, dtw_matrix(whole, [target]).min(), dtw(learned, target), dtw(basic, target)])
    mean = np.mean(rows, axis=0)
    return (
        f"right action {right}/{len(rows)}, DTW {mean[0]:.2f} (best of 40,000 {mean[1]:.2f}, learned PB {mean[2]:.2f}, "
        f"basic action {mean[3]:.2f})"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=200, help="movements per memory")
    parser.add_argument("--memories", nargs="+", default=["open/0", "half/0", "closed/0"], help="names or files")
    parser.add_argument("--hands", type=int, default=5, help="other hands, six recordings each")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--full-length-only", action="store_true", help="leave out the search from short to long")
    options = parser.parse_args()
    if options.full_length_only:
        recognition.N_HORIZONS, recognition.FIRST_HORIZON = 1, 10**9
    for name in options.memories:
        memory = load_memory(name)
        memory.infer_pb(memory.demonstrations.trajectories[0])  # compiles
        rng = np.random.default_rng(options.seed)
        print(f"{name}, generated: {generated(memory, options.n, rng, 0.0)}")
        print(f"{name}, with noise: {generated(memory, options.n, rng, NOISE_RAD)}")
        if memory.network.n_pb == 2 and len(memory.joints) == 8:
            print(f"{name}, recordings: {recordings(memory, options.hands, rng)}", flush=True)


if __name__ == "__main__":
    main()
