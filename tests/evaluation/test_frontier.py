"""Suites with imagined movements: names, budgets in every row, worth in imaginings, the shipped oracle."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from creative_nao.cli.evaluate import EvaluateSettings, _chosen, _command
from creative_nao.errors import NotFoundError, SettingsError
from creative_nao.evaluation.jobs import plan
from creative_nao.evaluation.leaderboard import by_budget
from creative_nao.evaluation.oracle_sets import find_oracle_set, shipped_oracle_set
from creative_nao.evaluation.results import summarise
from creative_nao.evaluation.run import evaluate
from creative_nao.evaluation.runner import LocalExecutor
from creative_nao.evaluation.statistics import worth
from creative_nao.evaluation.suites import find_suite, refuse_modules, suite_from_values
from creative_nao.evaluation.verification import contradictions, verify
from creative_nao.model import load_memory, split_memories

MENTAL = "CreativeNao/BoxingMental-v0"
RESULTS = Path(__file__).parents[2] / "docs" / "results"
SMALL = {"name": "small", "agents": ["random", "spread@1"], "envs": [MENTAL], "memories": ["half/10"], "n_seeds": 2}


def rewards(mean, n_runs=5, spread=0.0):
    values = np.full((n_runs, 2), float(mean))
    values[::2] += spread
    values[1::2] -= spread * (n_runs + 1) / (n_runs - 1)
    return values


def test_worth_is_read_off_the_curve_linearly_in_the_logarithm():
    curve = [(1, rewards(10.0)), (2, rewards(14.0)), (8, rewards(18.0))]

    def of(mean):
        return worth(rewards(mean), curve, rng=np.random.default_rng(0))["mean"]

    assert [of(10.0), of(12.0), of(14.0), of(16.0)] == pytest.approx([1.0, 2.0**0.5, 2.0, 4.0])
    assert [of(5.0), of(30.0)] == pytest.approx([1.0, 8.0])  # the ends: at most, at least


def test_the_interval_of_worth_holds_it_and_grows_with_the_noise():
    curve = [(1, rewards(10.0, spread=0.2)), (2, rewards(14.0, spread=0.2)), (8, rewards(18.0, spread=0.2))]
    little, much = (worth(rewards(14.0, spread=s), curve, rng=np.random.default_rng(0)) for s in (0.1, 1.0))
    for found in (little, much):
        assert found["low"] <= 2.0 <= found["high"]
    assert much["high"] - much["low"] > little["high"] - little["low"]


def test_every_agent_without_a_number_takes_part_once_with_each():
    suite = suite_from_values({**SMALL, "n_imagined": [1, 4]}, where="here")
    assert suite.agents == ("random@1", "random@4", "spread@1")
    again = suite_from_values(json.loads(json.dumps(dataclasses.asdict(suite))), where="here")
    assert again == suite
    with pytest.raises(SettingsError, match="n_imagined"):
        suite_from_values({**SMALL, "n_imagined": [0]}, where="here")


def test_a_module_is_refused_with_a_number_too():
    suite = suite_from_values({**SMALL, "agents": ["json:loads@8"]}, where="here")
    with pytest.raises(SettingsError, match="`json:loads@8` is a module that would be imported"):
        refuse_modules(suite, "here")


def test_flags_change_memories_seeds_and_both_budgets_and_stand_in_the_command():
    flags = EvaluateSettings("frontier", agents="random,plan", memories="half/12,validation", n_seeds=2, n_actions=9,
                             n_imagined="1,3")  # fmt: skip
    suite = _chosen(flags)
    assert suite.agents == ("random@1", "random@3", "plan@1", "plan@3")
    assert suite.memories == ("half/12", *split_memories("validation"))
    assert (suite.n_seeds, suite.n_actions) == (2, 9)
    command = _command(flags)
    assert "--memories half/12,validation --n-seeds 2 --n-actions 9 --n-imagined 1,3" in command
    assert _chosen(EvaluateSettings("search", n_imagined="2")).agents[:2] == ("supervised@2", "random@2")
    for wrong, error, text in (
        ({"memories": "half/99"}, NotFoundError, "no memory `half/99`"),
        ({"n_imagined": "2.5"}, SettingsError, "--n-imagined should be whole numbers"),
        ({"n_seeds": 0}, SettingsError, "`--n-seeds` should be at least 1"),
        ({"agents": "sprad@3"}, NotFoundError, "no agent `sprad`"),
    ):
        with pytest.raises(error, match=text):
            _chosen(EvaluateSettings("frontier", **wrong))
    with pytest.raises(SettingsError, match="trains its memories"):
        _chosen(EvaluateSettings("transfer", memories="half/0"))


def test_the_oracle_of_shipped_memories_is_not_searched_anew():
    search = find_suite("search")
    charted = [job.spec for job in plan(search, base_seed=0) if job.kind == "chart"]
    assert [spec["memory"]["name"] for spec in charted] == list(search.shown)
    assert {spec["oracle"] for spec in charted} == {"shipped"}
    other = dataclasses.replace(search, resolution=50)
    assert {job.spec["oracle"] for job in plan(other, base_seed=0) if job.kind == "chart"} == {"found"}
    assert shipped_oracle_set("half/12", 101) is None
    assert len(shipped_oracle_set("closed-8pb/12", 30).pb[0]) == 8


@pytest.mark.slow
@pytest.mark.parametrize("name", ["half/12", "half-4pb/12"])
def test_the_shipped_oracle_is_what_a_search_of_the_map_finds(name):
    found, _ = find_oracle_set(load_memory(name), 20, 200)
    shipped = shipped_oracle_set(name, 20)
    assert np.array_equal(found.pb, shipped.pb)
    assert found.rewards == pytest.approx(shipped.rewards, rel=1e-12)
    assert found.shares_pct == pytest.approx(shipped.shares_pct)


@pytest.mark.slow
def test_a_run_tells_both_budgets_tracks_and_worth_and_verifies(tmp_path):
    values = {**SMALL, "agents": ["random", "spread@1", "plan@4"], "n_imagined": [1, 4], "n_actions": 6}
    values["memories"] = ["half/10", "open/10"]
    suite = suite_from_values({**values, "baseline": "random@1"}, where="here")
    done = evaluate(suite, tmp_path / "run", executor=LocalExecutor(1), command="creative-nao evaluate small")
    rows = {row["agent"]: row for row in done.results["rows"]}
    assert [rows[name]["n_imagined"] for name in ("random@1", "random@4", "plan@4")] == [0.0, 24.0, 24.0]
    assert [rows[name]["track"] for name in ("random@1", "plan@4")] == ["outcomes", "trajectories"]
    for row in rows.values():
        assert row["regret"]["mean"] == pytest.approx(row["oracle_reward"] - row["reward"]["mean"])
        assert row["refused_pct"]["mean"] == 0.0
        assert 0.0 <= row["coverage_pct"]["mean"] <= 100.0
        assert row["best"]["mean"] <= row["reward"]["mean"]
    summary = {entry["agent"]: entry for entry in done.results["summary"]}
    assert summary["random@1"]["worth"]["mean"] == 1.0
    assert 1.0 <= summary["spread@1"]["worth"]["mean"] <= summary["spread@1"]["worth_most"] == 4
    assert [(k, track) for k, track, _ in by_budget(done.results["summary"])] == [
        (1, "outcomes"), (4, "outcomes"), (4, "trajectories"),
    ]  # fmt: skip
    assert "Worth imaginings" in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    checked = verify(tmp_path / "run" / "results.json", n_sample=3, executor=LocalExecutor(1))
    assert checked.holds
    assert checked.exact


def published():
    """Give every result file; those of thousands of episodes take seconds each and are looked at every night."""
    for path in sorted(RESULTS.glob("*.json")):
        yield pytest.param(path, id=path.stem, marks=[pytest.mark.slow] if path.stat().st_size > 140_000 else [])


@pytest.mark.parametrize("path", list(published()))
def test_published_summaries_follow_from_their_rows(path):
    found = json.loads(path.read_text(encoding="utf-8"))
    seed, baseline = found["record"]["settings"]["seed"], found["record"]["settings"]["suite"]["baseline"]
    assert contradictions(found, baseline, seed) == []
    entry = summarise(found["rows"], baseline=baseline, base_seed=seed)[0]
    assert entry["reward_other_memories"]["low"] <= entry["reward"]["mean"] <= entry["reward_other_memories"]["high"]
