"""What the colours of the page's map tell: every measure, what the body makes of it, and the legend beside."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from creative_nao import maps
from creative_nao.cli import main
from creative_nao.envs.physical_map import PhysicalMap, fingerprint
from creative_nao.errors import NotFoundError, SettingsError
from creative_nao.explorer import colours
from creative_nao.explorer.colours import PATTERNS, map_picture, sample
from creative_nao.explorer.markup import legend_html
from creative_nao.explorer.registry import (
    Computation,
    LoadedMemory,
    finer_map,
    load_physical,
    measured,
)
from creative_nao.explorer.view import SIZE, View
from creative_nao.maps.figure_style import UNUSABLE
from creative_nao.model import load_memory

RESULTS = Path(__file__).parents[2] / "docs" / "results" / "physical"


@pytest.fixture(scope="module")
def memory():
    return load_memory("half/0")


@pytest.fixture(scope="module")
def full(memory):
    return maps.pb_map(memory, 24)


@pytest.fixture(scope="module")
def pb_map(full, tmp_path_factory):
    """Return the map as the page has it: read from a file, without movements."""
    return type(full).load(full.save(tmp_path_factory.mktemp("map") / "map.npz"))


@pytest.fixture(scope="module")
def physical():
    return PhysicalMap.load(RESULTS / "half_0.npz")


@pytest.mark.parametrize("colour", maps.COLOURINGS)
def test_a_number_worked_out_on_demand_is_that_of_the_command(memory, full, pb_map, colour):
    work = Computation()
    found = measured(memory, pb_map, colour, pb_map, work)
    np.testing.assert_array_equal(found, maps.colour_values(full, colour)[0])
    assert colour == "unexpectedness" or work.share == 1.0


def test_work_called_off_gives_nothing_and_is_done_again(memory, pb_map):
    work = Computation()
    work.cancelled = True
    loaded = LoadedMemory(memory, resolution=8)
    assert loaded.numbers(pb_map, "speed", work) is None
    assert loaded.known(pb_map, "speed") is None
    found = loaded.numbers(pb_map, "speed", Computation())
    assert loaded.known(pb_map, "speed") is found
    assert finer_map(memory, pb_map, View(0, 0, 0.5), 10, "nearest", work) is None


@pytest.mark.parametrize("colour", colours.NAMES)
def test_every_colouring_draws_the_whole_map_and_has_a_legend(memory, pb_map, physical, colour):
    drawn = physical if colours.is_physical(colour) else pb_map
    values = span = None
    if colours.is_number(colour):
        of_body = colours.is_physical(colour)
        values = (
            colours.physical_figure(physical, colour)
            if of_body
            else measured(memory, pb_map, colour, pb_map, Computation())
        )
        span = colours.shared_span([(drawn, values)])
    picture = np.asarray(map_picture(drawn, colour, None, values, span))
    assert picture.shape == (SIZE, SIZE, 3)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 3
    legend = legend_html(drawn, colour, span)
    assert "A left jab" in legend
    assert f"too fast for the motors {drawn.share_pct('fluctuating'):.1f} %" in legend
    if span is not None:
        label = colours.scale_label(colour)
        assert f"<span>{span[0]:.3g}</span>" in legend
        assert f"<span>{label}</span>" in legend
        assert re.search(r"\[\w.*\]|\d", label) or "share" in label or "hits" in label


def test_an_unknown_colouring_names_the_nearest(pb_map):
    with pytest.raises(NotFoundError, match="did you mean `novelty`"):
        map_picture(pb_map, "noveltie")


def test_two_maps_share_one_scale(memory, pb_map):
    other = maps.pb_map(load_memory("closed/0"), 24)
    low, high = colours.shared_span([(pb_map, pb_map.distance), (other, other.distance)])
    usable = np.concatenate([one.distance[one.appropriate] for one in (pb_map, other)])
    assert (low, high) == (usable.min(), usable.max())


def test_every_unusable_outcome_has_a_pattern_of_its_own():
    assert set(PATTERNS) == set(UNUSABLE)
    drawn = {name: sample(name, 16, 16) != sample(name, 16, 16).min(axis=(0, 1)) for name in PATTERNS}
    assert len({mask.tobytes() for mask in drawn.values()}) == len(PATTERNS)


def test_names_from_a_file_cannot_write_html(pb_map):
    from dataclasses import replace

    evil = replace(pb_map, names=("<script>x</script>", *pb_map.names[1:]))
    assert "<script>" not in legend_html(evil, "nearest")
    assert "<script>" not in legend_html(evil, "outcome")


@pytest.mark.parametrize("colour", ["nearest", "speed", "unexpectedness"])
def test_finer_cells_are_what_the_memory_makes_there(memory, pb_map, colour):
    view = View(0.1, -0.3, 0.2)
    finer = finer_map(memory, pb_map, view, 6, colour, Computation())
    np.testing.assert_array_equal(finer.pb_map.pb, view.grid(6))
    assert finer.pb_map.trajectories is None
    from creative_nao.measures import largest_speeds, score, unexpectedness

    made = memory.generate(view.grid(6))
    scores = score(made, memory.demonstrations)
    assert finer.pb_map.outcome.tolist() == scores.outcome.tolist()
    np.testing.assert_array_equal(finer.pb_map.distance, scores.novelty)
    expected = {
        "nearest": None,
        "speed": largest_speeds(made, memory.dt_s).max(axis=1),
        "unexpectedness": unexpectedness(scores.novelty, pb_map.distance[pb_map.appropriate]),
    }[colour]
    assert (colour in finer.values) == (expected is not None)
    if expected is not None:
        np.testing.assert_array_equal(finer.values[colour], expected)


def test_a_physical_map_belongs_to_its_memory(memory, physical, tmp_path):
    own, foreign = RESULTS / "half_0.npz", RESULTS / "open_0.npz"
    loaded = load_physical([foreign, own], [memory, load_memory("open/0")])
    assert len(loaded) == 2
    np.testing.assert_array_equal(loaded[fingerprint(memory)].outcome, physical.outcome)
    with pytest.raises(SettingsError, match=r"physical map of the memory open/0.*than half/0; make one with `creative"):
        load_physical([foreign], [memory])


def test_a_foreign_physical_map_is_one_line_and_exit_code_2(tmp_path, capsys):
    copied = shutil.copy(RESULTS / "closed_0.npz", tmp_path / "mine.npz")
    assert main(["explore", "half/0", "--no-open", "--physical", str(copied)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "mine.npz is a physical map of the memory closed/0" in said
    (tmp_path / "torn.npz").write_bytes(b"torn")
    assert main(["explore", "half/0", "--no-open", "--physical", str(tmp_path / "torn.npz")]) == 2
    assert "torn.npz" in capsys.readouterr().err
