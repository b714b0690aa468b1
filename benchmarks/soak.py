"""Do the environments hold for hours? Memory, threads and open files over a long run.

    python benchmarks/soak.py [--mental 1000000] [--physical 20000] [--openings 100] [--minutes 60] [--out FILE]

All in one process. Three loads: `BoxingMental-v0` in 64 copies, `Boxing-v0` in 24 copies, and 24 copies of each opened,
stepped and closed again and again. Fifty times a load it notes the resident memory, the threads and the open files.
Memory is measured twice: as it is (resident), and after a garbage collection and the return of free blocks to the
system (held). It counts as flat when what is held grows by less than 4 MB after the first fifth of the samples: before,
caches fill (compiled code, buffers of the threads). Exits with 1 if anything grew. A load that reaches `--minutes` ends
there; the table says how much was done. Reads /proc, so it needs Linux.
"""

import argparse
import ctypes
import gc
import json
import os
import sys
import threading
import time
from collections.abc import Generator
from dataclasses import asdict, dataclass
from pathlib import Path

import gymnasium as gym
import numpy as np

import creative_nao  # noqa: F401 - registers the environments

MENTAL, BOXING = "CreativeNao/BoxingMental-v0", "CreativeNao/Boxing-v0"
N_SAMPLES, SETTLED = 50, 0.2
ALLOWED_MB = 4.0


@dataclass(frozen=True)
class Sample:
    """What the process holds at one moment."""

    n_done: int
    seconds: float
    resident_mb: float
    held_mb: float
    n_threads: int
    n_files: int


@dataclass(frozen=True)
class Verdict:
    """What a load did to the process, after the first fifth of its samples."""

    load: str
    n_done: int
    seconds: float
    grown_mb: float
    held_grown_mb: float
    more_threads: int
    more_files: int

    @property
    def flat(self) -> bool:
        return self.held_grown_mb < ALLOWED_MB and self.more_threads <= 0 and self.more_files <= 0


def status() -> dict[str, str]:
    """Return what the system tells of this process."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return dict(line.split(":", 1) for line in lines)


def resident_mb() -> float:
    """Return the memory that the process has in the machine's."""
    return int(status()["VmRSS"].split()[0]) / 1024


def sample(n_done: int, started: float) -> Sample:
    """Measure this process; threads are those of the system, not only Python's."""
    resident = resident_mb()
    gc.collect()
    if hasattr(libc := ctypes.CDLL(None), "malloc_trim"):  # of glibc
        libc.malloc_trim(0)
    return Sample(
        n_done,
        time.monotonic() - started,
        resident,
        resident_mb(),
        max(int(status()["Threads"]), threading.active_count()),
        len(os.listdir("/proc/self/fd")),
    )


def stepping(name: str, n_copies: int, n_steps: int) -> Generator[int]:
    """Step `n_copies` copies with seeded uniform points; yield the number of actions done so far."""
    rng = np.random.default_rng(0)
    env = gym.make_vec(name, n_copies, vectorization_mode="vector_entry_point")
    try:
        env.reset(seed=0)
        done = 0
        while done < n_steps:
            env.step(rng.uniform(-1, 1, (n_copies, 2)).astype(np.float32))
            done += n_copies
            yield done
    finally:
        env.close()


def opening(n_rounds: int, n_copies: int = 24) -> Generator[int]:
    """Open, step once and close `n_copies` copies of both environments; yield the number of rounds done."""
    actions = np.zeros((n_copies, 2), np.float32)
    for done in range(1, n_rounds + 1):
        for name in (MENTAL, BOXING):
            env = gym.make_vec(name, n_copies, vectorization_mode="vector_entry_point")
            env.reset(seed=done)
            env.step(actions)
            env.close()
        yield done


def soak(load: Generator[int], n: int, minutes: float = 60.0) -> list[Sample]:
    """Run a load of `n` units, or as many as fit into `minutes`, and measure fifty times."""
    started, samples, done = time.monotonic(), [], 0
    for done in load:
        late = time.monotonic() - started > 60 * minutes
        if done * N_SAMPLES >= n * (len(samples) + 1) or late:
            samples.append(sample(done, started))
        if late:
            break
    load.close()
    return samples


def judge(load: str, samples: list[Sample]) -> Verdict:
    """Compare the end of a load with the moment when a fifth of the samples was taken."""
    first, last = samples[int(SETTLED * len(samples))], samples[-1]
    return Verdict(
        load,
        last.n_done,
        last.seconds,
        last.resident_mb - first.resident_mb,
        last.held_mb - first.held_mb,
        last.n_threads - first.n_threads,
        last.n_files - first.n_files,
    )


def table(verdicts: list[Verdict]) -> str:
    """Return a Markdown table."""
    head = "| load | done | minutes | resident grown (MB) | held grown (MB) | threads | files | flat |"
    lines = [head, "| --- |" + " ---: |" * 6 + " --- |"]
    for one in verdicts:
        flat = "yes" if one.flat else "NO"
        memory = f"{one.grown_mb:+.1f} | {one.held_grown_mb:+.1f}"
        work = f"{one.load} | {one.n_done:,} | {one.seconds / 60:.1f}"
        lines.append(f"| {work} | {memory} | {one.more_threads:+d} | {one.more_files:+d} | {flat} |")
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mental", type=int, default=1_000_000, help="actions of BoxingMental-v0; 0 for none")
    parser.add_argument("--physical", type=int, default=20_000, help="actions of Boxing-v0; 0 for none")
    parser.add_argument("--openings", type=int, default=100, help="rounds of opening and closing; 0 for none")
    parser.add_argument("--minutes", type=float, default=60.0, help="longest time for each load")
    parser.add_argument("--out", type=Path, help="write every sample here as JSON")
    options = parser.parse_args()
    loads = [
        ("opened and closed, 24 copies of both", options.openings, lambda: opening(options.openings)),
        ("BoxingMental-v0, 64 copies", options.mental, lambda: stepping(MENTAL, 64, options.mental)),
        ("Boxing-v0, 24 copies", options.physical, lambda: stepping(BOXING, 24, options.physical)),
    ]
    verdicts, kept = [], {}
    for name, n, load in loads:
        if n < 1:
            continue
        samples = soak(load(), n, options.minutes)
        verdicts.append(judge(name, samples))
        kept[name] = [asdict(one) for one in samples]
        print(f"{name}: {samples[-1]}", file=sys.stderr, flush=True)
        if options.out is not None:
            options.out.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    print(table(verdicts))
    return 0 if all(one.flat for one in verdicts) else 1


if __name__ == "__main__":
    sys.exit(main())
