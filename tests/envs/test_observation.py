import re

import numpy as np
import pytest

from creative_nao.envs import BoxingEnv, BoxingMentalEnv
from creative_nao.envs.observation import N_CELLS, OUTCOMES, Observer, layout, observation_space

PARTS = {part.name: slice(part.start, part.stop) for part in layout()}


def record(observer, **changes):
    given = {"pb": np.array([0.5, -0.5]), "outcome": "unlearned", "nearest": 2, "novelty": 1.0, "known": 0.5}
    observer.record(**{**given, "reward": 0.5, "progress": 0.1, **changes})
    return observer.vector()


@pytest.mark.parametrize("env", [BoxingMentalEnv, BoxingEnv])
def test_the_documented_table_is_the_layout(env):
    """Index, name and range of each row of the page are those of the space."""
    space = observation_space(6, 2)
    rows = re.findall(r"^ *\| (\d+)(?:-(\d+))? \| (\w+) \|.*\| (-?\d) \| (-?\d) \|$", env.__doc__, re.MULTILINE)

    assert [(int(a), int(b or a) + 1, name) for a, b, name, _, _ in rows] == [
        (p.start, p.stop, p.name) for p in layout()
    ]
    for first, _, _, low, high in rows:
        assert (space.low[int(first)], space.high[int(first)]) == (int(low), int(high))
    assert f"`Box({space.shape[0]},) float32`" in env.__doc__


def test_an_episode_begins_with_zeros():
    assert not Observer(6, 2).vector().any()


def test_an_action_is_told_part_by_part():
    seen = record(Observer(6, 2))

    np.testing.assert_allclose(seen[PARTS["pb"]], [0.5, -0.5])
    assert seen[PARTS["outcome"]].tolist() == [float(name == "unlearned") for name in OUTCOMES]
    assert seen[PARTS["novelty"]] == 0.5
    assert seen[PARTS["known"]] == pytest.approx(1 / 3)
    assert seen[PARTS["nearest"]].tolist() == [0, 0, 1, 0, 0, 0]
    assert seen[PARTS["coverage"]] == 1 / N_CELLS**2
    assert seen[PARTS["step"]] == pytest.approx(0.1)


def test_the_cell_of_a_point_lies_where_the_page_says():
    """PB (0.5, -0.5): column floor(0.75 * 8) = 6 of row floor(0.25 * 8) = 2."""
    cells = record(Observer(6, 2))[PARTS["cells"]]

    assert np.flatnonzero(cells).tolist() == [2 * N_CELLS + 6]


@pytest.mark.parametrize("corner", [(-1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
def test_corners_have_cells(corner):
    assert np.count_nonzero(record(Observer(6, 2), pb=np.array(corner))[PARTS["cells"]]) == 1


def test_a_cell_keeps_the_best_that_was_found_in_it():
    observer = Observer(6, 2)
    values = [
        record(observer, **change)[PARTS["cells"]].sum()
        for change in ({"outcome": "fluctuating", "reward": 0.0}, {"reward": 1.0}, {"reward": 0.2}, {"outcome": "fell"})
    ]

    assert values == [-1.0, 0.5, 0.5, 0.5]


def test_a_known_movement_still_marks_its_cell():
    assert record(Observer(6, 2), reward=0.0)[PARTS["cells"]].max() == pytest.approx(0.1)


def test_the_vector_is_a_copy():
    observer = Observer(6, 2)
    before = observer.vector()
    record(observer)

    assert not before.any()
