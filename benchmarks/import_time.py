"""How long `import creative_nao` takes in a fresh interpreter, and how much of it is Gymnasium's.

python benchmarks/import_time.py

Processor time of the interpreter after the import minus before it, the smallest of ten runs.
"""

import subprocess
import sys

CODE = "import time; start = time.process_time(); import {name}; print(time.process_time() - start)"


def import_time_s(name: str, n_runs: int = 10) -> float:
    """Return the smallest time [s] that the import of `name` takes in `n_runs` fresh interpreters."""
    runs = (
        subprocess.run([sys.executable, "-c", CODE.format(name=name)], capture_output=True, text=True, check=True)
        for _ in range(n_runs)
    )
    return min(float(run.stdout) for run in runs)


if __name__ == "__main__":
    for module in ("numpy", "gymnasium.envs.registration", "creative_nao"):
        print(f"{module:<30} {import_time_s(module):.3f} s")
