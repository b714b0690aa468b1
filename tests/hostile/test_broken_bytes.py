"""Every kind of file, cut and with flipped bits: read, or one clear error that names the file.

The everyday run cuts and flips at some places, the nightly one cuts at every byte and flips more bits.
"""

import json
import logging
import time

import numpy as np
import pytest
from safetensors.numpy import load, save
from victims import ARCHIVES, KINDS, TENSORS

from creative_nao.arrays import load_tensors, read_npz, save_tensors
from creative_nao.errors import CreativeNaoError, FileFormatError
from creative_nao.explorer.run_episodes import RunEpisodes
from creative_nao.maps import PBMap
from creative_nao.model import Memory
from creative_nao.model.memory import load_memory, shipped_file
from creative_nao.runtime import sha256
from creative_nao.storage import note_unsealed, read_json, write_json

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


SEALED = (*TENSORS, "map", "physical", "unfinished", "session", "record", "results", "published", "job", "job_result",
          "taught")  # fmt: skip
"""Kinds that we write and read again; they carry SHA-256 digests."""
N_SEALED, N_SEALED_NIGHTLY = 480, 10_000


@NIGHTLY
def test_no_flipped_bit_is_loaded_silently(every, victims, tmp_path, attempt):
    n = N_SEALED_NIGHTLY if every else N_SEALED
    attempt("files that we write and read again, of 16 kinds", "one flipped bit", "refused: none is loaded", n)
    assert len(SEALED) == 18
    rng = np.random.default_rng(23)
    silently = []
    for number in range(n):
        kind = SEALED[number % len(SEALED)]
        victim = victims[kind]
        path = tmp_path / kind / f"flipped-{victim.path.name}"
        path.parent.mkdir(exist_ok=True)
        broken = bytearray(victim.path.read_bytes())
        place, bit = int(rng.integers(len(broken))), int(rng.integers(8))
        broken[place] ^= 1 << bit
        path.write_bytes(broken)
        if not refused(victim, path):
            silently.append((kind, place, bit))
    assert silently == []


@pytest.mark.parametrize("every", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["some", "many"])
def test_no_flipped_bit_of_a_shipped_memory_is_loaded(every, tmp_path, attempt):
    n = 1_000 if every else 40
    attempt("a shipped memory", "one flipped bit", "refused: none is loaded", n)
    whole, path = shipped_file("half/0").read_bytes(), tmp_path / "mine.safetensors"
    rng = np.random.default_rng(29)
    for place, bit in zip(rng.integers(len(whole), size=n), rng.integers(8, size=n), strict=True):
        broken = bytearray(whole)
        broken[place] ^= 1 << int(bit)
        path.write_bytes(broken)
        with pytest.raises(FileFormatError, match=r"mine\.safetensors"):
            Memory.read(path)


def test_the_damaged_part_is_named(victims, tmp_path):
    """By the header, the array, or the table of contents; and a checksum is told apart from its lack."""
    content, path = victims["memory"].path.read_bytes(), tmp_path / "memory.safetensors"
    path.write_bytes(content.replace(b"rise", b"rism"))
    with pytest.raises(FileFormatError, match="header: damaged, or changed by hand"):
        Memory.read(path)
    path.write_bytes(content.replace(b'\\"sha256\\"', b'\\"sha25v\\"', 1))
    with pytest.raises(FileFormatError, match="header: damaged: its `sha256` has another name"):
        Memory.read(path)
    weights = load(content)["parameter/w_out"].tobytes()
    assert content.count(weights) == 1
    path.write_bytes(content.replace(weights, bytes(len(weights))))
    with pytest.raises(FileFormatError, match="the array `parameter/w_out` is damaged"):
        Memory.read(path)
    archive = bytearray(victims["map"].path.read_bytes())
    archive[archive.index(b"PK\1\2") + 12] ^= 1  # the time of a member, which nobody reads
    path = tmp_path / "map.npz"
    path.write_bytes(archive)
    with pytest.raises(FileFormatError, match="damaged: its table of contents"):
        PBMap.load(path)


def test_a_file_without_a_checksum_loads_with_one_note(victims, tmp_path, caplog):
    header, arrays = load_tensors(victims["memory"].path, kind="memory")
    (tmp_path / "old.safetensors").write_bytes(save(arrays, {"creative_nao": json.dumps({"kind": "memory", **header})}))
    (tmp_path / "old.json").write_text('{"a": 1}')
    with np.load(victims["map"].path) as found:
        np.savez(tmp_path / "old.npz", **found)
    note_unsealed.cache_clear()
    with caplog.at_level(logging.WARNING, "creative_nao"):
        for _ in range(2):
            Memory.read(tmp_path / "old.safetensors")
            assert read_json(tmp_path / "old.json", "results") == {"a": 1}
            read_npz(tmp_path / "old.npz", "map")
    told = [record.getMessage() for record in caplog.records]
    assert all(name in line for name, line in zip(("old.safetensors", "old.json", "old.npz"), told, strict=True))
    assert all("carries no SHA-256 of its content" in line for line in told)


def test_what_is_made_by_hand_of_a_file_is_read_without_its_checksum(tmp_path):
    path = write_json(tmp_path / "a.json", {"favourites": [1], "format_version": 1})
    assert read_json(path, "session") == {"favourites": [1], "format_version": 1}
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    assert read_json(path, "session") == {"favourites": [1], "format_version": 1}
    edited = json.loads(path.read_text("utf-8-sig")) | {"favourites": [2]}
    path.write_text(json.dumps(edited))
    with pytest.raises(FileFormatError, match=r"a\.json: damaged, or changed by hand: .* take that out"):
        read_json(path, "session")
    edited.pop("sha256")
    path.write_text(json.dumps(edited))
    assert read_json(path, "session")["favourites"] == [2]


def test_a_table_of_episodes_is_held_against_its_hash_in_the_record(victims, tmp_path, caplog):
    table = tmp_path / "episodes.csv"
    table.write_bytes(victims["episodes"].path.read_bytes())
    values = {**read_json(victims["record"].path, "record"), "hashes": {table.name: sha256(table)}}
    write_json(tmp_path / "run.json", values)
    assert len(RunEpisodes(tmp_path).of("half/0")["random"][0]) == 2
    assert caplog.records == []
    table.write_bytes(table.read_bytes().replace(b"0.25", b"0.26"))
    with pytest.raises(FileFormatError, match=r"episodes\.csv: damaged, or changed by hand: .* in run\.json"):
        RunEpisodes(tmp_path)


def test_equal_content_has_equal_bytes_with_its_checksums(tmp_path):
    arrays = {"b": np.arange(3.0), "a": np.array(True), "empty": np.zeros((0, 2), ">f4")}
    one, two = (save_tensors(tmp_path / name, kind="x", header={"n": 1}, tensors=arrays) for name in ("1", "2"))
    assert one.read_bytes() == two.read_bytes()
    assert load_tensors(one, kind="x")[1]["b"].tolist() == [0.0, 1.0, 2.0]


def test_the_checksum_of_a_memory_takes_less_than_a_millisecond(tmp_path):
    path = load_memory("half/0").save(tmp_path / "memory.safetensors")
    times = []
    for _ in range(20):
        start = time.perf_counter()
        load_tensors(path, kind="memory")
        times.append(time.perf_counter() - start)
    assert min(times) < 1e-3  # of the whole reading, of which it is a fifth


def test_the_archives_tried_are_those_of_ours():
    assert set(ARCHIVES) - set(SEALED) == {"motion_npz"}, "which other programs read and write too"


def test_a_seal_that_no_file_can_hold_is_refused(tmp_path):
    path = tmp_path / "sealed.json"
    path.write_text(r'{"sha256": "\ud800", "a": 1}')
    with pytest.raises(FileFormatError, match="damaged, or changed by hand"):
        read_json(path, "a file")
