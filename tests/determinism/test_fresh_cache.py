"""Processes that fill one empty cache of compiled code at the same time compute the same bits, and so do later ones."""

import os
import subprocess
import sys

import pytest

CODE = """
import hashlib
import numpy as np
import creative_nao as cn
from creative_nao.measures import dtw_matrix, dtw_pairs

rng = np.random.default_rng(0)
digest = hashlib.sha256()
for dtype in (np.float32, np.float64):
    for n_joints in (8, 13):
        values = rng.normal(size=(40, 21, n_joints)).astype(dtype)
        first, second = rng.integers(0, 40, (2, 100))
        pairs = dtw_pairs(values, first, second, dtype)
        assert (pairs == dtw_matrix(values, dtype=dtype)[first, second]).all(), "a pair alone has other bits"
        digest.update(pairs.tobytes())
memory = cn.load_memory("half/0")
digest.update(memory.generate(rng.uniform(-1, 1, (40, 2))).tobytes())
print(digest.hexdigest())
"""


@pytest.mark.slow
def test_processes_that_share_an_empty_cache_agree(tmp_path):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", CODE]
    told = []
    for n_together in (4, 2):  # the first fill it, the others read it
        together = [
            subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            for _ in range(n_together)
        ]
        for process in together:
            out, error = process.communicate(timeout=300)
            assert process.returncode == 0, error
            told.append(out)

    assert len(set(told)) == 1
    assert any(tmp_path.rglob("*.nbc"))
