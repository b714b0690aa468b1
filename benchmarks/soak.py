"""Whether long use costs nothing but time: memory, threads and open files of a process that steps environments.

python benchmarks/soak.py                                  # a million mental steps, 20,000 physical ones
python benchmarks/soak.py --mental 100000 --physical 2000  # shorter
python benchmarks/soak.py --n-envs 24                      # many copies in one process

After a tenth of the steps as warm-up, memory may grow by 16 MiB, threads and open files by none. Linux only: it reads
/proc. Exit code 1 when something grows.
"""

import argparse
import gc
import os
import sys
import time

import gymnasium as gym

import creative_nao  # noqa: F401 - registers the environments

MAX_GROWTH_MIB = 16.0


def usage() -> tuple[float, int, int]:
    """Return resident memory [MiB], threads and open files of this process."""
    gc.collect()
    with open("/proc/self/statm", encoding="ascii") as statm:
        resident = int(statm.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
    return resident, len(os.listdir("/proc/self/task")), len(os.listdir("/proc/self/fd"))


def soak(name: str, n_steps: int, n_envs: int, memory: str) -> bool:
    """Take `n_steps` steps, print ten rows, return whether nothing grew."""
    env = gym.make_vec(name, n_envs, vectorization_mode="vector_entry_point", memory=memory)
    env.action_space.seed(0)
    env.reset(seed=0)
    print(f"\n{name}, {n_envs} copies, memory {memory}")
    print(f"{'steps':>10} {'MiB':>8} {'threads':>8} {'files':>6} {'steps/s':>8}")
    rows, start, done = [], time.perf_counter(), 0
    for tenth in range(1, 11):
        while done < n_steps * tenth // 10:
            env.step(env.action_space.sample())
            done += n_envs
        rows.append(usage())
        resident, threads, files = rows[-1]
        print(
            f"{done:>10} {resident:>8.1f} {threads:>8} {files:>6} {done / (time.perf_counter() - start):>8.0f}",
            flush=True,
        )
    env.close()
    growth = [last - first for first, last in zip(rows[0], rows[-1], strict=True)]
    print(f"grown since the first tenth: {growth[0]:+.1f} MiB, {growth[1]:+.0f} threads, {growth[2]:+.0f} files")
    return growth[0] <= MAX_GROWTH_MIB and growth[1] <= 0 and growth[2] <= 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--mental", type=int, default=1_000_000, help="mental steps")
    parser.add_argument("--physical", type=int, default=20_000, help="physical steps")
    parser.add_argument("--n-envs", type=int, default=1, help="copies in one process")
    parser.add_argument("--memory", default="half/0", help="memory, or train, validation, test")
    chosen = parser.parse_args()
    tasks = {"CreativeNao/BoxingMental-v0": chosen.mental, "CreativeNao/Boxing-v0": chosen.physical}
    flat = [soak(name, n_steps, chosen.n_envs, chosen.memory) for name, n_steps in tasks.items() if n_steps]
    sys.exit(0 if all(flat) else 1)
