"""The command: refusals in one line, Ctrl-C with a way to go on, figures on stdout alone."""

import json

import pytest

from creative_nao.cli import evaluate as command
from creative_nao.errors import NotFoundError, SettingsError
from creative_nao.evaluation.run import Evaluation
from creative_nao.evaluation.runner import Progress

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
    "seconds": 0.5,
    "seconds_training": 0.0,
}


@pytest.fixture
def evaluated(monkeypatch):
    """Replace the evaluation by one that is done at once; return what it was asked for."""
    asked = {}

    def evaluate(suite, folder, **options):
        asked.update(suite=suite.name, folder=folder, **options)
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


def test_progress_without_a_terminal_is_lines_with_the_time_left(evaluated, tmp_path, capsys):
    command.run(command.EvaluateSettings(out=tmp_path))
    assert "1 of 2 jobs done, about 1 min 15 s left, now: judge random, seed 0" in capsys.readouterr().err


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
    assert f"continue with: creative-nao evaluate quick --out {tmp_path} --seed 5 --resume" in said


@pytest.mark.parametrize(
    ("settings", "error", "text"),
    [
        ({"suite": "quik"}, NotFoundError, r"no suite `quik` \(did you mean `quick`\?\)"),
        ({"resume": True}, SettingsError, "--resume continues a run folder: name it with --out"),
        ({"n_workers": 0}, SettingsError, "`--n-workers` should be at least 1, but is 0"),
        ({"seed": -1}, SettingsError, "`--seed` should be at least 0, but is -1"),
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
