"""The open choices, changed one at a time: what is changed is changed, and nothing else."""

import numpy as np
import pytest

from creative_nao.evaluation.paper.bank import Entry
from creative_nao.evaluation.paper.sensitivity import (
    RESCORE,
    SCORINGS,
    TRAININGS,
    SensitivitySettings,
    epochs_of_training,
    findings,
    learned_threshold,
    order_of,
    rescore,
    retimed,
    study_scoring,
    study_training,
)
from creative_nao.maps import pb_grid
from creative_nao.measures import table
from creative_nao.model import NetworkSettings

BY_KEY = {one.key: one for one in SCORINGS}
SMALL = SensitivitySettings(
    n_seeds=2, n_epochs=40, resolution=6, scorings=SCORINGS[:2], trainings=(TRAININGS[0], TRAININGS[3]),
    network=NetworkSettings(layer_sizes=(12, 6, 3)),
)  # fmt: skip


@pytest.fixture(scope="module")
def grid(tiny_memory):
    return tiny_memory.generate(pb_grid(20))


def test_the_default_scores_like_table_i(tiny_memory, grid):
    found = rescore(grid, tiny_memory.demonstrations, SCORINGS[0], 7)
    usual = table(grid, tiny_memory.demonstrations, rng=7)
    assert found["appropriateness_pct"] == usual.appropriate_pct
    assert found["learned_pct"] == usual.learned_pct
    assert found["novelty"] == pytest.approx(usual.novelty.mean, rel=1e-12)
    assert found["diversity"] == pytest.approx(usual.diversity.mean, rel=1e-12)


def test_the_threshold_keeps_its_share_of_the_distance_between_basic_actions(demonstrations):
    assert learned_threshold(demonstrations, SCORINGS[0]) == 10.0
    for key in ("independent", "window", "normalised", "squared"):
        several = demonstrations.trajectories
        upper = np.triu_indices(len(several), 1)
        mean, usual = (one.distances(several, several)[upper].mean() for one in (BY_KEY[key], SCORINGS[0]))
        assert learned_threshold(demonstrations, BY_KEY[key]) / mean == pytest.approx(10.0 / usual)


def test_a_speed_limit_for_each_joint_refuses_more(tiny_memory, grid):
    demos = tiny_memory.demonstrations
    per_joint = rescore(grid, demos, BY_KEY["per-joint"], 0)
    assert per_joint["appropriateness_pct"] <= rescore(grid, demos, SCORINGS[0], 0)["appropriateness_pct"]


def test_nothing_usable_leaves_novelty_and_diversity_open(demonstrations):
    still = np.repeat(demonstrations.trajectories[0][:1], 50, axis=0)
    assert rescore(np.array([still] * 4), demonstrations, SCORINGS[0], 0) == {
        "appropriateness_pct": 0.0, "learned_pct": 0.0, "novelty": None, "diversity": None,
    }  # fmt: skip


def test_another_tick_reads_the_same_movement(demonstrations):
    finer = retimed(demonstrations, dt_s=0.05, n_steps=148)
    assert finer.dt_s == 0.05
    for read, taught in zip(finer.trajectories, demonstrations.trajectories, strict=True):
        assert np.allclose(read[::3], taught[: len(read[::3])], atol=1e-12)
        assert np.array_equal(read[-1], taught[-1])


def test_slower_movements_have_slower_joints_and_the_same_postures(demonstrations):
    slow = TRAININGS[4].demonstrations(demonstrations)
    assert slow.dt_s == demonstrations.dt_s
    assert 0.6 * demonstrations.max_speed < slow.max_speed < 0.8 * demonstrations.max_speed
    for read, taught in zip(slow.trajectories, demonstrations.trajectories, strict=True):
        assert np.allclose(read[::3], taught[: 2 * len(read[::3]) : 2], atol=1e-12)


@pytest.mark.parametrize(("place", "shape", "dt_s"), [(2, (75, 8), 0.10), (3, (38, 8), 0.20), (4, (50, 8), 0.15)])
def test_ticks_and_lengths_are_the_stated_ones(place, shape, dt_s, demonstrations):
    changed = TRAININGS[place].demonstrations(demonstrations)
    assert (changed.trajectories[0].shape, changed.dt_s) == (shape, dt_s)


def test_every_way_to_train_changes_one_thing(demonstrations):
    default = TRAININGS[0]
    for way in TRAININGS[1:]:
        other_network = way.network != default.network
        other_data = way.demonstrations(demonstrations) is not default.demonstrations(demonstrations)
        assert other_network != other_data, way.key


def test_an_order_leaves_out_what_is_unknown():
    assert order_of({"open": 1.0, "half": None, "closed": 2.0}) == ["closed", "open"]


@pytest.fixture(scope="module")
def studied(tmp_path_factory, tiny_memory):
    folder = tmp_path_factory.mktemp("study")
    path = tiny_memory.save(folder / "half-3.safetensors")
    bank = [Entry(condition, 3, path) for condition in ("open", "half", "closed")]
    seen = []
    scoring = study_scoring(bank, folder, SMALL, n_workers=2, report=lambda *told: seen.append(told))
    training = study_training(folder, SMALL, n_workers=2, report=lambda *told: seen.append(told))
    return folder, bank, {"settings": SMALL.described(), "scoring": scoring, "training": training}, seen


def test_every_way_has_figures_and_verdicts_for_every_condition(studied):
    _, _, study, _ = studied
    assert [row["key"] for row in study["scoring"]] == ["default", "independent"]
    assert [row["key"] for row in study["training"]] == ["default", "tick-0.20"]
    for row in (*study["scoring"], *study["training"]):
        assert set(row["figures"]) == {"appropriateness_pct", "learned_pct", "novelty", "diversity"}
        assert len(row["verdicts"]) == 4
    assert study["training"][1]["n_steps"] == 38


def test_all_work_that_is_announced_is_reported_done(studied):
    _, bank, _, seen = studied
    last = {name: done for name, done, _ in seen}
    assert last == {RESCORE: len(bank), **epochs_of_training(SMALL)}


def test_a_study_that_is_there_is_not_made_again(studied):
    folder, bank, study, _ = studied
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}
    again = study_training(folder, SMALL, n_workers=1), study_scoring(bank, folder, SMALL, n_workers=1)
    assert again == (study["training"], study["scoring"])
    assert before == {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}


def test_a_verdict_that_turns_is_told(studied):
    _, _, study, _ = studied
    rows = [{**row, "verdicts": {key: dict(one) for key, one in row["verdicts"].items()}} for row in study["scoring"]]
    rows[0]["verdicts"]["half-novel"]["verdict"] = "holds"
    rows[1]["verdicts"]["half-novel"]["verdict"] = "does not hold"
    for row in rows:
        row["order"] = {**row["order"], "novelty": ["half", "open", "closed"]}
    told = findings({**study, "scoring": rows})
    assert told[0] == (
        "'Half closed training makes the most novel actions.' depends on how it is scored: holds with the defaults; "
        "does not hold with DTW: a path of its own for each joint. Half has the largest mean in 2 of 2 ways."
    )
    assert findings({**study, "scoring": rows}, only_changing=True)[0] == told[0]


def test_a_verdict_that_never_changes_is_told_once(studied):
    _, _, study, _ = studied
    same = [line for line in findings(study) if "however it is scored: undecided" in line]
    assert len(same) == 4  # of one network a condition nothing can be decided
    assert not set(same) & set(findings(study, only_changing=True))
