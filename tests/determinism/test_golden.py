"""The same numbers as ever: to the bit where versions and processor are known, within a tolerance elsewhere."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

HERE = Path(__file__).parent
FILE = HERE.parent / "reference" / "golden.json"
GOLDEN = json.loads(FILE.read_text(encoding="utf-8"))


def computed(*arguments, **environment):
    done = subprocess.run(
        [sys.executable, HERE / "golden.py", *arguments],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def here():
    return computed()


@pytest.fixture(scope="module")
def tolerances():
    sys.path.insert(0, str(HERE))
    try:
        from golden import TOLERANCES
    finally:
        sys.path.remove(str(HERE))
    return TOLERANCES


def too_far(one, other, tolerances):
    """Return the names of quantities that are further apart than their tolerance."""
    return [
        name
        for name, (relative, absolute) in tolerances.items()
        if not np.allclose(one[name], other[name], rtol=relative, atol=absolute)
    ]


def test_known_versions_give_the_golden_bits_and_others_the_golden_numbers(here, tolerances):
    if here["key"] in GOLDEN:
        assert here["values"] == GOLDEN[here["key"]]
    for other in GOLDEN.values():
        assert not too_far(here["values"], other, tolerances)


def test_a_golden_number_that_is_off_is_noticed(here, tolerances):
    for name in tolerances:
        moved = here["values"] | {name: [10 + 2 * value for value in here["values"][name]]}
        assert too_far(moved, here["values"], tolerances) == [name]


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system pins no process to a core")
@pytest.mark.slow
def test_one_core_gives_the_bits_of_all(here):
    """Generation, map, scores, both environments, training of several seeds and torch, in one process each."""
    assert computed("1", OMP_NUM_THREADS="1")["values"] == here["values"]


@pytest.mark.slow
def test_torch_with_two_threads_gives_the_bits_of_one(here):
    assert computed("2", OMP_NUM_THREADS="2")["values"] == here["values"]


@pytest.mark.slow
def test_another_processor_stays_within_the_tolerance(here, tolerances, tmp_path):
    """Code compiled for the plainest processor of this family: no fused multiplication, narrower lanes."""
    plain = {"arm64": "generic", "aarch64": "generic"}.get(os.uname().machine, "x86-64") if os.name == "posix" else ""
    other = computed(NUMBA_CPU_NAME=plain or "generic", NUMBA_CPU_FEATURES="", NUMBA_CACHE_DIR=str(tmp_path))
    assert not too_far(other["values"], here["values"], tolerances)
