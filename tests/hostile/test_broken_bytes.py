"""Every kind of file, cut and with flipped bits: read, or one clear error that names the file.

The everyday run cuts and flips at some places, the nightly one cuts at every byte and flips more bits.
"""

import time

import numpy as np
import pytest
from victims import KINDS

from creative_nao.errors import CreativeNaoError

N_CUTS = 200
"""A file of up to so many bytes is cut at every byte; a larger one at the first 100 and last 20, and 80 between."""
N_FLIPS, N_FLIPS_NIGHTLY = 60, 300
MAX_BYTES = 4_000
"""So small is every good file, so that the nightly run can cut it at every byte."""
NIGHTLY = pytest.mark.parametrize("every", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["some", "every"])


def refused(victim, path):
    """Return whether the file is refused; an error has to be ours, short, and name the file."""
    text, start = None, time.process_time()
    try:
        loaded = victim.load(path)
        if loaded is None and victim.lenient:
            return True
        victim.use(loaded)
    except CreativeNaoError as error:
        text = str(error)
    assert time.process_time() - start < 5.0, "seconds"
    if text is not None:
        assert path.name in text or str(path.with_name(victim.path.name)) in text
        assert len(text) < 1_000
        assert text.isprintable()
    return text is not None


def cuts(size):
    if size <= N_CUTS:
        return range(size)
    return [*range(100), *np.linspace(100, size - 20, 80).astype(int), *range(size - 20, size)]


def test_every_kind_is_tried_and_good_as_it_is(victims):
    assert set(victims) == set(KINDS)
    for victim in victims.values():
        assert victim.load(victim.path) is not None


@pytest.mark.parametrize("kind", KINDS)
@NIGHTLY
def test_a_file_cut_at_any_byte_is_refused(kind, every, victims, tmp_path):
    victim = victims[kind]
    whole, path = victim.path.read_bytes(), tmp_path / f"cut-{victim.path.name}"
    assert len(whole) <= MAX_BYTES
    for size in range(len(whole)) if every else cuts(len(whole)):
        path.write_bytes(whole[:size])
        must = size < len(whole) - 1 and victim.torn  # a last line may end without its mark
        assert refused(victim, path) or not must, f"cut at byte {size}"


@pytest.mark.parametrize("kind", KINDS)
@NIGHTLY
def test_a_flipped_bit_is_read_or_refused(kind, every, victims, tmp_path):
    victim = victims[kind]
    whole, path = victim.path.read_bytes(), tmp_path / f"flipped-{victim.path.name}"
    rng = np.random.default_rng([7, KINDS.index(kind)])
    n = N_FLIPS_NIGHTLY if every else N_FLIPS
    places = np.concatenate([rng.integers(0, min(len(whole), 1_500), n // 2), rng.integers(0, len(whole), n // 2)])
    for place, bit in zip(places, rng.integers(0, 8, n), strict=True):
        broken = bytearray(whole)
        broken[place] ^= 1 << int(bit)
        path.write_bytes(broken)
        refused(victim, path)
