"""How fast is our warping distance beside dtaidistance?

    python benchmarks/dtw.py [--n-steps 100] [--n-trajectories 2000] [--rounds 5]

Both in one process, by turns. dtaidistance runs its fastest call of the same definition (`distance_matrix_fast` on
blocks, Euclidean local cost, one thread). Compared is CPU time over all threads, since wall time depends on what else
the machine does; ratios are medians over the rounds. The last line is the latency of one new action against 36 known.
"""

import argparse
import statistics
import time

import numpy as np
from dtaidistance import dtw_ndim

from creative_nao.measures import dtw_matrix

N_ACTIONS = 6


def data(n: int, n_steps: int, rng: np.random.Generator) -> list[np.ndarray]:
    """Smooth actions of eight joints: sums of three slow sines."""
    t = np.linspace(0.0, 1.0, n_steps)[:, None, None]
    frequency, phase = rng.uniform(0.5, 3.0, (n, 1, 3, 8)), rng.uniform(0.0, 6.3, (n, 1, 3, 8))
    return list(0.4 * np.sin(2 * np.pi * frequency * t + phase).sum(axis=2))


def cpu_seconds(call) -> float:
    start = time.process_time()
    call()
    return time.process_time() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n-steps", type=int, default=100, help="postures in an action")
    parser.add_argument("--n-trajectories", type=int, default=2000, help="actions in the map")
    parser.add_argument("--rounds", type=int, default=5, help="rounds; the median is printed")
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    many, few = data(options.n_trajectories, options.n_steps, rng), data(N_ACTIONS, options.n_steps, rng)
    n, both = len(many), [*many, *few]

    def theirs() -> np.ndarray:
        block = ((0, n), (n, n + N_ACTIONS))
        flat = dtw_ndim.distance_matrix_fast(both, block=block, compact=True, parallel=False, inner_dist="euclidean")
        return np.reshape(flat, (n, N_ACTIONS))

    calls = {
        "dtaidistance": theirs,
        "float32": lambda: dtw_matrix(many, few, np.float32),
        "float64": lambda: dtw_matrix(many, few),
        "float32 array": lambda: dtw_matrix(np.array(many), few, np.float32),
    }
    results = {name: call() for name, call in calls.items()}  # compiles
    seconds = {name: [] for name in calls}
    for _ in range(options.rounds):
        for name, call in calls.items():
            seconds[name].append(cpu_seconds(call))
    cells = n * N_ACTIONS * options.n_steps**2
    for name in calls:
        ratio = statistics.median(a / b for a, b in zip(seconds["dtaidistance"], seconds[name], strict=True))
        error = np.max(np.abs(results[name] / results["dtaidistance"] - 1))
        cost = statistics.median(seconds[name]) / cells * 1e9
        print(f"{name:14} {cost:6.2f} ns per pair of postures, {ratio:5.1f} x, largest relative difference {error:.0e}")
    latency = []
    for _ in range(200):
        start = time.perf_counter()
        dtw_matrix(many[:1], many[:36])
        latency.append(time.perf_counter() - start)
    print(f"one action against 36: {statistics.median(latency) * 1e3:.2f} ms (float64)")


if __name__ == "__main__":
    main()
