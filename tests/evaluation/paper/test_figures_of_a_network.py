"""A network's figures on made-up curves and maps whose answers can be seen."""

import dataclasses

import numpy as np
import pytest

from creative_nao.demonstrations import Demonstrations
from creative_nao.evaluation.paper.summary import (
    combination_figures,
    epochs_to_level,
    mixtures,
    steep_step_pct,
    unsteadiness,
)
from creative_nao.maps import PBMap, pb_grid, pb_map
from creative_nao.measures import score


def with_curve(memory, history, every=1):
    return dataclasses.replace(memory, loss_history=np.array(history, dtype=np.float32), loss_every=every)


def chart_of(demos, trajectories, resolution):
    """A map whose points generate the given trajectories."""
    scores = score(trajectories, demos)
    pb = pb_grid(resolution)
    learned = np.zeros((demos.n_actions, 2))
    return PBMap(
        resolution, pb, scores.outcome, scores.nearest, scores.novelty, learned, demos.names, {}, trajectories
    )  # fmt: skip


def test_convergence_is_the_first_epoch_below_the_level(tiny_memory):
    curve = [100.0, 50.0, 0.9, 20.0, 0.5]
    assert epochs_to_level(with_curve(tiny_memory, curve)) == 3
    assert epochs_to_level(with_curve(tiny_memory, curve, every=20)) == 41
    assert epochs_to_level(with_curve(tiny_memory, [100.0, 50.0])) is None


def test_a_steady_curve_is_steadier_than_one_with_spikes(tiny_memory):
    steady = np.full(100, 7.0)
    spiked = steady.copy()
    spiked[50] = 700.0  # two decades up and down again, within 89 steps after the first tenth
    assert unsteadiness(with_curve(tiny_memory, steady)) == 0.0
    assert unsteadiness(with_curve(tiny_memory, spiked)) == pytest.approx(4 / 89)


def test_mixtures_change_the_action_once_or_take_an_arm_of_each(demonstrations):
    made = mixtures(demonstrations, 0, 1)
    first, second = demonstrations.trajectories[:2]
    ticks = list(range(5, 50, 5))
    assert [kind for kind, _ in made] == ["in time"] * len(ticks) + ["of arms"]
    for (_, mixture), tick in zip(made, ticks, strict=False):
        assert np.array_equal(mixture[:tick], first[:tick])
        assert np.array_equal(mixture[tick:], second[tick:])
    assert np.array_equal(made[-1][1][:, :4], first[:, :4])  # the right arm's four joints come first
    assert np.array_equal(made[-1][1][:, 4:], second[:, 4:])


def test_a_mixture_is_found_to_be_a_combination(tiny_memory):
    demos = tiny_memory.demonstrations
    _, mixture = mixtures(demos, 1, 2)[-1]
    charted = chart_of(demos, np.array([mixture] * 4), 2)
    assert set(charted.outcome) == {"unlearned"}
    found = combination_figures(tiny_memory, charted, np.random.default_rng(0))
    assert found["combination_pct"] == 100.0
    clearest = found["clearest_combination"]
    assert (clearest["first"], clearest["second"], clearest["kind"]) == ("right_straight", "left_hook", "of arms")
    assert clearest["distance"] == 0.0


def test_a_map_of_basic_actions_has_no_combination(tiny_memory):
    demos = tiny_memory.demonstrations
    charted = chart_of(demos, np.array(demos.trajectories[:4]), 2)
    found = combination_figures(tiny_memory, charted, np.random.default_rng(0))
    assert (found["combination_pct"], found["clearest_combination"]) == (None, None)
    assert 0 <= found["n_pairs_between"] <= 15


def test_steps_between_two_basic_actions_are_steep_and_those_within_one_are_not(demonstrations):
    jab, straight = demonstrations.trajectories[:2]
    trajectories = np.array([jab, jab, straight] * 3)  # 3 of 12 steps change the action
    assert steep_step_pct(chart_of(demonstrations, trajectories, 3), demonstrations) == pytest.approx(25.0)
    assert steep_step_pct(chart_of(demonstrations, np.array([jab] * 9), 3), demonstrations) == 0.0


def test_steps_from_or_to_what_cannot_be_used_do_not_count(demonstrations):
    jab = demonstrations.trajectories[0]
    still = np.repeat(jab[:1], len(jab), axis=0)
    charted = chart_of(demonstrations, np.array([jab, still, still, jab]), 2)
    assert steep_step_pct(charted, demonstrations) == 0.0


def test_arms_are_mixed_only_where_both_are_there(waves):
    assert {kind for kind, _ in mixtures(waves, 0, 1)} == {"in time"}  # both joints are of the right arm
    both = Demonstrations(waves.names, waves.trajectories, waves.dt_s, ("RShoulderPitch", "LShoulderPitch"))
    assert mixtures(both, 0, 1)[-1][0] == "of arms"


def test_the_tiny_memory_has_all_figures(tiny_memory):
    found = combination_figures(tiny_memory, pb_map(tiny_memory, 8), np.random.default_rng(0))
    assert set(found) == {"combination_pct", "clearest_combination", "n_pairs_between"}
