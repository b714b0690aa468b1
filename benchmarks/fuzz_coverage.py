"""Fuzz every loader with a fuzzer that sees which lines an input reaches (atheris, on libFuzzer).

    pip install atheris
    python benchmarks/fuzz_coverage.py --seconds 60 --seed 0

Beside `benchmarks/fuzz_loaders.py`, which hears reasons where this one measures coverage; good files, mutations, what
counts as a finding and where findings are written are the same. Half of the inputs are broken by
`tests/hostile/mutations.py`, half by libFuzzer. Each kind of file has a process of its own for `--seconds`.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np

try:
    import atheris
except ImportError:
    sys.exit("this fuzzer needs atheris, which has wheels for Linux: pip install atheris")

# Only the processes that fuzz are measured. Kernels are imported when they are first needed, which is later: numba
# could not compile what is instrumented.
with atheris.instrument_imports(include=["creative_nao"]) if "--one" in sys.argv else contextlib.nullcontext():
    import fuzz_loaders
    from fuzz_loaders import KINDS, Campaign, make_victims, mutate


def main() -> int:
    """Fuzz one kind after the other, print a table, and return 1 if there is a finding."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=int, default=60, help="how long each kind")
    parser.add_argument("--seed", type=int, default=0, help="decides libFuzzer's choices and ours")
    parser.add_argument("--kinds", default=",".join(KINDS), help="only these kinds of file, with commas between")
    parser.add_argument("--corpus", type=Path, default=fuzz_loaders.CORPUS, help="where findings are written")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.one is not None:
        fuzz(chosen.one, chosen)
        return 0
    n_found = 0
    print("| kind | inputs | edges at the start | edges at the end | findings |\n| --- | ---: | ---: | ---: | ---: |")
    for kind in chosen.kinds.split(","):
        words = ["--one", kind, "--seconds", str(chosen.seconds), "--seed", str(chosen.seed), "--corpus", chosen.corpus]
        with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:  # libFuzzer leaves all in it
            done = subprocess.run(
                [sys.executable, __file__, *words], env=os.environ | {"TMPDIR": folder}, capture_output=True,
                text=True, errors="replace",
            )  # fmt: skip
        told = done.stderr + done.stdout
        inputs = re.search(r"number_of_executed_units:\s*(\d+)", told)
        edges = re.findall(r"cov: (\d+)", told)
        if inputs is None or not edges:
            print(told[-3000:], file=sys.stderr)
            return 2
        findings = re.findall(r"^finding: .*", told, flags=re.MULTILINE)
        n_found += len(findings)
        print(f"| {kind} | {int(inputs[1]):,} | {edges[0]} | {edges[-1]} | {len(findings)} |", flush=True)
        for finding in findings:
            print(finding, file=sys.stderr)
    return 1 if n_found else 0


def fuzz(kind: str, chosen: argparse.Namespace) -> None:
    """Fuzz one kind; libFuzzer ends the process."""
    warnings.simplefilter("error")
    fuzz_loaders.signal.signal(fuzz_loaders.signal.SIGPROF, fuzz_loaders._too_long)
    folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
    victims = make_victims(folder / "good")
    campaign = Campaign({kind: victims[kind]}, folder, chosen.corpus, chosen.seed)
    seeds = folder / "seeds"
    seeds.mkdir()
    for number, content in enumerate(campaign.seeds[kind]):
        (seeds / str(number)).write_bytes(content)
    others = [victim.path.read_bytes() for victim in victims.values()]

    def mutated(content: bytes, largest: int, seed: int) -> bytes:
        if seed % 2:
            return atheris.Mutate(content, largest)
        return mutate(content, others, np.random.default_rng(seed))[:largest]

    atheris.Setup(
        [sys.argv[0], f"-max_total_time={chosen.seconds}", f"-seed={chosen.seed + 1}", "-max_len=20000",
         "-print_final_stats=1", f"-artifact_prefix={folder}/", str(seeds)],
        lambda content: campaign.try_one(kind, content),
        custom_mutator=mutated,
    )  # fmt: skip
    print(json.dumps({"kind": kind, "seeds": len(campaign.seeds[kind])}), flush=True)
    atheris.Fuzz()


if __name__ == "__main__":
    sys.exit(main())
