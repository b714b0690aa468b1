"""How fast is a compiled training epoch beside the readable one in torch?

    python benchmarks/training.py [--rounds 9] [--networks]

An epoch is all actions forward, backward through time, and a step of Adam, on both sides, of the same network on the
same six basic actions; torch runs with one thread, which is its fastest at this size. Both run by turns in one process.
Compared is the CPU time of the thread that computes, since wall time depends on what else the machine does; figures are
medians over the rounds.

With --networks, one and two networks train side by side in threads; the CPU time an epoch then costs gives the networks
of 100,000 epochs an hour that cores of one's own would finish. Wall time, which shares the cores with everything else
that runs, is printed beside it.
"""

import argparse
import statistics
import threading
import time

import numpy as np
import torch

from creative_nao import load_demonstrations
from creative_nao.model.config import NetworkSettings, TrainingSettings
from creative_nao.model.encoding import encoding_of, target_codes
from creative_nao.model.network import PBMTRNN, kl_divergence
from creative_nao.model.training import TrainingState, make_engine

NETWORK = NetworkSettings()
N_EPOCHS = 100_000  # of one network, as in the paper


def task() -> tuple[np.ndarray, np.ndarray]:
    demonstrations = load_demonstrations()
    return target_codes(encoding_of(demonstrations, NETWORK), demonstrations.trajectories)


def compiled_epochs(codes: np.ndarray, lengths: np.ndarray, ratio: float):
    """Return a function that runs n epochs of a network of its own and goes on where it stopped."""
    advance = make_engine(NETWORK, TrainingSettings(), codes, lengths)
    state = TrainingState.initial(NETWORK, codes.shape[2], len(codes), seed=0)
    return lambda n: advance(state, np.full(n, ratio))


def readable_epochs(codes: np.ndarray, lengths: np.ndarray, ratio: float):
    network = PBMTRNN(NETWORK, codes.shape[2], len(codes))
    target, steps = torch.from_numpy(codes), torch.from_numpy(lengths)
    optimizer = torch.optim.Adam(network.parameters(), lr=0.001)

    def run(n: int) -> None:
        for _ in range(n):
            optimizer.zero_grad()
            kl_divergence(network(target, ratio), target, steps).backward()
            optimizer.step()

    return run


def cpu_ms(run, n: int) -> float:
    """Return the milliseconds of CPU time of one of `n` epochs."""
    start = time.thread_time()
    run(n)
    return (time.thread_time() - start) / n * 1e3


def compare(ratio: float, rounds: int) -> float:
    """Print both sides at one closed-loop ratio and return the readable one's CPU time for an epoch [ms]."""
    readable, compiled = (make(*task(), ratio) for make in (readable_epochs, compiled_epochs))
    readable(2), compiled(2)  # compiles
    pairs = [(cpu_ms(readable, 10), cpu_ms(compiled, 300)) for _ in range(rounds)]
    slow, fast = (statistics.median(column) for column in zip(*pairs, strict=True))
    times = statistics.median(a / b for a, b in pairs)
    print(
        f"closed-loop ratio {ratio}: torch {slow:6.3f} ms, compiled {fast:6.3f} ms of CPU an epoch, {times:5.1f} x;"
        f" {N_EPOCHS} epochs in {fast * N_EPOCHS / 1e3:.0f} s on a core of its own"
    )
    return slow


def networks(n_threads: int, n_epochs: int, readable_ms: float) -> None:
    """Print how many networks an hour `n_threads` threads train."""
    runs = [compiled_epochs(*task(), ratio=0.5) for _ in range(n_threads)]
    cpu = [0.0] * n_threads

    def work(i: int) -> None:
        start = time.thread_time()
        for _ in range(n_epochs // 100):
            runs[i](100)
        cpu[i] = time.thread_time() - start

    threads = [threading.Thread(target=work, args=(i,)) for i in range(n_threads)]
    start = time.perf_counter()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    wall = time.perf_counter() - start
    per_hour = sum(3600 / (seconds / n_epochs * N_EPOCHS) for seconds in cpu)
    times = per_hour / (3600 / (readable_ms / 1e3 * N_EPOCHS))
    by_clock = n_threads * 3600 / wall * n_epochs / N_EPOCHS
    print(
        f"{n_threads} side by side: {per_hour:6.1f} networks an hour by CPU time, {times:5.1f} x torch on one core,"
        f" {times / n_threads:.1f} x torch on as many; {by_clock:.1f} an hour by the clock just now"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9, help="rounds; the median is printed")
    parser.add_argument("--networks", action="store_true", help="measure networks side by side as well")
    parser.add_argument("--n-epochs", type=int, default=10_000, help="epochs of each network side by side")
    options = parser.parse_args()
    torch.set_num_threads(1)
    readable = [compare(ratio, options.rounds) for ratio in (0.0, 0.5, 1.0)]
    if options.networks:
        for n_threads in (1, 2):
            networks(n_threads, options.n_epochs, readable[1])


if __name__ == "__main__":
    main()
