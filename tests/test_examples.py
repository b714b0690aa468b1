"""The programs of the tutorials run, shortened by their own options, and say what they should."""

import os
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from test_docs import QUICK

EXAMPLES = Path(__file__).parents[1] / "examples"
SHORT = {
    "01_make_env": ("--env CreativeNao/BoxingMental-v0 --n-steps 30", "novelty "),
    "02_teach_your_own_actions": ("--out actions", "left_wave: 51 postures"),
    "03_train_a_memory": ("--n-epochs 200 --resolution 8 --out mine.safetensors", "unlearned"),
    "04_search_with_sb3": ("--n-steps 480 --n-episodes 2 --out policy.zip", "PPO"),
    "05_evaluate_your_own_agent": (
        "--n-seeds 2 --memories half/12 --env CreativeNao/BoxingMental-v0",
        "far-from-tried",
    ),
    "06_put_an_action_on_a_nao": ("--pb 0.3 -0.1 --out new_action.py", "s for the robot"),
    "07_memory_of_another_robot": ("--n-epochs 100", "reward"),
}


@pytest.mark.parametrize("name", [name for name in SHORT if name not in QUICK])
def test_the_example_runs(name, tmp_path, monkeypatch, capsys):
    """The others run as the tutorials stand (test_docs.py)."""
    options, said = SHORT[name]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(EXAMPLES / f"{name}.py"), *options.split()])
    runpy.run_path(sys.argv[0], run_name="__main__")

    assert said in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("name", SHORT)
def test_the_example_runs_in_a_fresh_interpreter(name, tmp_path):
    options, said = SHORT[name]
    result = subprocess.run(
        [sys.executable, "-W", "error::DeprecationWarning:__main__", EXAMPLES / f"{name}.py", *options.split()],
        cwd=tmp_path, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(EXAMPLES.parent)},
    )  # fmt: skip

    assert result.returncode == 0, result.stderr
    assert said in result.stdout


def test_every_example_is_tested():
    assert sorted(SHORT) == sorted(path.stem for path in EXAMPLES.glob("[0-9]*.py"))  # `my_surrogate` is an agent
