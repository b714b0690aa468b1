"""Every kind of file, cut at every byte and with flipped bits: read, or one clear error that names the file."""

import numpy as np
import pytest

from creative_nao.errors import CreativeNaoError

KINDS = (
    "memory", "checkpoint", "bundle", "state", "map", "physical", "csv", "yaml", "toml", "session", "record", "results",
)  # fmt: skip
N_CUTS = 1_000
"""A file of up to so many bytes is cut at every byte; a larger one at the first 400 and last 100, and 100 between."""
N_FLIPS = {"bundle": 150, "yaml": 150}


def refused(victim, path):
    """Return whether the file is refused; an error has to be ours, short, and name the file."""
    text = None
    try:
        victim.load(path)
    except CreativeNaoError as error:
        text = str(error)
    if text is not None:
        assert path.name in text or str(path.with_name("run.json")) in text
        assert len(text) < 1_000
    return text is not None


def cuts(size):
    if size <= N_CUTS:
        return range(size)
    return [*range(400), *np.linspace(400, size - 100, 100).astype(int), *range(size - 100, size)]


def test_every_kind_is_tried_and_good_as_it_is(victims):
    assert set(victims) == set(KINDS)
    for victim in victims.values():
        assert victim.load(victim.path) is not None


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_cut_at_any_byte_is_refused(kind, victims, tmp_path):
    victim = victims[kind]
    whole, path = victim.path.read_bytes(), tmp_path / f"cut-{victim.path.name}"
    for size in cuts(len(whole)):
        path.write_bytes(whole[:size])
        must = size < len(whole) - 1 and victim.torn  # a last line may end without its mark
        assert refused(victim, path) or not must, f"cut at byte {size}"


@pytest.mark.parametrize("kind", KINDS)
def test_a_flipped_bit_is_read_or_refused(kind, victims, tmp_path):
    victim = victims[kind]
    whole, path = victim.path.read_bytes(), tmp_path / f"flipped-{victim.path.name}"
    rng = np.random.default_rng([7, KINDS.index(kind)])
    n = N_FLIPS.get(kind, 300)
    places = np.concatenate([rng.integers(0, min(len(whole), 1_500), n // 2), rng.integers(0, len(whole), n // 2)])
    for place, bit in zip(places, rng.integers(0, 8, n), strict=True):
        broken = bytearray(whole)
        broken[place] ^= 1 << int(bit)
        path.write_bytes(broken)
        refused(victim, path)
