"""On a machine without fused multiply-add a distance is the same to the last digits, with the same bits everywhere."""

import os
import subprocess
import sys

import pytest

CODE = """
import llvmlite.binding

features = llvmlite.binding.get_host_cpu_features()
features["fma"] = False
llvmlite.binding.get_host_cpu_features = lambda: features  # numba compiles for it, too
import numpy as np
from creative_nao.measures import _dtw_kernels, dtw_matrix, dtw_pairs
from creative_nao.measures.dtw import cumulative_cost

assert not _dtw_kernels.FUSES
values = np.random.default_rng(0).normal(size=(12, 9, 8))
first, second = np.arange(11), np.arange(1, 12)
found = dtw_matrix(values)
assert (dtw_pairs(values, first, second) == found[first, second]).all()
expected = [cumulative_cost(values[a], values[b])[-1][-1] for a, b in zip(first, second)]
np.testing.assert_allclose(found[first, second], expected, rtol=1e-13)
"""


@pytest.mark.slow
def test_products_and_sums_are_rounded_one_by_one(tmp_path):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}  # what is compiled so shall not meet other tests
    done = subprocess.run([sys.executable, "-c", CODE], env=environment, capture_output=True, text=True)

    assert done.returncode == 0, done.stderr
