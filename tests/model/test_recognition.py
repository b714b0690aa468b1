"""Recognition on the shipped memories and on networks of other shapes."""

import numpy as np
import pytest

from creative_nao import load_memory
from creative_nao.demonstrations import GuidanceVariation, keyframes, vary
from creative_nao.errors import SettingsError, ShapeError
from creative_nao.maps import pb_grid
from creative_nao.measures import dtw, dtw_matrix, score
from creative_nao.model import NetworkSettings, TrainingSettings, train_network
from creative_nao.model.recognition import descend, distinct, even_cover

CELL = 2 / 199
"""Distance of two points of the paper's grid."""


def appropriate_points(memory, n, seed):
    pb = np.random.default_rng(seed).uniform(-1, 1, (3 * n, 2))
    trajectories = memory.generate(pb)
    chosen = np.flatnonzero(score(trajectories, memory.demonstrations).appropriate)[:n]
    return pb[chosen], trajectories[chosen]


@pytest.fixture(scope="module", params=["open/0", "half/0", "closed/0"])
def shipped(request):
    return load_memory(request.param)


def test_what_is_differentiated_is_what_the_memory_generates(tiny_memory):
    pb = np.random.default_rng(0).uniform(-1, 1, (20, 2))
    angles, _ = tiny_memory.generator.differentiate(pb, 50)

    np.testing.assert_allclose(angles[1:].transpose(2, 0, 1), tiny_memory.generate(pb)[:, 1:], atol=2e-5)


@pytest.mark.parametrize("n_pb", [1, 2, 4])
def test_derivatives_are_those_of_small_steps(waves, n_pb):
    """Every derivative, by PB and by initial state, against the central difference."""
    settings = NetworkSettings(layer_sizes=(7, 5, 3), time_constants=(2, 4, 8), n_pb=n_pb, pb_weight_scale=1.0)
    memory = train_network(waves, TrainingSettings(n_epochs=30), settings)
    generator = memory.generator
    rng = np.random.default_rng(1)
    points = np.concatenate([rng.uniform(-0.9, 0.9, (5, n_pb)), rng.normal(0, 0.5, (5, 3))], axis=1)
    _, derivatives = generator.differentiate(points, 20)

    step = 0.01
    for k in range(n_pb + 3):
        nudge = step * (np.arange(n_pb + 3) == k)
        above, below = (generator.differentiate(points + sign * nudge, 20)[0] for sign in (1, -1))
        np.testing.assert_allclose(derivatives[1:, :, k], ((above - below) / (2 * step))[1:], atol=2e-4)
    assert np.abs(derivatives).max() > 0.01


def test_no_step_of_a_descent_raises_the_error(tiny_memory):
    target = tiny_memory.generate(np.array([[0.4, -0.2]]))[0]
    starts = np.random.default_rng(2).uniform(-1, 1, (6, 2))
    generator = tiny_memory.generator

    errors = [descend(generator, starts, target, n)[1] for n in range(8)]

    assert (np.diff(errors, axis=0) <= 0).all()
    assert (errors[-1] < 0.5 * errors[0]).any()


def test_distinct_keeps_the_first_of_those_that_are_close():
    points = np.array([[0.0, 0.0], [0.05, 0.0], [0.2, 0.0], [0.0, 0.3], [0.21, 0.0]])

    assert distinct(points, 5, apart=0.1).tolist() == [0, 2, 3]
    assert distinct(points, 2, apart=0.1).tolist() == [0, 2]


@pytest.mark.parametrize("n_pb", [1, 2, 3])
def test_the_cover_leaves_no_large_hole(n_pb):
    cover = even_cover(1000, n_pb, np.random.default_rng(0))
    places = np.random.default_rng(1).uniform(-1, 1, (200, n_pb))
    farthest = np.abs(places[:, None] - cover).max(axis=2).min(axis=1).max()

    assert np.abs(cover).max() <= 1
    assert farthest < 2.0 * 2 * 1000 ** (-1 / n_pb)  # twice the spacing of an even grid


def test_a_generated_movement_gives_its_pb_back(shipped):
    """Within one cell of the 200 x 200 map in each PB value; benchmarks/recognition.py does it for many more."""
    for pb, trajectory in zip(*appropriate_points(shipped, 5, seed=11), strict=True):
        found = shipped.infer_pb(trajectory)
        assert np.abs(found.pb - pb).max() <= CELL
        assert found.error < 0.01


def test_tremor_does_not_lead_far_astray(shipped):
    """With noise of 0.02 rad on every angle, the answer is as near as the movement without noise is."""
    rng = np.random.default_rng(3)
    for _, trajectory in zip(*appropriate_points(shipped, 2, seed=12), strict=True):
        shaken = trajectory + rng.normal(0, 0.02, trajectory.shape)
        found = shipped.infer_pb(shaken)
        assert found.error <= dtw(trajectory, shaken) + 0.05
        assert dtw(found.trajectory, trajectory) < dtw(trajectory, shaken)


@pytest.mark.parametrize("action", ["left_jab", "right_uppercut"])
def test_another_persons_recording_is_met_as_well_as_by_the_whole_map(action):
    memory = load_memory("half/0")
    hand = vary(keyframes(action), GuidanceVariation(), np.random.default_rng(5))
    recording = hand.at(np.arange(50) * memory.dt_s)

    found = memory.infer_pb(recording)

    assert found.error <= dtw_matrix(memory.generate(pb_grid(100)), [recording]).min()
    assert found.error < 10.0
    distances = dtw_matrix([found.trajectory], memory.demonstrations.trajectories)[0]
    assert memory.demonstrations.names[int(distances.argmin())] == action


def test_error_and_movement_belong_to_the_pb(tiny_memory):
    target = tiny_memory.demonstrations.trajectories[0]
    found = tiny_memory.infer_pb(target)

    assert np.array_equal(found.trajectory, tiny_memory.generate(found.pb[None])[0])
    assert found.error == dtw(found.trajectory, target)
    assert found.squared_error == pytest.approx(((found.trajectory - target)[1:] ** 2).mean())
    assert found.initial_state is None
    assert np.array_equal(found.restarts.pb[0], found.pb)
    assert found.restarts.error[0] == found.error
    assert (np.diff(found.restarts.error) >= 0).all()
    assert len(found.restarts) > 5


def test_one_seed_one_answer(tiny_memory):
    target = tiny_memory.demonstrations.trajectories[1]
    once, again, other = (tiny_memory.infer_pb(target, seed=seed) for seed in (4, 4, 5))

    assert np.array_equal(once.restarts.pb, again.restarts.pb)
    assert not np.array_equal(once.restarts.pb, other.restarts.pb)


@pytest.mark.parametrize("n_steps", [2, 7, 30, 120])
def test_any_length_will_do(n_steps):
    memory = load_memory("closed/0")
    target = memory.generate(np.array([[0.31, -0.22]]), n_steps)[0]

    found = memory.infer_pb(target)

    assert found.trajectory.shape == (n_steps, 8)
    assert found.error < 0.01


@pytest.mark.parametrize("n_pb", [1, 3])
def test_any_number_of_pb_units_and_joints(waves, n_pb):
    settings = NetworkSettings(layer_sizes=(9, 4), time_constants=(2, 5), n_pb=n_pb, pb_weight_scale=1.0)
    memory = train_network(waves, TrainingSettings(n_epochs=300), settings)
    pb = np.random.default_rng(6).uniform(-0.8, 0.8, n_pb)

    found = memory.infer_pb(memory.generate(pb[None])[0])

    np.testing.assert_allclose(found.pb, pb, atol=CELL)
    assert found.error < 0.01


def test_the_initial_state_can_be_inferred_too():
    """A movement that begins elsewhere, in the middle of something: PB alone cannot explain it."""
    memory = load_memory("half/0")
    rng = np.random.default_rng(7)
    pb, slow = np.array([0.25, -0.4]), rng.normal(0, 0.5, 10)
    elsewhere = memory.generator.starting_from(memory.demonstrations.initial_posture + rng.normal(0, 0.03, 8))
    target = elsewhere(pb[None], 50, slow[None])[0]

    alone, both = memory.infer_pb(target), memory.infer_pb(target, infer_initial_state=True)

    assert np.abs(both.pb - pb).max() <= CELL < np.abs(alone.pb - pb).max()
    assert both.error < 0.1 * alone.error
    assert both.initial_state is not None
    assert both.initial_state.shape == (70,)
    assert not both.initial_state[:60].any()  # only the slowest layer's
    assert np.array_equal(both.trajectory[0], target[0])


def test_an_untaught_start_costs_nothing_where_there_is_none(tiny_memory):
    found = tiny_memory.infer_pb(tiny_memory.generate(np.array([[0.2, 0.2]]))[0], infer_initial_state=True)

    assert found.initial_state is not None
    assert np.abs(found.initial_state).max() < 0.2


@pytest.mark.parametrize(
    ("trajectory", "message"),
    [
        (np.zeros((50, 7)), r"`trajectory` should have shape \(n_steps, 8\).*RShoulderPitch.*but has \(50, 7\)"),
        (np.zeros((1, 8)), r"at least two ticks.*but has \(1, 8\)"),
        (np.zeros(8), r"but has \(8,\)"),
        (np.full((5, 8), np.nan), r"finite angles \[rad\], but is nan at tick 0, joint RShoulderPitch"),
    ],
)
def test_a_bad_trajectory_is_named(tiny_memory, trajectory, message):
    with pytest.raises(ShapeError, match=message):
        tiny_memory.infer_pb(trajectory)


@pytest.mark.parametrize("setting", ["n_restarts", "n_screen"])
def test_a_setting_out_of_range_is_named(tiny_memory, setting):
    with pytest.raises(SettingsError, match=f"`{setting}` should be at least 1, but is 0"):
        tiny_memory.infer_pb(tiny_memory.demonstrations.trajectories[0], **{setting: 0})
    with pytest.raises(SettingsError, match="`seed` should be at least 0, but is -1"):
        tiny_memory.infer_pb(tiny_memory.demonstrations.trajectories[0], seed=-1)
