import numpy as np
import pytest

from creative_nao.envs.observation import N_CELLS, ObservationBatch, Track, layout, split, try_columns
from creative_nao.measures.outcome import ALL_OUTCOMES

PARTS = {part.name: slice(part.start, part.stop) for part in layout()}
ONE = np.zeros(1, np.int64)


def record(observations, row=0, **changes):
    """Record an action; distances are in units of the reward, whose scale is 2 rad."""
    given = {"pb": [0.5, -0.5], "outcome": "unlearned", "nearest": 2, "novelty": 1.0, "known": 0.5, "reward": 0.5}
    given |= changes
    pb = np.array(given["pb"], dtype=float).reshape(1, -1, 2)
    terms = {
        "nearest": np.array([given["nearest"]]),
        "distance": np.array([2.0 * given["novelty"]]),
        "known_distance": np.array([2.0 * given["known"]]),
        "basic_distances": 2.0 * np.arange(6.0)[None],
        "reward_novelty": np.array([given["reward"]]),
    }
    outcome = np.array([ALL_OUTCOMES.index(given["outcome"])])
    observations.record(ONE, np.array([row]), pb, outcome, terms, np.array([2.0]))
    return observations.vector()


def test_an_episode_begins_with_zeros():
    assert not ObservationBatch(layout()).vector().any()


def test_an_action_is_told_part_by_part():
    seen = record(ObservationBatch(layout()))

    np.testing.assert_allclose(seen[PARTS["pb"]], [0.5, -0.5])
    assert seen[PARTS["outcome"]].tolist() == [float(name == "unlearned") for name in ALL_OUTCOMES]
    assert seen[PARTS["novelty"]] == 0.5
    assert seen[PARTS["known"]] == pytest.approx(1 / 3)
    assert seen[PARTS["nearest"]].tolist() == [0, 0, 1, 0, 0, 0]
    assert seen[PARTS["coverage"]] == 1 / N_CELLS**2


def test_the_cell_of_a_point_lies_where_the_page_says():
    """PB (0.5, -0.5): column floor(0.75 * 8) = 6 of row floor(0.25 * 8) = 2."""
    cells = record(ObservationBatch(layout()))[PARTS["cells"]]

    assert np.flatnonzero(cells).tolist() == [2 * N_CELLS + 6]


@pytest.mark.parametrize("corner", [(-1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
def test_corners_have_cells(corner):
    assert np.count_nonzero(record(ObservationBatch(layout()), pb=corner)[PARTS["cells"]]) == 1


def test_a_cell_keeps_the_best_that_was_found_in_it():
    observations = ObservationBatch(layout())
    values = [
        record(observations, **change)[PARTS["cells"]].sum()
        for change in ({"outcome": "fluctuating", "reward": 0.0}, {"reward": 1.0}, {"reward": 0.2}, {"outcome": "fell"})
    ]

    assert values == [-1.0, 0.5, 0.5, 0.5]


def test_a_known_movement_still_marks_its_cell():
    assert record(ObservationBatch(layout()), reward=0.0)[PARTS["cells"]].max() == pytest.approx(0.1)


def test_the_vector_is_a_copy():
    observations = ObservationBatch(layout())
    before = observations.vector()
    record(observations)

    assert not before.any()


def test_a_movement_of_several_pb_vectors_marks_the_cells_of_all():
    """(-1, -1) is cell 0, (1, 1) the last; the last vector is the one that `pb` tells."""
    seen = record(ObservationBatch(layout()), pb=[[-1, -1], [0.99, 0.99], [1, 1]])

    assert np.flatnonzero(seen[PARTS["cells"]]).tolist() == [0, N_CELLS**2 - 1]
    assert seen[PARTS["pb"]].tolist() == [1, 1]


def test_robots_side_by_side_see_their_own():
    observations = ObservationBatch(layout(), 3)
    observations.set_part(np.array([0, 2]), "step", np.array([0.25, 0.5]))

    assert observations.vectors()[:, PARTS["step"]].ravel().tolist() == [0.25, 0.0, 0.5]
    observations.begin(2, np.zeros((6, 2)))
    assert not observations.vector(2).any()


def test_a_try_is_told_column_by_column():
    columns = try_columns()
    observations = ObservationBatch(layout(n_rows=4), 1, columns)
    observations.begin(0, np.linspace(-1, 1, 12).reshape(6, 2))
    record(observations, row=1, reward=1.0)
    seen = record(observations, row=4)  # beyond the end of the episode: left out
    found = split(seen, layout(n_rows=4), columns)
    row = {column.name: found["tries"][1, column.start : column.stop].tolist() for column in columns}

    assert found["points"].tolist() == np.linspace(-1, 1, 12).astype(np.float32).tolist()
    assert not found["tries"][[0, 2, 3]].any()
    assert found["step"] == [0.0]
    assert (row["tried"], row["pb"], row["reward"]) == ([1.0], [0.5, -0.5], [0.5])
    assert row["outcome"] == [float(name == "unlearned") for name in ALL_OUTCOMES]
    assert row["distances"] == [np.float32(d / (d + 1)) for d in range(6)]


@pytest.mark.parametrize(("track", "left_out"), [("outcomes", {"points", "distances"}), ("points", {"distances"})])
def test_a_track_leaves_out_what_it_does_not_hold(track, left_out):
    every = {part.name for part in (*layout(n_rows=3), *try_columns())}
    held = {part.name for part in (*layout(n_rows=3, track=Track(track)), *try_columns(track=Track(track)))}

    assert every - held == left_out
