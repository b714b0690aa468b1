"""Work out what the oracle chooses on memories of the bank: `python benchmarks/oracle_sets.py [MEMORY ...]`.

Writes `creative_nao/evaluation/oracle_sets.safetensors`; memories that it already holds are kept as they are. Without
names: half/0, and the validation and test memories of two, four and eight PB units. Half a minute of a core each.
"""

import sys
import time

from creative_nao import load_memory
from creative_nao.evaluation.oracle_sets import N_SHIPPED, find_oracle_set, save_oracle_sets, shipped_oracle_set
from creative_nao.maps import PAPER_RESOLUTION
from creative_nao.model import split_memories

PARTS = ("validation", "test", "validation-4pb", "test-4pb", "validation-8pb", "test-8pb")


def main() -> None:
    """Search the memories named on the command line."""
    names = sys.argv[1:] or ["half/0", *(name for part in PARTS for name in split_memories(part))]
    found = {name: one for name in names if (one := shipped_oracle_set(name, N_SHIPPED)) is not None}
    for name in names:
        if name not in found:
            start = time.perf_counter()
            found[name], _ = find_oracle_set(load_memory(name), N_SHIPPED, PAPER_RESOLUTION)
            save_oracle_sets(found, "python benchmarks/oracle_sets.py")
            total = found[name].rewards[:30].sum()
            print(f"{name}: {total:.2f} in 30 movements, {time.perf_counter() - start:.0f} s", flush=True)


if __name__ == "__main__":
    main()
