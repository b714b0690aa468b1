"""The parts of the explorer that need no browser."""

import json
import re

import numpy as np
import pytest

from creative_nao import maps
from creative_nao.cli.explore import choices
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError, ShapeError
from creative_nao.exchange import WRITABLE
from creative_nao.explorer import MemoryService, cached_map
from creative_nao.explorer.markup import curves_svg, marks_svg
from creative_nao.explorer.memory_service import as_coordinate, describe, less_like, more_like, surprise
from creative_nao.explorer.recordings import export, read_upload
from creative_nao.explorer.registry import cache_path, content_hash
from creative_nao.explorer.state import Favourite, Session
from creative_nao.explorer.view import View
from creative_nao.model import load_memory


@pytest.fixture(scope="module")
def service():
    return MemoryService(load_memory("half/0"))


@pytest.fixture(scope="module")
def pb_map(service):
    return maps.pb_map(service.memory, 20)


def test_a_recall_is_what_the_memory_generates(service):
    point = np.array([[0.2, -0.3]])
    recall = service.recall(point)
    np.testing.assert_array_equal(recall.trajectory, service.memory.generate(point)[0])
    assert len(service.recall(np.array([[0.0, 0.0], [0.5, 0.5]])).points) == 2
    with pytest.raises(ShapeError, match=r"lie in \[-1, 1\]"):
        service.recall(np.array([[np.nan, 0.0]]))


def test_words_tell_why_a_movement_is_inappropriate(service, pb_map):
    fast = pb_map.pb[pb_map.outcome == "fluctuating"][:1]
    text = describe(service.recall(fast), service)
    assert "inappropriate, too fast for the motors" in text
    speed, limit = map(float, re.search(r"reaches ([\d.]+) rad/s at [\d.]+ s, the limit is ([\d.]+)", text).groups())
    assert speed >= limit
    assert "appropriate, like a basic action; nearest C left hook" in describe(
        service.recall(service.memory.pb[2:3]), service
    )


def test_overspeed_is_marked_in_the_curves(service, pb_map):
    assert "cn-overspeed" in curves_svg(service.recall(pb_map.pb[pb_map.outcome == "fluctuating"][:1]), service)
    calm = curves_svg(service.recall(service.memory.pb[:1]), service)
    assert "cn-overspeed" not in calm
    assert calm.count("<svg") == 8


def test_the_cached_map_is_the_computed_one_and_a_torn_file_is_computed_again(service, monkeypatch, tmp_path):
    monkeypatch.setenv("CREATIVE_NAO_CACHE", str(tmp_path))
    first = cached_map(service.memory, 12)
    path = cache_path(service.memory, 12)
    assert path.is_file()
    np.testing.assert_array_equal(cached_map(service.memory, 12).distance, first.distance)
    path.write_bytes(b"torn")
    np.testing.assert_array_equal(cached_map(service.memory, 12).distance, first.distance)
    assert content_hash(service.memory) != content_hash(load_memory("half/1"))


def test_the_marks_have_a_letter_for_each_action_and_a_line_for_a_path(pb_map):
    whole = View.of(pb_map)
    points = np.array([[0.0, 0.0], [0.5, 0.5]])
    svg = marks_svg(whole, pb_map.learned_pb, points, agent_points=np.zeros((3, 2)))
    assert [f">{letter}</text>" in svg for letter in "ABCDEF"] == [True] * 6
    assert svg.count("<polyline") == 2
    assert svg.count('r="4"') == 3
    near = View(*(pb_map.learned_pb[2] - 0.01), 0.02)
    svg = marks_svg(near, pb_map.learned_pb, points, agent_points=np.zeros((3, 2)))
    assert svg.count("</text>") == 1
    assert '<text x="300.0" y="300.0"' in svg
    assert 'r="4"' not in svg


def test_a_surprise_is_new_and_appropriate(pb_map):
    rng = np.random.default_rng(0)
    for find in (
        lambda: surprise(pb_map, rng),
        lambda: more_like(pb_map, np.array([[0.3, 0.3]]), rng),
        lambda: less_like(pb_map, np.array([[0.3, 0.3]]), rng),
    ):
        cell = int(np.flatnonzero((pb_map.pb == find()).all(axis=1))[0])
        assert pb_map.outcome[cell] in ("learned", "unlearned")
    near = np.linalg.norm(more_like(pb_map, np.array([[0.3, 0.3]]), rng) - 0.3)
    assert near < np.linalg.norm(less_like(pb_map, np.array([[0.3, 0.3]]), rng) - 0.3)
    again = [surprise(pb_map, np.random.default_rng(5)).tolist() for _ in range(2)]
    assert again[0] == again[1]


@pytest.mark.parametrize("format_name", [name for name in WRITABLE if name != "bvh"])
def test_every_format_goes_out_and_comes_back(service, format_name):
    recall = service.recall(service.memory.pb[:1])
    name, content, _ = export(recall, service, format_name)
    back = read_upload(name, content, service.memory.dt_s)
    start = len(back.motion.angles) - len(
        recall.trajectory
    )  # formats for robots begin with the way to the first posture
    assert start >= 0


def test_an_upload_too_large_or_foreign_is_refused():
    with pytest.raises(FileFormatError, match="may have 2000000 bytes"):
        read_upload("a.csv", b"x" * 2_000_001, 0.15)
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
    assert Session(path).favourites("m") == []
    path.write_text(json.dumps({"format_version": 1, "favourites": [{"memory": "m", "points": [[9, 9]], "note": ""}]}))
    with pytest.raises(FileFormatError, match="not a session of the explorer"):
        Session(path)
    with pytest.raises(SettingsError, match="at most 300"):
        Favourite("m", ((0.0, 0.0),), "x" * 301)


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "", None, "x", [], "1e999"])
def test_what_is_no_number_is_the_middle(value):
    assert as_coordinate(value) == 0.0
    assert as_coordinate("7") == 1.0


def test_choices_of_a_run_folder(tmp_path):
    with pytest.raises(NotFoundError, match="--run takes a folder"):
        choices(tmp_path)
    (tmp_path / "episodes.csv").write_text("step,pb_1,pb_2\n1,0.5,-0.5\n2,nan,0\n")
    assert choices(tmp_path).tolist() == [[0.5, -0.5]]
    (tmp_path / "episodes.csv").write_text("step\n1\n")
    with pytest.raises(FileFormatError, match="pb_1 and pb_2"):
        choices(tmp_path)
