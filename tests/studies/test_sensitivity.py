"""The open choices, changed one at a time: what is changed is changed, and nothing else."""

import dataclasses
import json

import numpy as np
import pytest
from sensitivity import (
    RESCORE,
    SCORINGS,
    TRAININGS,
    SensitivitySettings,
    epochs_of_training,
    learned_threshold,
    main,
    order_of,
    rescore,
    retimed,
    run_study,
    study_scoring,
    study_training,
)

from creative_nao.errors import SettingsError
from creative_nao.evaluation.paper.bank import Entry, PaperSettings
from creative_nao.evaluation.paper.run import reproduce
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
        assert np.allclose(read[-1], taught[-1], atol=1e-12)


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


@pytest.mark.slow
def test_every_way_has_figures_and_verdicts_for_every_condition(studied):
    _, _, study, _ = studied
    assert [row["key"] for row in study["scoring"]] == ["default", "independent"]
    assert [row["key"] for row in study["training"]] == ["default", "tick-0.20"]
    for row in (*study["scoring"], *study["training"]):
        assert set(row["figures"]) == {"appropriateness_pct", "learned_pct", "novelty", "diversity"}
        assert len(row["verdicts"]) == 4
    assert study["training"][1]["n_steps"] == 38


@pytest.mark.slow
def test_all_work_that_is_announced_is_reported_done(studied):
    _, bank, _, seen = studied
    last = {name: done for name, done, _ in seen}
    assert last == {RESCORE: len(bank), **epochs_of_training(SMALL)}


@pytest.mark.slow
def test_a_study_that_is_there_is_not_made_again(studied):
    folder, bank, study, _ = studied
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}
    again = study_training(folder, SMALL, n_workers=1), study_scoring(bank, folder, SMALL, n_workers=1)
    assert again == (study["training"], study["scoring"])
    assert before == {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}


TINY = PaperSettings("quick", n_seeds=1, n_epochs=60, resolution=8, network=NetworkSettings(layer_sizes=(12, 6, 3)))


@pytest.mark.slow
def test_a_study_is_added_to_a_finished_reproduction(tmp_path, monkeypatch, capsys):
    folder = tmp_path / "run"
    reproduce(TINY, folder, n_workers=2, command="creative-nao evaluate paper --quick")
    before = (folder / "results.json").read_bytes()
    small = dataclasses.replace(SMALL, n_seeds=1, scorings=SCORINGS[:1], trainings=TRAININGS[:1])
    monkeypatch.setattr("sensitivity.SensitivitySettings", lambda seed: dataclasses.replace(small, seed=seed))
    monkeypatch.setattr("sys.argv", ["sensitivity.py", str(folder), "--n-workers", "2"])
    main()
    assert "sensitivity.json" in capsys.readouterr().out
    assert json.loads((folder / "sensitivity.json").read_text())["settings"]["resolution"] == 6
    assert "## What depends on which open choice" in (folder / "reproduction.md").read_text(encoding="utf-8")
    assert "sensitivity.json" in json.loads((folder / "run.json").read_text())["hashes"]
    assert (folder / "results.json").read_bytes() == before


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"settings": {"suite": {"name": "quick"}}}, "is no run folder of `creative-nao evaluate paper`"),
        ({"hashes": {}}, "is not finished"),
        ({"memories": {"half/0": "0" * 64}}, r"made with other networks \(half/0 has changed"),
    ],
)
def test_another_folder_is_refused(changes, text, tmp_path):
    record = {
        "command": "creative-nao evaluate paper", "versions": {}, "hashes": {"results.json": "0" * 64},
        "settings": {"suite": {"name": "paper"}, "source": "shipped"}, **changes,
    }  # fmt: skip
    (tmp_path / "run.json").write_text(json.dumps(record))
    with pytest.raises(SettingsError, match=text):
        run_study(tmp_path, SMALL)
