"""The parts of the explorer that need no browser."""

import dataclasses
import json
import zlib
from base64 import b64decode

import gymnasium as gym
import numpy as np
import pytest

from creative_nao import maps
from creative_nao.agents import make_agent
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError, ShapeError
from creative_nao.evaluation.protocol import play, write_episodes
from creative_nao.exchange import WRITABLE
from creative_nao.explorer import cached_map
from creative_nao.explorer.favourites import Favourite, Session
from creative_nao.explorer.live_agents import agents_for, dots, tries
from creative_nao.explorer.recordings import _read, export, read_upload
from creative_nao.explorer.registry import (
    COLOURS,
    Computation,
    LoadedMemory,
    MemoryRegistry,
    View,
    cache_path,
    cells_json,
    content_hash,
    finer_cells,
    movement,
)
from creative_nao.explorer.robot_service import RobotService
from creative_nao.explorer.run_episodes import RunEpisodes
from creative_nao.measures import score
from creative_nao.measures.outcome import ALL_OUTCOMES
from creative_nao.model import load_memory


@pytest.fixture(scope="module")
def memory():
    return load_memory("half/0")


@pytest.fixture(scope="module")
def pb_map(memory):
    return maps.pb_map(memory, 20)


def plane(text):
    return np.frombuffer(zlib.decompress(b64decode(text)), np.uint8)


def test_a_movement_is_what_the_memory_generates(memory):
    point = np.array([[0.2, -0.3]])
    np.testing.assert_array_equal(movement(memory, point), memory.generate(point)[0])
    path = np.array([[0.0, 0.0], [0.5, 0.5]])
    np.testing.assert_array_equal(movement(memory, path), memory.generate_path(path))
    for wrong in ([[np.nan, 0.0]], [[2.0, 0.0]], [], [[0.0] * 3], [[0.0, 0.0]] * 201):
        with pytest.raises(ShapeError, match=r"lie in \[-1, 1\]"):
            movement(memory, np.array(wrong))


def test_the_page_gets_the_cells_of_the_map(pb_map):
    told = cells_json(pb_map, {"novelty": pb_map.distance})
    codes = [ALL_OUTCOMES.index(outcome) for outcome in pb_map.outcome]
    assert plane(told["outcome"]).tolist() == codes
    np.testing.assert_array_equal(plane(told["nearest"]), pb_map.nearest)
    number = told["values"]["novelty"]
    back = number["low"] + plane(number["plane"]) / 255 * (number["high"] - number["low"])
    usable = pb_map.appropriate
    np.testing.assert_allclose(back[usable], pb_map.distance[usable], atol=(number["high"] - number["low"]) / 500)


def test_finer_cells_are_those_that_a_person_would_select(memory, pb_map):
    view = View(0.1, -0.2, 0.25)
    told = finer_cells(memory, pb_map, view, 5, "speed", Computation())
    scores = score(memory.generate(view.grid(5)), memory.demonstrations)
    assert [ALL_OUTCOMES[code] for code in plane(told["outcome"])] == scores.outcome.tolist()
    assert set(told["values"]) == {"speed"}
    cancelled = Computation()
    cancelled.cancelled = True
    assert finer_cells(memory, pb_map, view, 5, "nearest", cancelled) is None
    for wrong in ((0.5, 0, 0.6), (0, 0, 0.001), (float("nan"), 0, 0.5), (-1.5, 0, 0.5)):
        with pytest.raises(SettingsError, match="a window should be"):
            View(*wrong)


def test_every_colouring_has_its_numbers_and_others_are_refused(memory):
    loaded = LoadedMemory(memory, 12)
    for colour in COLOURS:
        if not colour.startswith("physical"):
            assert set(loaded.cells(colour)["values"]) <= {colour}
    with pytest.raises(NotFoundError, match="no physical map of half/0"):
        loaded.cells("physical")
    with pytest.raises(NotFoundError, match="did you mean `speed`"):
        loaded.cells("sped")


def test_an_address_never_names_a_file(memory, tmp_path):
    path = memory.save(tmp_path / "mine.safetensors")
    registry = MemoryRegistry([memory], 12)
    assert registry.get("half/0") is registry.first
    with pytest.raises(NotFoundError, match="no memory"):
        registry.get(str(path))


def test_the_cached_map_is_the_computed_one_and_a_torn_file_is_computed_again(memory, monkeypatch, tmp_path):
    monkeypatch.setenv("CREATIVE_NAO_CACHE", str(tmp_path))
    first = cached_map(memory, 12)
    path = cache_path(memory, 12)
    assert path.is_file()
    np.testing.assert_array_equal(cached_map(memory, 12).distance, first.distance)
    path.write_bytes(b"torn")
    np.testing.assert_array_equal(cached_map(memory, 12).distance, first.distance)
    assert content_hash(memory) != content_hash(load_memory("half/1"))


def test_physics_tells_hits_and_films_are_made(memory):
    robot = RobotService()
    trajectory = memory.demonstrations.trajectories[1]
    clip = robot.perform(trajectory, memory.dt_s)
    assert clip["failure"] is clip["fell"] is None
    assert clip["hits"]
    assert all(0 <= time <= clip["n"] * clip["dt"] and force > 0.5 for time, force in clip["hits"])
    assert "bag/bag" in {track["body"] for track in clip["tracks"]}
    assert robot.film(trajectory[:3], memory.dt_s, "gif", False)[:6] == b"GIF89a"


def test_an_agent_plays_and_others_are_refused(memory):
    offered = agents_for(memory)
    assert offered["pair"] == [offered["guide"], "random"]
    assert "random" in dict(offered["groups"])["By rule or search"]
    assert sum(one["imagined"] for one in tries(memory, "random@2", 3)["tries"]) == 60
    played = tries(memory, "random", 3)["tries"]
    assert played == tries(memory, "random", 3)["tries"]
    assert len(played) == 30
    assert sum(one["reward"] for one in played) > 0
    for name in ("os:system", "run:random", "random@9999", "/etc/passwd"):
        with pytest.raises(NotFoundError, match=f"no agent `{name}`"):
            tries(memory, name, 0)


@pytest.mark.parametrize("format_name", [name for name in WRITABLE if name != "bvh"])
def test_every_format_goes_out_and_comes_back(memory, format_name):
    points = memory.pb[:1].tolist()
    name, content, _ = export(memory, points, movement(memory, memory.pb[:1]), format_name)
    (back,) = _read(name, content, memory.dt_s)
    # Formats for robots begin with the way to the first posture.
    assert len(back["angles"]) >= memory.n_steps
    assert back["format"] == format_name
    with pytest.raises(NotFoundError, match="no format"):
        export(memory, points, movement(memory, memory.pb[:1]), "../../x")


def test_a_table_of_a_spreadsheet_is_read_and_it_is_said(memory):
    rows = ["time_s;" + ";".join(memory.joints)]
    rows += [f"{tick * 0.15:.2f};{';'.join(f'{57.3 * angle:.3f}' for angle in row)}" for tick, row in enumerate(memory.demonstrations.trajectories[0])]  # fmt: skip # noqa: E501
    (recording,) = read_upload("C:\\movements\\mine.csv", "\n".join(rows).replace(".", ",").encode(), memory.dt_s)
    np.testing.assert_allclose(recording.motion.angles, memory.demonstrations.trajectories[0], atol=0.01)
    assert any("semicolons" in note for note in recording.notes)
    assert any("degrees" in note for note in recording.notes)


def test_an_upload_too_large_or_foreign_is_refused():
    with pytest.raises(FileFormatError, match="may have 4000000 bytes"):
        read_upload("a.csv", b"x" * 4_000_001, 0.15)
    with pytest.raises(FileFormatError, match=r"^passwd\.csv"):
        read_upload("/etc/passwd", b"root:x:0:0", 0.15)


def test_favourites_survive_and_a_foreign_file_is_refused(tmp_path):
    path = tmp_path / "deep" / "session.json"
    session = Session(path)
    session.add(Favourite("m", ((0.1, 0.2),), "one"))
    session.add(Favourite("other", ((0.0, 0.0), (1.0, 1.0))))
    again = Session(path)
    assert again.favourites("m") == [Favourite("m", ((0.1, 0.2),), "one")]
    again.remove(Favourite("m", ((0.1, 0.2),), "one"))
    assert session.favourites("m") == []  # what another explorer changes is seen
    path.write_text(json.dumps({"format_version": 1, "favourites": [{"memory": "m", "points": [[9, 9]], "note": ""}]}))
    with pytest.raises(FileFormatError, match="not a session of the explorer"):
        Session(path)


def test_the_episodes_of_a_run_are_played_as_they_were(memory, tmp_path):
    with pytest.raises(NotFoundError, match="--run takes a folder"):
        RunEpisodes(tmp_path)
    env = gym.make("CreativeNao/BoxingMental-v0", memory=memory, n_actions=3)
    played = [
        play(make_agent(name), env, env_id=env_id, memory=memory.name, base_seed=0, seed=seed, n_actions=3)
        for name, env_id, seed in (
            ("random", "CreativeNao/BoxingMental-v0", 0), ("random", "CreativeNao/BoxingMental-v0", 4),
            ("sobol", "CreativeNao/BoxingModulation-v0", 0),
        )
    ]  # fmt: skip
    write_episodes(tmp_path / "episodes.csv", played)
    run = RunEpisodes(tmp_path)
    run.check_name(memory)
    run.check(memory)
    offered = agents_for(memory, run)
    assert offered["groups"][0][1] == ["run:random"]  # of modulation a point tells no movement
    assert offered["pair"][0] == "run:random"
    for seed, episode in ((0, played[0]), (1, played[1]), (2, played[0])):
        told = tries(memory, "run:random", seed, run)["tries"]
        assert [(one["pb"], one["reward"], one["outcome"]) for one in told] == [
            (action.pb, action.reward, action.outcome) for action in episode.actions
        ]
    assert len(dots(memory, run)) == 6
    with pytest.raises(SettingsError, match="played in another memory of this name"):
        run.check(dataclasses.replace(load_memory("half/3"), name=memory.name))
    with pytest.raises(SettingsError, match=f"no episodes in half/3, but in {memory.name}; begin with"):
        run.check_name(load_memory("half/3"))
    text = (tmp_path / "episodes.csv").read_text()
    for old, new, said in (
        ("pb_1", "pb", "should name the columns"), (",2,", ",7,", "step should be 2"), ("random,", "random,,", "cells"),
    ):  # fmt: skip
        (tmp_path / "episodes.csv").write_text(text.replace(old, new, 1))
        with pytest.raises(FileFormatError, match=said):
            RunEpisodes(tmp_path)
