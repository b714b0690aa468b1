"""Published pages say what the result files say, and a result file can be played again."""

import dataclasses
import json
import re
import shutil
from pathlib import Path

import pytest
from publish_results import LEARNED, MENTAL, _steps, publish, read_published, result_page

from creative_nao.errors import FileFormatError, NotFoundError, SettingsError
from creative_nao.evaluation.leaderboard import leaderboard
from creative_nao.evaluation.results import make_results, read_results, verdict
from creative_nao.evaluation.runner import LocalExecutor
from creative_nao.evaluation.verification import contradictions, verify
from creative_nao.schema import dump

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def published(finished, tmp_path_factory):
    docs = tmp_path_factory.mktemp("docs")
    publish([finished.folder], docs)
    return docs


def rows_of(page):
    """Table rows of a page as lists of cells."""
    return [
        [cell.strip() for cell in line.strip("|").split("|")] for line in page.splitlines() if line.startswith("| ")
    ]


def test_the_leaderboard_has_everyone_s_figures(published, finished):
    page = (published / "leaderboard.md").read_text()
    rows = rows_of(page)
    for entry in finished.results["summary"]:
        reward, iqm = entry["reward"], entry["reward_iqm"]
        title = entry["agent"] + (" (baseline)" if entry["agent"] == "supervised" else "")
        cells = [f"{x['mean']:.2f} [{x['low']:.2f}, {x['high']:.2f}]" for x in (iqm, reward)]
        assert any(row[:3] == [title, *cells] for row in rows)


def test_the_leaderboard_is_sorted(published, finished):
    found = [
        float(row[1].split()[0]) for row in rows_of((published / "leaderboard.md").read_text()) if row[1][0].isdigit()
    ]
    n = len(finished.results["summary"]) // 2
    assert found[:n] == sorted(found[:n], reverse=True)
    assert found[n:] == sorted(found[n:], reverse=True)


def test_the_published_pages_are_those_of_the_published_files():
    found = read_published(DOCS)
    if found:
        assert (DOCS / "leaderboard.md").read_text(encoding="utf-8") == leaderboard(found)
        assert (DOCS / "results.md").read_text(encoding="utf-8") == result_page(found)


@pytest.mark.parametrize("path", sorted((DOCS / "results").glob("*.json")), ids=lambda path: path.stem)
def test_the_published_means_follow_from_their_episodes(path):
    results = json.loads(path.read_text(encoding="utf-8"))
    assert (
        contradictions(
            results, results["record"]["settings"]["suite"]["baseline"], results["record"]["settings"]["seed"]
        )
        == []
    )


def test_a_published_file_names_no_folder_of_the_machine(published):
    assert str(published.parent) not in (published / "results" / "fake.json").read_text()


def test_publishing_needs_a_folder_and_one_run_a_suite(finished, tmp_path):
    with pytest.raises(SettingsError, match=r"--docs should name the folder of the documentation, but .* is none"):
        publish([finished.folder], tmp_path / "nowhere")
    with pytest.raises(SettingsError, match="of different suites, but two are of `fake`"):
        publish([finished.folder, finished.folder], tmp_path)
    with pytest.raises(NotFoundError, match="no results at"):
        publish([tmp_path], tmp_path)


def test_results_without_a_summary_are_refused(finished, tmp_path):
    folder = tmp_path / "old"
    shutil.copytree(finished.folder, folder, ignore=shutil.ignore_patterns("jobs", "figures"))
    old = {key: value for key, value in finished.results.items() if key != "summary"}
    (folder / "results.json").write_text(json.dumps(old))
    with pytest.raises(FileFormatError, match="`summary` is missing"):
        publish([folder], tmp_path)


def entry(low, high, low_wide, high_wide, agent="sobol"):
    mean = (low + high) / 2
    figure = {"mean": 10.0 + mean, "low": 9.0, "high": 11.0}
    versus = {
        "baseline": "supervised",
        "probability_of_improvement": {"mean": 0.7, "low": 0.6, "high": 0.8},
        "difference": {"mean": mean, "low": low, "high": high},
        "difference_other_memories": {"mean": mean, "low": low_wide, "high": high_wide},
        "n_memories_ahead": 9,
    }
    share = {"mean": 0.4, "low": 0.35, "high": 0.45}
    return {
        "agent": agent, "env": MENTAL, "n_memories": 12, "n_seeds": 10, "n_actions_training": 0, "reward": figure,
        "reward_iqm": figure, "oracle_share": share, "oracle_share_iqm": share, "versus": versus,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("wide", "word"), [((0.1, 2.0), "ahead"), ((-0.1, 2.0), "open"), ((-2.0, -0.1), "behind"), ((None, None), "open")]
)
def test_only_what_would_hold_on_other_memories_is_called_ahead(wide, word):
    assert verdict(entry(0.5, 1.5, *wide)) == word


def page_of(*entries):
    base = {**entry(0, 0, 0, 0, "supervised"), "versus": None}
    rows = [
        {
            "agent": e["agent"],
            "env": MENTAL,
            "memory": "half/12",
            "n_actions": 30,
            "reward": e["reward"],
            "oracle_reward": 25.0,
        }
        for e in (base, *entries)
    ]
    results = {
        "suite": "search", "baseline": "supervised", "rows": rows, "summary": [base, *entries],
        "record": {"command": "creative-nao evaluate search", "settings": {"suite": {}}},
    }  # fmt: skip
    return " ".join(result_page({"results/search.json": results}).split())


def test_where_none_is_ahead_the_page_says_so():
    page = page_of(entry(-1.0, 1.0, -2.0, 2.0))
    assert "None of the 1 other agents demonstrably earns more than `supervised` with 30 actions on 12 memories" in page
    assert "Not distinguishable from it: `sobol`" in page


def test_where_one_is_ahead_the_page_says_by_how_much():
    page = page_of(entry(0.5, 1.5, 0.25, 1.75), entry(-1.5, -0.5, -2.0, -0.2, "bayesian"))
    assert "1 of the 2 other agents earns more than uniform sampling" in page
    assert (
        "`sobol`: +1.00 [+0.50, +1.50] in reward, +10 [+5, +15] %; with the memories drawn anew too [+0.25, +1.75]."
        in page
    )
    assert re.search(r"Behind it: - `bayesian`: -1.00", page)


@pytest.mark.slow
def test_a_result_file_holds_to_the_bit_and_only_what_is_asked_is_played(finished):
    found = verify(finished.folder / "results.json", trusted=True, n_sample=2, executor=LocalExecutor(2))
    assert found.holds
    assert found.exact
    assert [(check.agent, check.seed) for check in found.checks] == [("supervised", 0), ("ppo", 1)]
    assert all(check.found == check.published for check in found.checks)


def test_the_steps_from_rule_to_rule_to_learned_map_are_told_in_standard_errors():
    rewards = {
        "surrogate@1": [[10.0, 12.0], [13.0, 13.0]], f"{LEARNED}@1": [[13.0, 15.0], [16.0, 16.0]],
        "surrogate@2": [[10.0, 14.0], [13.0, 13.0]], f"{LEARNED}@2": [[11.0, 15.0], [13.0, 13.0]],
        "plan@2": [[13.0, 13.0], [12.0, 12.0]], f"{LEARNED}@4": [[1.0, 2.0], [3.0, 4.0]],
    }  # fmt: skip
    rows = [{"agent": name, "reward_per_seed": {"0": a, "1": b}} for name, of in rewards.items() for a, b in of]
    from_surrogate, from_plan = _steps({"rows": rows}, [1, 2, 4])
    assert (from_surrogate["before"], from_surrogate["after"]) == ("surrogate", "learned_map")
    one, two, none = from_surrogate["found"]
    assert one == {"gap": 3.0, "n_errors": pytest.approx(3.0 / (2 * 0.5**2) ** 0.5)}  # of a mean of two memories
    assert two["gap"] == 0.5
    assert none is None  # nobody to compare with
    assert from_surrogate["close"] == [2]
    assert from_plan["found"][1]["gap"] == 0.5
    assert from_plan["before"] == "plan"


class Stored:
    """An executor that gives the episodes of a finished run again without playing them."""

    n_workers = 1

    def __init__(self, finished):
        self.episodes = finished.measured.episodes

    def run(self, jobs, folder, on_progress=None):
        return {job.name: {"episodes": [dump(e) for e in self.episodes if self.is_of(e, job)]} for job in jobs}

    def is_of(self, episode, job):
        return (episode.agent, [episode.seed]) == (job.spec["agent"], job.spec["seeds"])


def test_a_published_file_can_be_verified_without_its_run_folder(published, finished):
    found = verify(published / "results" / "fake.json", trusted=True, n_sample=1, row=2, executor=Stored(finished))
    assert found.holds
    assert found.checks[0].agent == "random"


def test_a_changed_figure_does_not_hold(published, finished, tmp_path):
    results = read_results(published / "results" / "fake.json")
    row = results["rows"][0]
    row["reward_per_seed"]["0"] += 1e-9
    path = tmp_path / "changed.json"
    path.write_text(json.dumps(results))
    found = verify(path, trusted=True, n_sample=1, row=1, executor=Stored(finished))
    assert not found.holds
    assert not found.checks[0].holds


def test_a_mean_that_does_not_follow_from_its_episodes_is_told(finished):
    results = json.loads(json.dumps(finished.results))
    assert contradictions(results, "supervised", 3) == []
    results["rows"][1]["reward"]["mean"] += 0.1
    results["summary"][0]["reward_iqm"]["low"] -= 0.1
    told = contradictions(results, "supervised", 3)
    assert told[0].startswith("random in ")
    assert "the mean reward is not that of its episodes" in told[0]
    assert "`reward_iqm` of the summary does not follow from the rows" in told[1]


def test_other_versions_are_told_and_judged_by_the_tolerance(published, finished, tmp_path):
    results = read_results(published / "results" / "fake.json")
    results["record"]["versions"]["numpy"] = "1.0"
    row = results["rows"][0]
    row["reward_per_seed"]["0"] *= 1.005
    path = tmp_path / "other.json"
    path.write_text(json.dumps(results))
    found = verify(path, trusted=True, n_sample=1, row=1, executor=Stored(finished))
    assert not found.exact
    assert any(line.startswith("numpy was 1.0, now ") for line in found.differences)
    assert found.checks[0].holds


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"row": 0}, "`--row` should be between 1 and 6"),
        ({"n_sample": -1}, "`--sample` should be at least 0, but is -1"),
    ],
)
def test_what_cannot_be_verified_is_said(finished, changes, text):
    with pytest.raises(SettingsError, match=text):
        verify(finished.folder / "results.json", **changes)


def test_a_file_without_a_record_is_refused(finished, tmp_path):
    shutil.copy(finished.folder / "results.json", tmp_path)
    with pytest.raises(FileFormatError, match=r"no `record`, and no run.json beside it"):
        verify(tmp_path / "results.json")


def test_without_the_baseline_nothing_is_compared(finished, make_suite):
    suite = make_suite(agents=("random",))
    few = dataclasses.replace(
        finished.measured, episodes=tuple(e for e in finished.measured.episodes if e.agent == "random")
    )
    results = make_results(suite, few, base_seed=3)
    assert results["baseline"] is None
    assert all(found["versus"] is None for found in results["summary"])


def test_the_readme_tells_the_published_figures():
    """The table of rewards by movements looked at, and the oracle, to one digit."""
    results = json.loads((DOCS / "results" / "frontier.json").read_text(encoding="utf-8"))
    rewards = {entry["agent"]: entry["reward"]["mean"] for entry in results["summary"]}
    text = (DOCS.parent / "README.md").read_text(encoding="utf-8")
    lines = {line.split("|")[1].strip().split()[0].rstrip(":,"): line for line in text.splitlines() if "|" in line}
    named = {
        "uniform": "random", "PPO": "ppo/BoxingMental-v0", "hand": "spread_points", "surrogate": "surrogate",
        "plan": "plan",
    }  # fmt: skip
    for word, agent in named.items():
        told = [cell.strip() for cell in lines[word].split("|")[2:-1]]
        found = (rewards.get(f"{agent}@{k}") for k in (1, 2, 8, 64))
        assert told == ["" if value is None else f"{value:.1f}" for value in found]
    random = next(entry for entry in results["summary"] if entry["agent"] == "random@1")
    assert f"earns {random['regret'] + random['reward']['mean']:.1f}." in " ".join(text.split())
