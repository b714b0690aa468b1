import numpy as np
import pytest

from creative_nao.demonstrations import ACTIONS, GuidanceVariation, Movement, keyframes, vary
from creative_nao.demonstrations.keyframes import DT_S, DURATION_S, GUARD, N_STEPS, both_arms
from creative_nao.errors import NotFoundError, SettingsError
from creative_nao.joints import MIRROR_SIGN, limits

TICKS = np.arange(N_STEPS) * DT_S


def at_rest(trajectory):
    return (np.diff(trajectory, axis=0) == 0).all()


@pytest.mark.parametrize("name", ACTIONS)
def test_each_begins_and_ends_in_the_guard(name):
    trajectory = keyframes(name).at(TICKS)
    guard = both_arms(GUARD, GUARD)
    np.testing.assert_allclose(trajectory[[0, 1, -1]], np.tile(guard, (3, 1)))
    assert keyframes(name).times_s[-1] == pytest.approx(DURATION_S)


@pytest.mark.parametrize("name", ACTIONS)
def test_each_throws_its_punch_three_times_alike(name):
    movement = keyframes(name)
    period = (DURATION_S - 0.3) / 3
    within = np.linspace(0.3, 0.3 + period, 200)
    for repeat in (1, 2):
        np.testing.assert_allclose(movement.at(within), movement.at(within + repeat * period), atol=1e-9)


@pytest.mark.parametrize("name", ACTIONS)
def test_the_other_arm_keeps_the_guard(name):
    trajectory = keyframes(name).at(TICKS)
    left, right = trajectory[:, 4:], trajectory[:, :4]
    assert at_rest(right if name.startswith("left") else left)
    assert not at_rest(left if name.startswith("left") else right)


@pytest.mark.parametrize("punch", ["hook", "uppercut"])
def test_left_and_right_mirror_each_other(punch):
    left, right = (keyframes(f"{side}_{punch}").at(TICKS) for side in ("left", "right"))
    np.testing.assert_array_equal(left[:, 4:], right[:, :4] * MIRROR_SIGN)


@pytest.mark.parametrize("name", ACTIONS)
def test_each_stays_within_the_joints_ranges(name):
    low, high = limits()
    fine = keyframes(name).at(np.linspace(0, DURATION_S, 2000))
    assert (fine > low).all()
    assert (fine < high).all()


def test_the_fastest_is_brisk_and_possible():
    speeds = [np.abs(np.diff(keyframes(name).at(TICKS), axis=0)).max() / DT_S for name in ACTIONS]
    assert 5.0 < max(speeds) < 6.0


def test_a_segment_is_minimum_jerk():
    """Half the way at half the time, and 15/8 of the mean speed there."""
    movement = Movement(np.array([0.0, 2.0]), np.array([[1.0], [3.0]]))
    assert movement.at(np.array([-1.0, 0.0, 1.0, 2.0, 9.0]))[:, 0].tolist() == [1.0, 1.0, 2.0, 3.0, 3.0]
    speed = np.diff(movement.at(np.array([0.999, 1.001])), axis=0)[0, 0] / 0.002
    assert speed == pytest.approx(15 / 8, rel=1e-4)


def test_an_unknown_action_is_not_found():
    with pytest.raises(NotFoundError, match=r"no basic action `left_jabb` \(did you mean `left_jab`\?\)"):
        keyframes("left_jabb")
    with pytest.raises(SettingsError, match="`name` should be text, but is 3"):
        keyframes(3)


def test_keys_out_of_order_are_refused():
    with pytest.raises(SettingsError, match="`times_s` should rise from key to key"):
        Movement(np.array([0.0, 1.0, 1.0]), np.zeros((3, 8)))


def test_without_variation_the_hand_follows_the_key_postures():
    path = vary(keyframes("left_hook"), GuidanceVariation(0, 0, 0, 0), np.random.default_rng(0))
    np.testing.assert_allclose(path.at(TICKS), keyframes("left_hook").at(TICKS), atol=1e-12)


def test_a_varied_action_still_ends_in_time_within_the_ranges():
    low, high = limits()
    for seed in range(20):
        path = vary(keyframes("right_straight"), GuidanceVariation(0.2, 0.2, 0.05, 0.01), np.random.default_rng(seed))
        assert path.movement.times_s[-1] == pytest.approx(DURATION_S)
        fine = path.at(np.linspace(0, DURATION_S, 500))
        assert (fine > low).all()
        assert (fine < high).all()


@pytest.mark.parametrize(("part", "band"), [("drift", (0.05, 0.4)), ("tremor", (8.0, 12.0))])
def test_wander_has_the_size_and_the_frequencies_it_is_given(part, band):
    path = vary(keyframes("left_jab"), GuidanceVariation(drift_rad=0.02, tremor_rad=0.004), np.random.default_rng(0))
    times = np.arange(0, 400, 0.01)
    signal = getattr(path, part)(times)
    assert signal.std() == pytest.approx({"drift": 0.02, "tremor": 0.004}[part], rel=0.05)
    power = np.abs(np.fft.rfft(signal * np.hanning(len(times))[:, None], axis=0)) ** 2
    frequencies = np.fft.rfftfreq(len(times), 0.01)
    inside = (frequencies > band[0] - 0.01) & (frequencies < band[1] + 0.01)
    assert power[inside].sum() > 0.999 * power.sum()


def test_the_seed_decides():
    def path(seed):
        return vary(keyframes("left_jab"), GuidanceVariation(), np.random.default_rng(seed)).at(TICKS)

    np.testing.assert_array_equal(path(1), path(1))
    assert not np.array_equal(path(1), path(2))


@pytest.mark.parametrize("field", ["timing", "reach", "drift_rad", "tremor_rad"])
def test_a_variation_out_of_range_is_refused_by_name(field):
    with pytest.raises(SettingsError, match=f"`{field}` should be at least 0, but is -0.1"):
        GuidanceVariation(**{field: -0.1})
