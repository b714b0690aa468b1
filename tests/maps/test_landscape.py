import dataclasses
import doctest
import json

import numpy as np
import pytest

from creative_nao.errors import SettingsError
from creative_nao.maps import PBMap, grid, landscape, pb_grid, pb_map
from creative_nao.maps.grid import evenness, n_border_edges, region_sizes
from creative_nao.measures import dtw


def hand_made(outcomes, nearest, trajectories=None):
    """A map from rows of letters: l learned, u unlearned, f fluctuating, n non-moving; first row at PB 2 = -1."""
    n = len(outcomes)
    words = {"l": "learned", "u": "unlearned", "f": "fluctuating", "n": "non_moving"}
    return PBMap(
        resolution=n,
        pb=pb_grid(n),
        outcome=np.array([words[letter] for row in outcomes for letter in row]),
        nearest=np.array([int(digit) for row in nearest for digit in row]),
        distance=np.zeros(n * n),
        learned_pb=np.zeros((3, 2)),
        names=("a", "b", "c"),
        record={},
        trajectories=trajectories,
    )


MAP = hand_made(
    ["llul", "luul", "uuff", "luun"],
    ["0011", "0001", "0011", "1100"],
)


def test_regions_are_counted_by_hand():
    """Learned: a in one corner of three cells; b right (two) and at the lower left (one); c nowhere."""
    found = landscape(MAP)

    assert {name: dataclasses.astuple(r) for name, r in found.learned.items()} == {
        "a": (18.75, 1, 18.75),
        "b": (18.75, 2, 12.5),
        "c": (0.0, 0, 0.0),
    }
    # Appropriate cells: a is 00/000/00 in one piece and the single 0 of the last row; b 11/1 above and 11 below.
    assert {name: dataclasses.astuple(r) for name, r in found.nearest.items()} == {
        "a": (50.0, 2, 43.75),
        "b": (31.25, 2, 18.75),
        "c": (0.0, 0, 0.0),
    }
    assert (found.n_learned_regions, found.n_nearest_regions) == (3, 4)
    assert found.outcome_pct == {"learned": 37.5, "unlearned": 43.75, "fluctuating": 12.5, "non_moving": 6.25}


def test_borders_are_counted_by_hand():
    found = landscape(MAP)
    side = 2 / 3  # of a cell

    # Colours, row by row: aabb, aaab, aaff, bban. Between columns 1 + 1 + 1 + 2, between rows 1 + 2 + 4.
    assert found.border_length == pytest.approx(12 * side)
    # Learned, row by row: aa.b, a..b, ...., b...: between columns 2 + 2 + 0 + 1, between rows 1 + 2 + 1.
    assert found.learned_border_length == pytest.approx(9 * side)


def test_evenness_is_one_for_equal_and_zero_for_a_single_owner():
    assert landscape(MAP).learned_evenness == pytest.approx(np.log(2) / np.log(3))
    assert evenness([1, 1, 1]) == pytest.approx(1.0)
    assert evenness([0, 7, 0]) == 0.0
    assert evenness([3]) == 1.0
    assert evenness([0, 0]) is None


def test_a_map_without_anything_learned_has_no_evenness():
    found = landscape(hand_made(["uu", "ff"], ["00", "11"]))

    assert found.learned_evenness is None
    assert found.nearest_evenness == 0.0
    json.dumps(found.figures(), allow_nan=False)


def test_ruggedness_is_the_distance_of_neighbours(tiny_memory):
    chart = pb_map(tiny_memory, 6)
    grid = chart.trajectories.reshape(6, 6, 50, 8)
    across = [dtw(grid[i, j], grid[i, j + 1]) for i in range(6) for j in range(5)]
    up = [dtw(grid[i, j], grid[i + 1, j]) for i in range(5) for j in range(6)]

    rugged = landscape(chart).ruggedness

    assert rugged.mean == pytest.approx(np.mean(across + up))
    assert rugged.median == pytest.approx(np.median(across + up))
    assert rugged.p95 == pytest.approx(np.percentile(across + up, 95))


def test_only_usable_neighbours_count_for_the_usable_mean():
    step = np.zeros((4, 5, 1))
    step[1:, :, 0] = np.array([1.0, 2.0, 4.0])[:, None]
    found = landscape(hand_made(["lu", "fl"], ["00", "00"], step)).ruggedness

    # Neighbours: 0-1 (both usable, 5 postures 1 rad apart), 2-3, 0-2, 1-3 (both usable, 3 rad apart).
    assert found.mean == pytest.approx((5 + 10 + 10 + 15) / 4)
    assert found.mean_appropriate == pytest.approx((5 + 15) / 2)


def test_a_map_from_a_file_asks_for_its_memory(tiny_memory, tmp_path):
    chart = pb_map(tiny_memory, 5)
    back = PBMap.load(chart.save(tmp_path / "map.npz"))

    assert landscape(back).ruggedness is None
    assert landscape(back, tiny_memory) == landscape(chart)


def test_another_memory_is_refused(tiny_memory):
    chart = dataclasses.replace(pb_map(tiny_memory, 3), trajectories=None, learned_pb=np.ones((6, 2)))

    with pytest.raises(SettingsError, match="`memory` should be the one of the map, "):
        landscape(chart, tiny_memory)


def flood(mask):
    """Sizes of regions by walking, the slow and plain way."""
    left, sizes = set(zip(*np.nonzero(mask), strict=True)), []
    for start in zip(*np.nonzero(mask), strict=True):
        todo, size = [start], 0
        while todo:
            i, j = todo.pop()
            if (i, j) in left:
                left.remove((i, j))
                size += 1
                todo += [(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)]
        sizes += [size] if size else []
    return sizes


@pytest.mark.parametrize("seed", range(5))
def test_regions_equal_those_of_a_walk(seed):
    mask = np.random.default_rng(seed).random((23, 31)) < 0.5
    assert region_sizes(mask).tolist() == flood(mask)


def test_a_spiral_is_one_region():
    spiral = np.array([[letter == "1" for letter in row] for row in ["00000", "11110", "00010", "01110", "00000"]])

    assert region_sizes(spiral).tolist() == [8]
    assert region_sizes(~spiral).tolist() == [17]


def test_corners_do_not_touch():
    assert region_sizes(np.eye(3, dtype=bool)).tolist() == [1, 1, 1]
    assert region_sizes(np.zeros((3, 3), bool)).tolist() == []
    assert n_border_edges(np.eye(3, dtype=int)) == 8


def test_what_is_no_map_is_refused():
    with pytest.raises(SettingsError, match=r"`pb_map` should be a map, .* but is 3"):
        landscape(3)


def test_the_examples_say_what_happens():
    result = doctest.testmod(grid, extraglobs={"np": np})
    assert result.attempted > 0
    assert result.failed == 0
