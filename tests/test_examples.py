"""The programs of the tutorials run, shortened by their own options, and say what they should."""

import base64
import json
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


NOTEBOOK = EXAMPLES / "08_in_a_notebook.ipynb"


def test_the_notebook_is_committed_without_outputs_and_its_cells_are_python():
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert len(cells) >= 6
    for cell in cells:
        assert cell["outputs"] == []
        assert cell["execution_count"] is None
        compile("".join(cell["source"]), "cell", "exec")


@pytest.mark.slow
def test_the_notebook_shows_map_curves_robot_and_explorer(tmp_path, monkeypatch):
    """A Jupyter kernel of its own runs it from the first cell to the last."""
    import nbclient
    import nbformat

    monkeypatch.setenv("PYTHONPATH", str(EXAMPLES.parent))
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbclient.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()

    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert not [output for output in outputs if output.get("name") == "stderr"]
    shown = [output.data for output in outputs if output.output_type == "execute_result"]
    assert ["image/png" in data for data in shown] == [False, True, True, True, False, False]
    assert "data:image/png;base64" in shown[0]["text/html"]  # the memory with its map
    assert base64.b64decode(shown[4]["image/gif"])[:6] == b"GIF89a"
    assert "srcdoc=" in shown[5]["text/html"]
    assert any("rad from it" in output.text for output in outputs if output.output_type == "stream")
    assert not list(tmp_path.iterdir())  # nothing is left where it was opened


def test_every_example_is_tested():
    assert sorted(SHORT) == sorted(path.stem for path in EXAMPLES.glob("[0-9]*.py"))  # `my_surrogate` is an agent
