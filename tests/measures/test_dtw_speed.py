import statistics
import time

import numpy as np
from dtaidistance import dtw_ndim

from creative_nao.measures import dtw_matrix


def cpu_seconds(call):
    start = time.process_time()
    call()
    return time.process_time() - start


def test_the_kernel_has_not_lost_its_vector_instructions():
    """Where the compiler falls back to one lane at a time the ratio is about 1; here it was 10 to 18."""
    walks = np.cumsum(np.random.default_rng(0).normal(scale=0.2, size=(390, 60, 8)), axis=1)
    many, few = list(walks[:384]), list(walks[384:])
    block = ((0, 384), (384, 390))

    def theirs():
        dtw_ndim.distance_matrix_fast(many + few, block=block, compact=True, parallel=False, inner_dist="euclidean")

    dtw_matrix(many, few, np.float32)
    ratios = [cpu_seconds(theirs) / cpu_seconds(lambda: dtw_matrix(many, few, np.float32)) for _ in range(5)]
    assert statistics.median(ratios) > 4.0
