"""How fast is our warping distance beside dtaidistance?

    python benchmarks/dtw.py [--n-steps 100] [--n-map 2000] [--n-archive 300] [--rounds 5]

Three kinds of work: a map (many actions against six basic ones), an archive (all pairs), and an environment step (one
action against 36 known ones). Both libraries in one process, by turns. dtaidistance runs its fastest call of the same
definition (`distance_matrix_fast`, Euclidean local cost, one thread). Compared is CPU time over all threads, since wall
time depends on what else the machine does; ratios are medians over the rounds. The paper's map is `--n-map 40000`, a
large archive `--n-archive 2000`.
"""

import argparse
import statistics
import time
from collections.abc import Callable

import numpy as np
from dtaidistance import dtw_ndim

from creative_nao.measures import dtw_matrix

N_BASIC, N_KNOWN = 6, 36
STEPS_TIMED = 200
"""Environment steps timed together: one alone is too short to time."""


def data(n: int, n_steps: int, rng: np.random.Generator) -> list[np.ndarray]:
    """Smooth actions of eight joints: sums of three slow sines."""
    t = np.linspace(0.0, 1.0, n_steps)[:, None, None]
    frequency, phase = rng.uniform(0.5, 3.0, (n, 1, 3, 8)), rng.uniform(0.0, 6.3, (n, 1, 3, 8))
    return list(0.4 * np.sin(2 * np.pi * frequency * t + phase).sum(axis=2))


def cpu_seconds(call: Callable[[], object]) -> float:
    start = time.process_time()
    call()
    return time.process_time() - start


def theirs(a: list[np.ndarray], b: list[np.ndarray]) -> np.ndarray:
    """Distances of every action of `a` to every one of `b` by dtaidistance."""
    n, block = len(a), ((0, len(a)), (len(a), len(a) + len(b)))
    flat = dtw_ndim.distance_matrix_fast([*a, *b], block=block, compact=True, parallel=False, inner_dist="euclidean")
    return np.reshape(flat, (n, len(b)))


def all_pairs(a: list[np.ndarray]) -> np.ndarray:
    """Distances of all pairs by dtaidistance, each pair once, as a square."""
    flat = dtw_ndim.distance_matrix_fast(a, compact=True, parallel=False, inner_dist="euclidean")
    square = np.zeros((len(a), len(a)))
    square[np.triu_indices(len(a), 1)] = flat
    return square + square.T


def compare(title: str, calls: dict[str, Callable[[], np.ndarray]], repeat: int, cells: float, rounds: int) -> None:
    """Time the calls by turns and print each beside the first."""
    results = {name: call() for name, call in calls.items()}  # compiles
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            seconds[name].append(cpu_seconds(lambda call=call: [call() for _ in range(repeat)]) / repeat)
    first = next(iter(calls))
    print(title)
    for name in calls:
        ratio = statistics.median(a / b for a, b in zip(seconds[first], seconds[name], strict=True))
        unequal = results[first] > 0
        error = np.abs(results[name][unequal] / results[first][unequal] - 1).max()
        took = statistics.median(seconds[name])
        print(
            f"  {name:14} {took * 1e3:10.2f} ms {took / cells * 1e9:6.2f} ns a cell {ratio:6.1f} x "
            f"  largest relative difference {error:.0e}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n-steps", type=int, default=100, help="postures in an action")
    parser.add_argument("--n-map", type=int, default=2000, help="actions in the map")
    parser.add_argument("--n-archive", type=int, default=300, help="actions in the archive")
    parser.add_argument("--rounds", type=int, default=5, help="rounds; the median is printed")
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    many, basic = data(options.n_map, options.n_steps, rng), data(N_BASIC, options.n_steps, rng)
    archive, (new, *known) = data(options.n_archive, options.n_steps, rng), data(N_KNOWN + 1, options.n_steps, rng)
    pair, rounds = options.n_steps**2, options.rounds
    compare(
        f"map: {len(many)} actions against {N_BASIC}",
        {
            "dtaidistance": lambda: theirs(many, basic),
            "float32": lambda: dtw_matrix(many, basic, np.float32),
            "float64": lambda: dtw_matrix(many, basic),
        },
        1, len(many) * N_BASIC * pair, rounds,
    )  # fmt: skip
    compare(
        f"archive: all pairs of {len(archive)} actions",
        {
            "dtaidistance": lambda: all_pairs(archive),
            "float32": lambda: dtw_matrix(archive, dtype=np.float32),
            "float64": lambda: dtw_matrix(archive),
        },
        1, len(archive) * (len(archive) - 1) / 2 * pair, rounds,
    )  # fmt: skip
    compare(
        f"environment step: one action against {N_KNOWN}",
        {
            "dtaidistance": lambda: theirs([new], known),
            "float32": lambda: dtw_matrix([new], known, np.float32),
            "float64": lambda: dtw_matrix([new], known),
        },
        STEPS_TIMED, N_KNOWN * pair, rounds,
    )  # fmt: skip


if __name__ == "__main__":
    main()
