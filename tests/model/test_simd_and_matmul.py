"""The arithmetic of the compiled engines against NumPy."""

import os
import platform
import subprocess
import sys

import numpy as np
import pytest

from creative_nao.model.matmul import PANEL, multiply_panel
from creative_nao.model.simd import compiled, exp32, load8, load16, log32, store, tanh32


@compiled()
def by_vectors(numbers, exp, tanh, log):
    for i in range(0, numbers.size, 16):
        x = load16(numbers, i)
        store(tanh32(x), tanh, i)
        store(exp32(x * -1.0), exp, i)
    for i in range(0, numbers.size, 8):
        store(log32(load8(numbers, i)), log, i)


def test_exp_and_tanh_are_those_of_the_library():
    below_zero = np.linspace(-80, 0, 4001, dtype=np.float32)
    around = np.linspace(-12, 12, 4001, dtype=np.float32)

    exp = np.array([exp32(x) for x in below_zero])
    tanh = np.array([tanh32(x) for x in around])

    np.testing.assert_allclose(exp, np.exp(below_zero.astype(np.float64)), rtol=3e-7)
    np.testing.assert_allclose(tanh, np.tanh(around.astype(np.float64)), atol=4e-7)


def test_the_logarithm_is_that_of_the_library():
    x = np.concatenate([np.geomspace(1e-30, 1e30, 4001), np.linspace(0.9, 1.1, 501)]).astype(np.float32)

    log = np.array([log32(v) for v in x])

    np.testing.assert_allclose(log, np.log(x.astype(np.float64)), rtol=2e-7, atol=1e-7)


def test_vectors_compute_what_single_numbers_do():
    numbers = np.linspace(0.01, 20, 160, dtype=np.float32)
    exp, tanh, log = (np.zeros_like(numbers) for _ in range(3))

    by_vectors(numbers, exp, tanh, log)

    np.testing.assert_allclose(exp, [exp32(-x) for x in numbers], rtol=3e-7)
    np.testing.assert_allclose(tanh, [tanh32(x) for x in numbers], rtol=3e-7)
    np.testing.assert_allclose(log, [log32(x) for x in numbers], rtol=3e-7, atol=1e-7)


def test_what_is_no_number_stays_so():
    """A clamp that turned it into a bound would hide that training has diverged."""
    assert np.isnan(tanh32(np.float32(np.nan)))
    assert np.isnan(exp32(np.float32(np.nan)))


@pytest.mark.parametrize("n_inner", [0, 1, 140])
@pytest.mark.parametrize("n_rows", [1, 2, 3, 4, 5, 6, 7, 8, 9, 13, 40])
def test_the_product_is_a_matrix_product(n_rows, n_inner):
    rng = np.random.default_rng(0)
    a, b, start = (
        rng.normal(size=s).astype(np.float32) for s in ((n_rows, n_inner), (n_inner, PANEL), (n_rows, PANEL))
    )
    out = np.full((n_rows, PANEL), np.nan, np.float32)

    multiply_panel(
        a.ravel(),
        0,
        n_inner,
        1,
        b.ravel(),
        0,
        PANEL,
        n_inner,
        start.ravel(),
        0,
        PANEL,
        out.reshape(-1),
        0,
        PANEL,
        n_rows,
    )

    np.testing.assert_allclose(out, start + a.astype(np.float64) @ b, rtol=1e-4, atol=1e-5)


def test_a_row_of_the_product_does_not_depend_on_its_neighbours():
    """The same order of summation in every tile: bits do not depend on how rows are cut into tiles."""
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(13, 90)).astype(np.float32), rng.normal(size=(90, PANEL)).astype(np.float32)
    together, alone, none = (
        np.zeros((13, PANEL), np.float32),
        np.zeros((13, PANEL), np.float32),
        np.zeros(PANEL, np.float32),
    )

    multiply_panel(a.ravel(), 0, 90, 1, b.ravel(), 0, PANEL, 90, none, 0, 0, together.reshape(-1), 0, PANEL, 13)
    for n in range(13):
        multiply_panel(
            a.ravel(), n * 90, 90, 1, b.ravel(), 0, PANEL, 90, none, 0, 0, alone.reshape(-1), n * PANEL, 0, 1
        )

    assert np.array_equal(together, alone)
    assert together.any()


def test_a_transposed_factor_needs_no_copy():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(90, 13)).astype(np.float32), rng.normal(size=(90, PANEL)).astype(np.float32)
    out, none = np.zeros((13, PANEL), np.float32), np.zeros(PANEL, np.float32)

    multiply_panel(a.ravel(), 0, 1, 13, b.ravel(), 0, PANEL, 90, none, 0, 0, out.reshape(-1), 0, PANEL, 13)

    np.testing.assert_allclose(out, a.T.astype(np.float64) @ b, rtol=1e-4, atol=1e-5)


SOMEWHERE_ELSE = """
import numpy as np
from creative_nao.model.simd import tanh32
from creative_nao.model.matmul import PANEL, multiply_panel

a, b, out = np.ones((7, 3), np.float32), np.ones((3, PANEL), np.float32), np.zeros(7 * PANEL, np.float32)
multiply_panel(a.ravel(), 0, 3, 1, b.ravel(), 0, PANEL, 3, out, 0, PANEL, out, 0, PANEL, 7)
assert (out == 3).all() and abs(tanh32(np.float32(1)) - np.tanh(1)) < 1e-6
print(PANEL)
"""


def run_in(environment):
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", SOMEWHERE_ELSE],
        env={**os.environ, **environment}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return int(done.stdout)


def test_without_a_writable_place_the_code_is_compiled_anew():
    """/dev/null is no folder, not even for root; the package's own folder is left out of the search."""
    nowhere = dict.fromkeys(["HOME", "XDG_CACHE_HOME", "LOCALAPPDATA", "NUMBA_CACHE_DIR"], os.devnull)

    assert run_in({**nowhere, "NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator,UserWideCacheLocator"}) == PANEL


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="names x86 processors")
@pytest.mark.parametrize("processor", ["generic", pytest.param("x86-64-v3", marks=pytest.mark.slow)])
def test_it_runs_on_processors_without_wide_registers(processor, tmp_path):
    """Vectors that are wider than the registers are split by the compiler."""
    assert run_in({"NUMBA_CPU_NAME": processor, "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": str(tmp_path)}) == 16
