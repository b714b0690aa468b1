import base64
import contextlib
import dataclasses
import json
import lzma

import numpy as np
import pytest

from creative_nao import arrays, load_memory
from creative_nao.errors import FileFormatError, NotFoundError
from creative_nao.measures import dtw
from creative_nao.model import (
    CONDITIONS,
    Memory,
    NetworkSettings,
    Trained,
    TrainingSettings,
    shipped_memories,
    train_network,
    walk,
)
from creative_nao.model.memory import content_sha256, shipped_file


def test_a_saved_memory_comes_back_bit_for_bit(tiny_memory, tmp_path):
    back = load_memory(tiny_memory.save(tmp_path / "m.safetensors"))
    pb = np.random.default_rng(0).uniform(-1, 1, (5, 2))

    assert np.array_equal(back.generate(pb), tiny_memory.generate(pb))
    assert back.demonstrations.names == tiny_memory.demonstrations.names
    assert (back.network, back.training, back.record) == (tiny_memory.network, tiny_memory.training, tiny_memory.record)
    assert np.array_equal(back.loss_history, tiny_memory.loss_history)


def test_a_torn_memory_names_the_part_wherever_it_is_cut(tiny_memory, tmp_path):
    content = tiny_memory.save(tmp_path / "m.safetensors").read_bytes()
    path = tmp_path / "torn.safetensors"
    for length in [*range(0, 64), *range(64, len(content), 997), len(content) - 1]:
        path.write_bytes(content[:length])
        with pytest.raises(FileFormatError, match=r"torn\.safetensors: .*(header|array)"):
            Memory.read(path)


def test_a_flipped_bit_in_the_header_is_never_another_error(tiny_memory, tmp_path):
    content = bytearray(tiny_memory.save(tmp_path / "m.safetensors").read_bytes())
    header_bytes = 8 + int.from_bytes(content[:8], "little")
    path = tmp_path / "flipped.safetensors"
    rng = np.random.default_rng(0)
    for place in rng.integers(0, header_bytes, 300):
        flipped = bytearray(content)
        flipped[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(flipped)
        with contextlib.suppress(FileFormatError):  # any other error fails the test
            Memory.read(path)


def test_a_packed_memory_is_the_same_memory(tmp_path):
    memory = load_memory("half-4pb/0")
    packed, plain = memory.save(tmp_path / "m.safetensors.xz"), memory.save(tmp_path / "m.safetensors")

    assert packed.stat().st_size < 0.65 * plain.stat().st_size
    assert load_memory(packed).save(tmp_path / "again.safetensors").read_bytes() == plain.read_bytes()
    assert content_sha256(packed) == content_sha256(plain) == content_sha256(shipped_file("half-4pb/0"))


def test_a_packed_memory_keeps_actions_of_its_own(tiny_memory, tmp_path):
    packed = tiny_memory.save(tmp_path / "m.safetensors.xz")

    back = load_memory(packed)
    assert back.demonstrations.names == tiny_memory.demonstrations.names
    for mine, its in zip(back.demonstrations.trajectories, tiny_memory.demonstrations.trajectories, strict=True):
        assert np.array_equal(mine, its)


def test_an_array_that_is_left_out_and_not_shipped_is_missing(tmp_path, monkeypatch):
    monkeypatch.setattr("creative_nao.model.memory._basic_actions", dict)

    with pytest.raises(FileFormatError, match="the array `demonstration/0` is missing"):
        Memory.read(shipped_file("half/0"))


def test_a_packed_file_that_is_torn_or_too_large_is_refused(tiny_memory, tmp_path, monkeypatch):
    content, path = tiny_memory.save(tmp_path / "m.safetensors.xz").read_bytes(), tmp_path / "bad.safetensors.xz"
    for broken, fault in (
        (content[:-1], "torn, or followed by something else"),
        (content + b"more", "torn, or followed by something else"),
        (content[:40] + bytes(40) + content[80:], "its XZ compression is damaged"),
        (lzma.compress(b"{}"), "the header length needs 8 bytes"),
    ):
        path.write_bytes(broken)
        with pytest.raises(FileFormatError, match=rf"bad\.safetensors\.xz: no memory file: .*{fault}"):
            Memory.read(path)
    monkeypatch.setattr(arrays, "MAX_FILE_BYTES", 100_000)
    path.write_bytes(lzma.compress(bytes(1_000_000)))
    with pytest.raises(FileFormatError, match="it unpacks to more than 100000 bytes"):
        Memory.read(path)


def test_a_foreign_file_is_refused(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("not a memory, only some words " * 5)

    with pytest.raises(FileFormatError, match=r"no memory file: its first 8 bytes announce a header of \d+ bytes"):
        load_memory(path)


def test_not_a_number_in_the_weights_is_named(tiny_memory, tmp_path):
    tiny_memory.parameters["w_in"].flat[0], kept = np.nan, tiny_memory.parameters["w_in"].flat[0]
    try:
        path = tiny_memory.save(tmp_path / "m.safetensors")
    finally:
        tiny_memory.parameters["w_in"].flat[0] = kept

    with pytest.raises(FileFormatError, match="`parameter/w_in` should hold finite numbers"):
        load_memory(path)


def test_an_unknown_name_offers_the_nearest():
    with pytest.raises(NotFoundError, match=r"no memory `hlf/0` \(did you mean `half/0`\?\)"):
        load_memory("hlf/0")


def test_one_memory_of_each_condition_ships():
    assert {f"{condition}/0" for condition in CONDITIONS} <= set(shipped_memories())


def test_the_banks_of_more_units_have_names_of_their_own():
    for n_pb in (4, 8):
        names = shipped_memories(n_pb)
        assert len(names) == 16
        assert {name.split("/")[0] for name in names} == {f"half-{n_pb}pb", f"closed-{n_pb}pb"}
        assert load_memory(names[-1]).network.n_pb == n_pb
    assert shipped_memories(3) == ()
    assert set(shipped_memories(None)) == {name for n_pb in (2, 4, 8) for name in shipped_memories(n_pb)}


@pytest.mark.parametrize("name", [f"{condition}/0" for condition in CONDITIONS])
def test_a_shipped_memory_says_how_it_was_made(name):
    memory = load_memory(name)

    assert memory.closed_loop_ratio == CONDITIONS[name.split("/")[0]]
    assert memory.training.n_epochs >= 20_000
    assert memory.record["command"].startswith("creative-nao train ")
    assert {"torch", "numba", "numpy"} <= set(memory.record["versions"])
    json.dumps(memory.record)


def test_half_0_gives_every_basic_action_back_in_closed_loop():
    memory = load_memory("half/0")
    generated = memory.generate(memory.pb)

    assert max(dtw(a, b) for a, b in zip(generated, memory.demonstrations.trajectories, strict=True)) < 10.0


def test_shipped_memories_learned_the_shipped_demonstrations(demonstrations):
    for name in shipped_memories(None):
        mine = load_memory(name).demonstrations
        assert mine.names == demonstrations.names
        assert all(np.array_equal(a, b) for a, b in zip(mine.trajectories, demonstrations.trajectories, strict=True))


def test_what_a_notebook_shows_is_short(tiny_memory):
    recognition = tiny_memory.infer_pb(tiny_memory.generate(np.zeros((1, 2)))[0])
    steps = walk(tiny_memory, [[0, 0], [1, 1]], 3)
    trained = Trained(tiny_memory.training, tiny_memory, None)

    for shown in (tiny_memory, recognition, recognition.restarts, steps, trained):
        assert repr(shown).count("\n") < 5
        assert len(repr(shown)) < 700
    assert "6 actions of 8 joints" in repr(tiny_memory)


@pytest.mark.parametrize("n_pb", [1, 2, 3])
def test_a_notebook_shows_a_memorys_map(waves, n_pb):
    settings = NetworkSettings(layer_sizes=(8, 4), time_constants=(2, 5), n_softmax_units=5, n_pb=n_pb)
    memory = dataclasses.replace(train_network(waves, TrainingSettings(n_epochs=5), settings), name="<b>")
    page = memory._repr_html_()

    assert "&lt;b&gt;" in page
    assert base64.b64decode(page.split("base64,")[1].split('"')[0]).startswith(b"\x89PNG")
    assert all(name in page for name in waves.names)
