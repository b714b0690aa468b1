"""`creative-nao evaluate paper` on the command line: what it asks for, refuses and prints."""

import json

import pytest

from creative_nao.cli import evaluate_paper
from creative_nao.errors import SettingsError
from creative_nao.evaluation.paper.run import Reproduction

FIELDS = ("unlearned_pct", "learned_pct", "appropriateness_pct", "novelty", "diversity", "fluctuating_pct")
ROWS = [
    {
        "memory": condition,
        "n_seeds": 4,
        **{key: {"mean": 21.5, "low": 20.25, "high": 23.0} for key in FIELDS},
        "non_moving_pct": None,
    }
    for condition in ("open", "half", "closed")
]
CLAIMS = [{"says": "Half closed training makes the most novel actions.", "verdict": "does not hold"}]


@pytest.fixture
def asked(monkeypatch):
    """Replace the reproduction by one that is done at once; return what it was asked for."""
    found = {}

    def reproduce(settings, folder, **options):
        found.update(settings=settings, folder=folder, **options)
        with options["watch"]({"one": 2}) as report:
            report("one", 2, "note")
        return Reproduction(folder, {"suite": "paper", "rows": ROWS}, CLAIMS)

    monkeypatch.setattr(evaluate_paper, "reproduce", reproduce)
    return found


def run(**settings):
    return evaluate_paper.run(evaluate_paper.PaperOptions(**settings))


def test_the_paper_and_ours_stand_side_by_side(asked, tmp_path, capsys):
    assert run(out=tmp_path / "x") == 0
    out = capsys.readouterr().out
    for text in ("31.71", "21.5 [20.2, 23.0]", "most novel actions", "does not hold", "4 / 4 / 4 networks"):
        assert text in out
    assert asked["settings"].source == "shipped"


def test_flags_reach_the_reproduction(asked, tmp_path):
    run(out=tmp_path, retrain=True, seed=3, n_workers=1, resume=True)
    assert (asked["settings"].source, asked["settings"].seed, asked["n_workers"]) == ("retrain", 3, 1)
    assert (asked["resume"],) == (True,)
    assert asked["command"] == "creative-nao evaluate paper --retrain --seed 3"


def test_json_is_the_results_with_the_verdicts(asked, tmp_path, capsys):
    run(out=tmp_path, json=True)
    assert json.loads(capsys.readouterr().out) == {"suite": "paper", "rows": ROWS, "claims": CLAIMS}


def test_ctrl_c_says_how_to_go_on(monkeypatch, tmp_path, capsys):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(evaluate_paper, "reproduce", interrupted)
    assert run(out=tmp_path, quick=True) == 130
    said = capsys.readouterr().err
    assert f"continue with: creative-nao evaluate paper --quick --seed 0 --out {tmp_path} --resume" in said


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"quick": True, "retrain": True}, "--quick trains its own few networks"),
        ({"resume": True}, "--resume continues a run folder"),
        ({"n_workers": 0}, "`--n-workers` should be at least 1, but is 0"),
        ({"seed": -1}, "`--seed` should be at least 0, but is -1"),
    ],
)
def test_mistakes_are_told_before_anything_starts(settings, text):
    with pytest.raises(SettingsError, match=text):
        run(**settings)
