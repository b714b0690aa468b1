"""How fast is closed-loop generation beside the plain loop over ticks in torch?

    python benchmarks/generation.py [--memory half/0] [--resolution 200] [--rounds 5] [--wall]

Every point of the PB map unfolds for 50 ticks. Torch runs the loop of the equations without gradients, in batches of
several sizes, because it is fastest when a batch fits the cache; its best one counts. All run by turns in one process.
Compared is CPU time over all threads, with torch on one thread, since wall time depends on what else the machine does;
on a machine of one's own, --wall compares wall time, with as many torch threads as cores. Figures are medians over the
rounds.
"""

import argparse
import statistics
import time

import numpy as np
import torch

from creative_nao import load_memory
from creative_nao.maps import pb_grid
from creative_nao.model.config import layer_time_constants, neighbour_mask
from creative_nao.model.memory import Memory
from creative_nao.runtime import usable_cores

BATCH_SIZES = (250, 500, 1000, 4000)


class TorchLoop:
    """Eq. 1-3, 5 at ratio 1 and 7, tick by tick, for one batch size."""

    def __init__(self, memory: Memory, n_steps: int, batch_size: int) -> None:
        self.p = {name: torch.from_numpy(array.copy()) for name, array in memory.parameters.items()}
        self.w_hidden = self.p["w_hidden"] * torch.from_numpy(neighbour_mask(memory.network))
        self.rate = torch.from_numpy(1 / layer_time_constants(memory.network))
        self.n_fast, self.n_units = memory.network.layer_sizes[0], memory.network.n_softmax_units
        self.posture = torch.from_numpy(memory.demonstrations.initial_posture).float()
        self.code = torch.from_numpy(memory.encoding.encode(memory.demonstrations.initial_posture)).float()
        self.references = torch.from_numpy(memory.encoding.references).float()
        self.n_steps, self.batch_size = n_steps, batch_size

    def batch(self, pb: torch.Tensor) -> torch.Tensor:
        p, fast = self.p, slice(self.n_fast)
        drive = pb @ p["w_pb"] + p["b_hidden"]
        x, u = self.code.expand(len(pb), -1), torch.zeros(len(pb), len(self.rate))
        y = torch.tanh(u)
        angles = torch.empty(len(pb), self.n_steps, len(self.references))
        angles[:, 0] = self.posture
        for t in range(1, self.n_steps):
            code = torch.softmax((y[:, fast] @ p["w_out"] + p["b_out"]).unflatten(1, (-1, self.n_units)), dim=2)
            total = drive + y @ self.w_hidden
            total[:, fast] += x @ p["w_in"]
            u += self.rate * (total - u)
            y = torch.tanh(u)
            angles[:, t] = (code * self.references).sum(dim=2)
            x = code.flatten(1)
        return angles

    def __call__(self, pb: np.ndarray) -> np.ndarray:
        with torch.inference_mode():
            batches = torch.from_numpy(pb).float().split(self.batch_size)
            return torch.cat([self.batch(batch) for batch in batches]).double().numpy()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--memory", default="half/0", help="shipped name or file of the memory that acts")
    parser.add_argument("--resolution", type=int, default=200, help="points along each side of the map")
    parser.add_argument("--rounds", type=int, default=5, help="rounds; the median is printed")
    parser.add_argument("--wall", action="store_true", help="compare wall time on all cores")
    options = parser.parse_args()
    torch.set_num_threads(1)
    memory, pb = load_memory(options.memory), pb_grid(options.resolution)
    n_steps = len(memory.demonstrations.trajectories[0])
    calls = {f"torch, batches of {size}": TorchLoop(memory, n_steps, size) for size in BATCH_SIZES}
    calls["creative_nao"] = memory.generate
    for call in calls.values():
        call(pb[:5000])  # compiles
    clock = time.perf_counter if options.wall else time.process_time
    if options.wall:
        torch.set_num_threads(usable_cores())
    seconds = {name: [] for name in calls}
    for _ in range(options.rounds):
        for name, call in calls.items():
            start = clock()
            call(pb)
            seconds[name].append(clock() - start)
    medians = {name: statistics.median(values) for name, values in seconds.items()}
    for name, median in medians.items():
        print(f"{name:22} {median:6.3f} s {'by the clock' if options.wall else 'of CPU'}")
    ratio = min(median for name, median in medians.items() if name != "creative_nao") / medians["creative_nao"]
    print(f"{len(pb)} points x {n_steps} ticks: {ratio:.1f} x torch at its best")
    some = slice(None, None, 97)
    error = np.abs(memory.generate(pb[some], n_steps=20) - calls["torch, batches of 1000"](pb[some])[:, :20]).max()
    print(f"largest difference in the first 20 ticks: {error:.0e} rad")


if __name__ == "__main__":
    main()
