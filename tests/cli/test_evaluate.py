"""The command: refusals in one line, Ctrl-C with a way to go on, figures on stdout alone."""

import dataclasses
import json
from pathlib import Path

import pytest

from creative_nao.cli import evaluate as command
from creative_nao.cli import terminal
from creative_nao.errors import NotFoundError, SettingsError
from creative_nao.evaluation.run import Evaluation
from creative_nao.evaluation.runner import Progress
from creative_nao.evaluation.verification import Check, Verification

ROW = {
    "agent": "random",
    "env": "CreativeNao/BoxingMental-v0",
    "memory": "half/0",
    "n_seeds": 2,
    "n_actions": 30,
    "appropriateness_pct": {"mean": 81.25, "low": 80.0, "high": 82.5},
    "novelty": None,
    "novelty_reason": "no appropriate action to measure",
    "diversity": {"mean": 40.0, "low": 39.0, "high": 41.0},
    "reward": {"mean": 7.25, "low": 7.0, "high": 7.5},
    "oracle_share": {"mean": 0.375, "low": 0.3, "high": 0.4},
    "n_actions_training": 0,
    "n_imagined": 0,
    **dict.fromkeys(("best", "coverage_pct", "regret", "refused_pct")),
    "track": "told",
    "seconds": 0.5,
    "seconds_training": 0.0,
}


@pytest.fixture
def evaluated(monkeypatch):
    """Replace the evaluation by one that is done at once; return what it was asked for."""
    asked = {}

    def evaluate(suite, folder, **options):
        asked.update(suite=suite.name, agents=suite.agents, folder=folder, **options)
        for done in (0, 1):
            options["on_progress"](Progress(done, 2, done / 2, ("judge random, seed 0",), 75.0))
        return Evaluation(folder, {"suite": suite.name, "rows": [ROW]}, None, {})

    monkeypatch.setattr(command, "evaluate", evaluate)
    return asked


def test_the_table_and_the_paths_end_it(evaluated, tmp_path, capsys):
    assert command.run(command.EvaluateSettings(out=tmp_path)) == 0
    out = capsys.readouterr().out
    for text in (
        "random",
        "mental",
        "81.2",
        "[80.0, 82.5]",
        "\N{EN DASH}",
        "7.25",
        "37.5",
        str(tmp_path / "report.html"),
    ):
        assert text in out


def test_progress_without_a_terminal_is_lines_with_the_time_left(evaluated, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(terminal, "PLAIN_EVERY_S", 0.0)
    command.run(command.EvaluateSettings(out=tmp_path))
    assert "jobs: 0/2, now: judge random, seed 0; about 1 min 15 s left" in capsys.readouterr().err


def test_json_leaves_stdout_to_the_figures(evaluated, tmp_path, capsys):
    command.run(command.EvaluateSettings(out=tmp_path, json=True))
    captured = capsys.readouterr()
    assert json.loads(captured.out) == {"suite": "quick", "rows": [ROW]}
    assert "report.html" in captured.err


def test_without_out_the_folder_is_named_after_suite_and_time(evaluated, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command.run(command.EvaluateSettings())
    assert evaluated["folder"].parts[0] == "runs"
    assert evaluated["folder"].name.startswith("quick-2")


def test_the_recorded_command_repeats_the_run(evaluated, tmp_path):
    command.run(command.EvaluateSettings(out=tmp_path, seed=7))
    assert evaluated["command"] == "creative-nao evaluate quick --seed 7"


def test_ctrl_c_says_how_to_go_on(monkeypatch, tmp_path, capsys):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "evaluate", interrupted)
    assert command.run(command.EvaluateSettings(out=tmp_path, seed=5)) == 130
    said = capsys.readouterr().err
    assert f"continue with: creative-nao evaluate quick --seed 5 --out {tmp_path} --resume" in said


@pytest.mark.parametrize(
    ("settings", "error", "text"),
    [
        ({"suite": "quik"}, NotFoundError, r"no suite `quik` \(did you mean `quick`\?\)"),
        ({"resume": True}, SettingsError, "--resume continues a run folder: name it with --out"),
        ({"n_workers": 0}, SettingsError, "`--n-workers` should be at least 1, but is 0"),
        ({"seed": -1}, SettingsError, "`--seed` should be at least 0, but is -1"),
        ({"agents": "randon"}, NotFoundError, r"no agent `randon` \(did you mean `random`\?\)"),
        ({"agents": "random,random"}, SettingsError, "`agents` should be a list that has `random` only once"),
        ({"agents": " , "}, SettingsError, "`agents` should be a list of at least 1 entries"),
        ({"demonstrations": Path("x")}, SettingsError, r"`quick` has no \[taught\]"),
        (
            {"suite": "transfer", "demonstrations": (Path("nowhere"),)},
            NotFoundError,
            "no folder of basic actions at nowhere",
        ),
        ({"scheduler": "tcp://x:1", "n_workers": 2}, SettingsError, "`--n-workers` counts processes of this machine"),
    ],
)
def test_mistakes_are_told_before_anything_starts(settings, error, text):
    with pytest.raises(error, match=text):
        command.run(command.EvaluateSettings(**settings))


def test_a_folder_with_something_in_it_is_refused(tmp_path):
    (tmp_path / "mine.txt").touch()
    with pytest.raises(SettingsError, match="exists and is not empty"):
        command.run(command.EvaluateSettings(out=tmp_path))


def test_the_flags_are_made_from_the_settings():
    import tyro

    found = tyro.cli(
        command.EvaluateSettings, args=["quick", "--seed", "3", "--n-workers", "2", "--resume", "--out", "x"]
    )
    assert (found.suite, found.seed, found.n_workers, found.resume, str(found.out)) == ("quick", 3, 2, True, "x")
    assert tyro.cli(command.EvaluateSettings, args=[]).suite == "quick"


def test_only_the_agents_asked_for_take_part_and_the_record_says_so(evaluated, tmp_path):
    command.run(command.EvaluateSettings(out=tmp_path, agents="supervised, random"))
    assert evaluated["agents"] == ("supervised", "random")
    assert evaluated["command"] == "creative-nao evaluate quick --seed 0 --agents 'supervised, random'"


def test_a_suite_of_one_s_own_is_a_file(evaluated, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('agents = ["random"]\nenvs = ["CreativeNao/BoxingMental-v0"]\nmemories = ["half/0"]\n')
    assert command.run(command.EvaluateSettings(suite=str(path), out=tmp_path / "run")) == 0
    assert evaluated["suite"] == "mine"


def verification(holds):
    check = Check("random", "CreativeNao/BoxingMental-v0", "half/0", 3, 7.25, 7.25 if holds else 7.5, holds)
    return Verification((check,), (), () if holds else ("random in x: the mean reward is not that of its episodes",))


@pytest.mark.parametrize(("holds", "code", "said"), [(True, 0, "holds to the bit"), (False, 1, "does NOT hold: 2 of")])
def test_verify_says_whether_a_file_holds_by_its_exit_code_too(monkeypatch, capsys, holds, code, said):
    monkeypatch.setattr(command, "verify", lambda *_, **__: verification(holds))
    settings = command.VerifySettings(Path("results.json"))
    assert command.run(settings) == code
    assert said in capsys.readouterr().out
    assert command.run(dataclasses.replace(settings, json=True)) == code
    assert json.loads(capsys.readouterr().out)["holds"] is holds


def test_a_leaderboard_of_nothing_is_refused():
    with pytest.raises(SettingsError, match="leaderboard: name run folders"):
        command.run(command.LeaderboardSettings())
