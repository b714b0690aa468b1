"""A short `benchmarks/soak.py`: nothing grows while environments are stepped, opened and closed."""

import importlib.util
import sys
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2] / "benchmarks" / "soak.py"


@pytest.fixture(scope="module")
def soak():
    spec = importlib.util.spec_from_file_location("soak", SOURCE)
    module = importlib.util.module_from_spec(spec)
    sys.modules["soak"] = module  # its dataclasses look themselves up there
    spec.loader.exec_module(module)
    yield module
    del sys.modules["soak"]


def judged(soak, load, n):
    verdict = soak.judge("short", soak.soak(load, n))
    assert verdict.n_done >= n
    return verdict


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_environments_hold_no_more_memory_threads_or_files_the_longer_they_run(soak):
    opened = judged(soak, soak.opening(10), 10)
    mental = judged(soak, soak.stepping(soak.MENTAL, 64, 64 * 150), 64 * 150)
    physical = judged(soak, soak.stepping(soak.BOXING, 24, 24 * 10), 24 * 10)

    assert [one.flat for one in (opened, mental, physical)] == [True] * 3, (opened, mental, physical)


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_a_leak_is_seen(soak):
    kept = []

    def leaking():
        for done in range(1, 51):
            kept.append(bytearray(1_000_000))
            yield done

    verdict = judged(soak, leaking(), 50)
    assert not verdict.flat
    assert verdict.held_grown_mb > 30
