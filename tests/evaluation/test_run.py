"""A whole evaluation on the fake world: what it writes, that it repeats, continues and refuses."""

import dataclasses
import json
import re
import shutil

import numpy as np
import pytest
from PIL import Image

from creative_nao.errors import FileFormatError, NotFoundError, SettingsError
from creative_nao.evaluation import report
from creative_nao.evaluation.jobs import plan
from creative_nao.evaluation.pages import MEASURED_COLUMNS, figure, markdown_table
from creative_nao.evaluation.results import MEASURED, collect, make_results, read_results
from creative_nao.evaluation.run import evaluate, input_hashes, open_folder
from creative_nao.evaluation.runner import LocalExecutor
from creative_nao.model import load_memory


def timeless(results):
    """The rows without what no run repeats."""
    return [{key: value for key, value in row.items() if not key.startswith("seconds")} for row in results["rows"]]


def strict(path):
    found = json.loads(path.read_text(encoding="utf-8"), parse_constant=lambda name: pytest.fail(f"{name} in {path}"))
    assert len(found.pop("sha256")) == 64
    return found


def test_every_agent_has_a_row_in_every_environment(finished):
    rows = [(row["agent"], row["env"].rpartition("/")[2], row["memory"]) for row in finished.results["rows"]]
    agents, envs = ("supervised", "random", "ppo"), ("Boxing-v0", "BoxingMental-v0")
    assert rows == [(agent, env, "fake/0") for env in envs for agent in agents]


def test_results_follow_the_schema(finished):
    found = strict(finished.folder / "results.json")
    assert found == finished.results
    assert found["suite"] == "fake"
    for row in found["rows"]:
        assert (row["n_seeds"], row["n_actions"]) == (2, 30)
        assert row["n_actions_training"] == (240 if row["agent"] == "ppo" else 0)
        assert row["seconds"] > 0.0
        assert sum(row["outcomes"].values()) == 60
        for field in MEASURED:
            if row[field] is None:
                assert row[f"{field}_reason"]
            else:
                assert row[field]["low"] <= row[field]["mean"] <= row[field]["high"]


def test_seeds_that_give_the_same_leave_no_interval(finished, make_suite):
    """The fake world draws nothing: an agent that draws nothing either earns the same for every seed."""
    suite = make_suite(agents=("supervised", "random"))
    kept = [e for e in finished.measured.episodes if e.agent in suite.agents]
    same = [
        dataclasses.replace(next(o for o in kept if (o.agent, o.env) == (e.agent, e.env)), seed=e.seed) for e in kept
    ]
    measured = dataclasses.replace(finished.measured, episodes=tuple(same))
    for row in make_results(suite, measured, base_seed=0)["rows"]:
        assert (row["reward"]["low"], row["reward"]["high"]) == (None, None)
        assert "the same for every seed" in row["reward_reason"]


def test_the_share_of_the_oracle_is_told_in_the_mind_and_its_absence_in_physics_explained(finished):
    for row in finished.results["rows"]:
        if "Mental" in row["env"]:
            best = sum(finished.measured.oracles["fake/0"].rewards)
            assert row["oracle_share"]["mean"] == pytest.approx(row["reward"]["mean"] / best)
            assert 0.0 < row["oracle_share"]["mean"] <= 1.0
        else:
            assert row["oracle_share"] is None
            assert "in physics it would have to perform the whole map" in row["oracle_share_reason"]


def test_everything_is_written_and_nothing_half(finished):
    names = {path.name for path in finished.folder.iterdir()}
    assert names == {
        "run.json",
        "results.json",
        "episodes.csv",
        "table.md",
        "report.html",
        "figures",
        "agents",
        "maps",
        "jobs",
    }
    for name in ("reward", "cumulative", "outcomes", "choices", "training"):
        assert (finished.folder / "figures" / f"{name}.png").stat().st_size > 5_000
        assert (finished.folder / "figures" / f"{name}.svg").stat().st_size > 5_000
    assert not list(finished.folder.rglob(".*"))


def test_the_record_makes_the_run_repeatable(finished):
    record = strict(finished.folder / "run.json")
    assert record["command"] == "creative-nao evaluate fake"
    assert record["settings"]["seed"] == 3
    assert record["settings"]["suite"]["ppo"]["n_timesteps"] == 240
    assert record["seeds"] == [0, 1]
    assert {"python", "numpy", "torch"} <= set(record["versions"])
    assert {"results.json", "episodes.csv", "report.html", "agents/ppo-fake-0-0.safetensors"} <= set(record["hashes"])


def play_again(suite, folder, seed, n_workers, wanted):
    """Episodes of the jobs that play `wanted` agents, and of what these need; each job costs the start of a process."""
    jobs = {job.name: job for job in plan(suite, base_seed=seed)}
    played = [job for job in jobs.values() if (job.spec.get("agent"), job.spec.get("seeds")) in wanted]
    chosen = [jobs[name] for job in played for name in job.needs] + played
    done = LocalExecutor(n_workers).run(chosen, folder)
    return [dataclasses.replace(episode, seconds=0.0) for episode in collect(suite, chosen, done).episodes]


def test_neither_the_number_of_workers_nor_the_grouping_of_seeds_changes_a_bit(finished, make_suite, tmp_path):
    # One agent that draws, one that is trained first; the second seed, which is played after the first elsewhere.
    suite = make_suite(seeds_per_job=1)
    alone = play_again(suite, tmp_path, seed=3, n_workers=1, wanted=[("random", [1]), ("ppo", [1])])
    together = [e for e in finished.measured.episodes if e.agent in ("random", "ppo") and e.seed == 1]
    assert alone == [dataclasses.replace(episode, seconds=0.0) for episode in together]
    bundle = "agents/ppo-fake-0-1.safetensors"
    assert (tmp_path / bundle).read_bytes() == (finished.folder / bundle).read_bytes()


def test_another_seed_is_another_run(finished, make_suite, tmp_path):
    other = play_again(make_suite(), tmp_path, seed=4, n_workers=2, wanted=[("random", [0, 1])])
    before = [episode for episode in finished.measured.episodes if episode.agent == "random"]
    assert len(other) == len(before)
    assert [episode.reward for episode in other] != [episode.reward for episode in before]


def test_a_continued_run_repeats_no_job(finished, make_suite):
    logs = sorted((finished.folder / "jobs").glob("*.log"))
    before = [path.stat().st_mtime_ns for path in logs]
    again = evaluate(make_suite(), finished.folder, seed=3, executor=LocalExecutor(1), resume=True)
    assert again.results == finished.results
    assert [path.stat().st_mtime_ns for path in logs] == before


@pytest.mark.slow
def test_a_run_that_lost_jobs_is_completed_to_the_same_end(finished, make_suite, tmp_path):
    folder = tmp_path / "torn"
    shutil.copytree(finished.folder, folder)
    (folder / "jobs" / "play-ppo-fake-0-0-1.result.json").unlink()
    (folder / "jobs" / "play-random-fake-0-0-1.result.json").write_text('{"job"')
    (folder / "episodes.csv").unlink()
    again = evaluate(make_suite(), folder, seed=3, executor=LocalExecutor(2), resume=True)
    assert timeless(again.results) == timeless(finished.results)
    assert (folder / "episodes.csv").read_bytes() == (finished.folder / "episodes.csv").read_bytes()


def test_a_folder_that_holds_something_is_refused(make_suite, tmp_path):
    (tmp_path / "mine.txt").touch()
    with pytest.raises(
        SettingsError, match=r"`--out` .* exists and is not empty; add --resume to continue it, or choose"
    ):
        evaluate(make_suite(), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_nothing_to_resume_is_said(make_suite, tmp_path):
    with pytest.raises(NotFoundError, match=r"nothing to resume in .*: it has no run.json; leave out --resume"):
        evaluate(make_suite(), tmp_path / "nowhere", resume=True)
    assert not (tmp_path / "nowhere").exists()


@pytest.mark.parametrize(
    ("changes", "seed", "text"),
    [
        ({}, 4, r"was started with seed 3, not 4"),
        ({"name": "other"}, 3, r"holds suite `fake`, not `other`; choose another folder"),
        ({"n_seeds": 5}, 3, r"was started with other settings of suite `fake` \(n_seeds\)"),
    ],
)
def test_another_run_s_folder_is_not_continued(finished, make_suite, changes, seed, text):
    with pytest.raises(SettingsError, match=text):
        evaluate(make_suite(**changes), finished.folder, seed=seed, resume=True)


def test_results_of_two_versions_are_not_mixed(finished, make_suite, tmp_path):
    folder = tmp_path / "old"
    shutil.copytree(finished.folder, folder)
    record = strict(folder / "run.json")
    record["versions"]["numpy"] = "1.0"
    (folder / "run.json").write_text(json.dumps(record))
    with pytest.raises(SettingsError, match=r"was started with numpy 1.0, now it is .*would be mixed"):
        evaluate(make_suite(), folder, seed=3, resume=True)


def test_a_memory_that_changed_is_not_mixed_with_itself(make_suite, tmp_path):
    memory = tmp_path / "memory.safetensors"
    memory.write_bytes(b"one")
    suite = make_suite(memories=(str(memory),))

    def open_again(resume=True):
        settings = {"suite": dataclasses.asdict(suite), "seed": 0}
        open_folder(tmp_path / "run", settings, inputs=input_hashes(suite), resume=resume)

    open_again(resume=False)
    open_again()
    memory.write_bytes(b"two")
    with pytest.raises(SettingsError, match=r"was started with another file .*, which has changed since"):
        open_again()


def test_a_torn_record_is_named(finished, make_suite, tmp_path):
    (tmp_path / "run.json").write_text("{torn")
    with pytest.raises(FileFormatError, match=r"record .*run.json: not JSON"):
        evaluate(make_suite(), tmp_path, resume=True)


def test_results_are_read_back_and_damage_is_named(finished, tmp_path):
    assert read_results(finished.folder / "results.json") == finished.results
    with pytest.raises(NotFoundError, match="no results at"):
        read_results(tmp_path / "results.json")
    (tmp_path / "results.json").write_text('{"suite": "fake"}')
    with pytest.raises(FileFormatError, match="`rows` is missing"):
        read_results(tmp_path / "results.json")


def test_the_report_holds_every_row_and_loads_nothing(finished):
    page = (finished.folder / "report.html").read_text(encoding="utf-8")
    for row in finished.results["rows"]:
        for column in MEASURED_COLUMNS:
            mean, interval = figure(row, column)
            assert f"<td>{mean}<small>{interval}</small></td>" in page
    assert page.count("<figure>") == 5
    assert not re.findall(r"""(?:src|href|srcset|action)\s*=\s*["'](?!data:|#)""", page)
    assert not re.findall(r"@import|url\(|<script|<link|<iframe", page)


def test_the_report_begins_with_a_sentence_and_the_rewards_then_contents_then_limits(finished):
    page = (finished.folder / "report.html").read_text(encoding="utf-8")
    parts = (
        "<h1>",
        '<p class="lead">',
        '<ul class="bars">',
        "<nav",
        "<h2",
        'id="limits"',
        'id="question"',
        'id="table"',
    )
    places = [page.index(part) for part in parts]
    assert places == sorted(places)
    (contents,) = re.findall("<nav.*?</nav>", page, re.DOTALL)
    assert re.findall('href="#(.+?)"', contents) == re.findall('<h2 id="(.+?)"', page)
    assert page.count("<h2") == page.count("<h2 id=")
    rows = sorted(
        (row for row in finished.results["rows"] if row["env"].endswith("Boxing-v0")),
        key=lambda row: -row["reward"]["mean"],
    )
    sentence = re.sub("<.+?>|\\s+", " ", re.search('<p class="lead">(.*?)</p>', page, re.DOTALL)[1])
    for told in ("taught 3 actions", "30 tries", "of 3 ways", rows[0]["agent"], f"{rows[0]['reward']['mean']:.1f}"):
        assert told in sentence
    assert sentence.strip().endswith(".")
    bars = re.search('<ul class="bars">(.*?)</ul>', page, re.DOTALL)[1]
    assert re.findall("<li><span>(.+?)</span>", bars) == [row["agent"] for row in rows]
    assert re.findall("<strong>(.+?)</strong>", bars) == [f"{row['reward']['mean']:.1f}" for row in rows]


def test_the_first_sentence_tells_what_seeds_leave_open_and_the_baseline_is_always_shown(finished, make_suite):
    def told(*rewards):
        summary = [
            {
                "agent": f"a{place}",
                "env": make_suite().envs[0],
                "reward": dict(zip(("mean", "low", "high"), reward, strict=True)),
            }
            for place, reward in enumerate(rewards)
        ]
        return report.first_figure(make_suite(), {"summary": summary, "baseline": "a0"})

    many = told(*((float(place), place - 1.5, place + 1.5) for place in range(9)))
    assert [entry["agent"] for entry in many["shown"]] == ["a8", "a7", "a6", "a5", "a4", "a0"]
    assert (many["level"], many["n_agents"], many["full"]) == (["a7", "a6", "a5"], 9, 9.5)
    same = told((1.0, None, None), (2.0, None, None), (3.0, 1.5, 4.0))  # two agents that draw nothing
    assert (same["level"], same["full"]) == (["a1"], 4.0)
    nothing = told((0.0, None, None))
    assert (nothing["level"], nothing["full"]) == ([], 1.0)


def test_the_report_shows_a_find_as_poses_of_the_robot(finished, make_suite, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "load_memory", lambda _: load_memory("half/0"))
    monkeypatch.setattr(report, "N_FINDS", 1)
    monkeypatch.setattr(report, "SIZE_PX", (68, 76))
    (find,) = found = report._draw_finds(tmp_path, make_suite(), finished.results, finished.measured)
    usable = [a.reward for a in finished.measured.of("fake/0", make_suite().envs[0], find["agent"])[0].actions]
    assert find["action"].reward == max(usable)
    monkeypatch.setattr(report, "draw_figures", lambda *_: found)
    shutil.copytree(finished.folder / "maps", tmp_path / "maps")
    page = report.write_report(tmp_path, make_suite(), finished.results, finished.measured, finished.record).read_text()
    assert page.index('class="find"') < page.index("<nav")
    poses = np.asarray(Image.open(find["path"]).convert("RGB"))
    height, width = report.SIZE_PX[1] + 4, report.SIZE_PX[0] + 4
    assert poses.shape == (2 * height, 4 * width, 3)
    tiles = poses.reshape(2, height, 4, width, 3).transpose(0, 2, 1, 3, 4).reshape(8, -1)
    assert len({tile.tobytes() for tile in tiles}) == 8  # no pose twice


def test_the_report_says_what_does_not_hold_and_how_to_repeat_it(finished):
    page = (finished.folder / "report.html").read_text(encoding="utf-8")
    for text in (
        "judged on the very memory it was trained on",
        "2 seeds are few",
        "creative-nao evaluate fake",
        "numpy",
    ):
        assert text in page


def test_names_from_outside_cannot_become_markup(make_suite, finished, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "draw_figures", lambda *_: [])
    record = {**finished.record, "command": "creative-nao <script>alert(1)</script>"}
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "fake-0.npz").write_bytes((finished.folder / "maps" / "fake-0.npz").read_bytes())
    path = report.write_report(tmp_path, make_suite(), finished.results, finished.measured, record)
    page = path.read_text(encoding="utf-8")
    assert "<script>" not in page


def test_the_markdown_table_has_a_line_per_row(finished):
    lines = markdown_table(finished.results).splitlines()
    assert len(lines) == 2 + len(finished.results["rows"])
    assert len({line.count("|") for line in lines}) == 1
