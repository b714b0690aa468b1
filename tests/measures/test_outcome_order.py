import numpy as np
import pytest

from creative_nao.measures._dtw_kernels import measure_rows
from creative_nao.measures.outcome import (
    ALL_OUTCOMES,
    NO_FAULT,
    OUTCOME_CODE,
    SPEED_TOLERANCE,
    excursions,
    largest_speeds,
    outcome_codes,
    speed_limits,
)


@pytest.mark.parametrize(
    ("too_fast", "fault", "non_moving", "distance", "outcome"),
    [
        (True, "fell", True, 0.0, "fluctuating"),
        (False, "fell", True, 0.0, "fell"),
        (False, None, True, 0.0, "non_moving"),
        (False, None, False, 10.0, "learned"),
        (False, None, False, np.nextafter(10.0, 11.0), "unlearned"),
    ],
)
def test_the_first_that_holds_decides(too_fast, fault, non_moving, distance, outcome):
    codes = outcome_codes(
        np.array([distance]),
        too_fast=np.array([too_fast]),
        non_moving=np.array([non_moving]),
        fault=np.array([NO_FAULT if fault is None else OUTCOME_CODE[fault]]),
    )
    assert [ALL_OUTCOMES[code] for code in codes] == [outcome]


def test_the_compiled_twin_has_the_same_bits(taught, blends):
    performed = blends[::-1].copy()
    limit = speed_limits(taught) * SPEED_TOLERANCE
    too_fast, excursion = np.zeros(len(blends), bool), np.zeros(len(blends))
    which = np.zeros(len(blends), np.int64)

    assert measure_rows(which, blends, performed, np.array([taught.dt_s]), limit[None], too_fast, excursion) == -1
    np.testing.assert_array_equal(too_fast, (largest_speeds(blends, taught.dt_s) > limit).any(axis=1))
    np.testing.assert_array_equal(excursion, excursions(performed))
    assert 0 < too_fast.sum() < len(blends)

    performed[7, 3, 2] = np.inf
    assert measure_rows(which, blends, performed, np.array([taught.dt_s]), limit[None], too_fast, excursion) == 7
