"""A module is imported only if the user typed its name or says `--trust`; nothing is imported from a strange folder."""

import ast
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from victims import ENV

import creative_nao
from creative_nao.agents import make_agent
from creative_nao.cli import main
from creative_nao.errors import CreativeNaoError, NotFoundError, SettingsError
from creative_nao.evaluation.jobs import Job
from creative_nao.evaluation.runner import do_job
from creative_nao.evaluation.suites import read_suite
from creative_nao.evaluation.verification import verify
from creative_nao.robot import opengl
from creative_nao.runtime import python_command

PACKAGE = Path(creative_nao.__file__).parent
MODULE = """
import os, pathlib
pathlib.Path(os.path.dirname(os.path.abspath(__file__)), "ran").touch()
def agent():
    return lambda seen: [0, 0]
"""
IMPORTED = ("numpy", "mujoco", "torch", "gymnasium", "numba", "pydantic", "yaml", "creative_nao", "tbb", "six")
NAMED = {
    "agents": {"agents": ["random", "{name}:agent"]},
    "envs": {"envs": ["{name}:X-v0"]},
    "training_env": {"training_env": "{name}:X-v0"},
    "oracle_envs": {"oracle_envs": ["{name}:X-v0"]},
}
SUITE = {"agents": ["random"], "envs": [ENV], "memories": ["half/0"], "n_seeds": 1, "n_actions": 1}


@pytest.fixture(params=["in the current folder", "installed"])
def intruder(request, tmp_path, monkeypatch):
    """A module that leaves a file behind when it is imported, and files that pretend to be what a name names."""
    name = f"intruder_{request.param[:2]}"
    home = tmp_path / "site"
    home.mkdir()
    monkeypatch.chdir(tmp_path)
    if request.param == "installed":
        monkeypatch.syspath_prepend(home)
    place = home if request.param == "installed" else tmp_path
    (place / f"{name}.py").write_text(MODULE)
    for beside in (f"{name}:agent", f"{name}:X-v0"):
        (tmp_path / beside).write_bytes(b"")
    before = list(sys.path)
    yield name, place / "ran"
    sys.modules.pop(name, None)
    sys.path[:] = before


def suite_naming(field, name):
    return {**SUITE, **json.loads(json.dumps(NAMED[field]).replace("{name}", name))}


@pytest.mark.parametrize("field", NAMED)
def test_a_file_of_a_module_s_name_gives_no_trust(field, intruder, tmp_path, attempt, victims):
    attempt("suites and results", f"`{field}` names a module; a file of that name lies beside", "refused")
    name, ran = intruder
    values = suite_naming(field, name)
    path = tmp_path / "harmless.toml"
    path.write_text("\n".join(f"{key} = {json.dumps(value)}" for key, value in values.items()))
    with pytest.raises(SettingsError, match=f"`{name}:.*` is a module that would be imported .* add --trust"):
        read_suite(path)
    assert main(["evaluate", str(path), "--out", str(tmp_path / "run")]) == 2

    content = json.loads(victims["results"].path.read_text())
    content.pop("sha256")  # as a stranger would
    settings = {"suite": {"name": "quick", **values}, "seed": 0}
    content["record"] = {"settings": settings, "versions": {}, "memories": {}, "command": "x"}
    (tmp_path / "results.json").write_text(json.dumps(content))
    with pytest.raises(SettingsError, match="is a module that would be imported"):
        verify(tmp_path / "results.json")
    assert main(["evaluate", "verify", str(tmp_path / "results.json")]) == 2
    assert not ran.exists()
    assert name not in sys.modules


def test_a_result_file_makes_no_environment_of_others(tmp_path, attempt, victims):
    attempt("suites and results", "an environment that another package registers", "refused")
    content = json.loads(victims["results"].path.read_text())
    content.pop("sha256")  # as a stranger would
    settings = {"suite": {"name": "quick", **SUITE, "envs": ["CartPole-v1"]}, "seed": 0}
    content["record"] = {"settings": settings, "versions": {}, "memories": {}, "command": "x"}
    (tmp_path / "results.json").write_text(json.dumps(content))
    with pytest.raises(NotFoundError, match="no environment `CartPole-v1`"):
        verify(tmp_path / "results.json")


def test_a_name_that_is_typed_is_trusted_whatever_file_lies_beside(intruder, capsys):
    name, ran = intruder
    assert make_agent(f"{name}:agent").name == f"{name}:agent"
    assert ran.exists()
    assert main(["agent", "run", f"./{name}:agent"]) == 2
    assert "agent bundle" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["empty", "agents.toml", "random.py", "half/0"])
def test_a_file_is_a_bundle_only_if_it_reads_as_one(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text(MODULE)
    with pytest.raises(CreativeNaoError, match="agent bundle"):
        make_agent(name)
    assert not (tmp_path / "ran").exists()


@pytest.fixture
def strange_folder(tmp_path, monkeypatch):
    """A folder with a module of the name of everything that is imported; the package is found elsewhere."""
    for name in IMPORTED:
        (tmp_path / f"{name}.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.environ.get("PYTHONPATH", "").strip(os.pathsep) or str(PACKAGE.parent))
    return tmp_path


@pytest.fixture
def empty_part(strange_folder, monkeypatch):
    """An empty part of PYTHONPATH, as `PYTHONPATH=/mine:$PYTHONPATH` leaves it, means the current folder."""
    monkeypatch.setenv("PYTHONPATH", os.environ["PYTHONPATH"] + os.pathsep)


def test_a_worker_imports_nothing_from_the_folder_it_starts_in(strange_folder, empty_part, attempt):
    """As on this machine and on a worker of Dask, whose `do_job` starts the same process."""
    attempt("jobs", "modules such as numpy.py lie in the current folder", "not imported")
    spec = {
        "agent": "random", "envs": [ENV], "memories": [{"name": "half/0", "file": None}], "seeds": [0],
        "base_seed": 0, "n_actions": 1, "bundles": [],
    }  # fmt: skip
    done = do_job({"name": "a", "kind": "play", "title": "a", "spec": spec}, {})
    assert len(done["result"]["episodes"]) == 1
    assert not (strange_folder / "ran").exists()
    assert isinstance(Job(name="a", kind="play", title="a", spec=spec), Job)


def test_a_probe_imports_nothing_from_the_folder_it_starts_in(strange_folder, empty_part, attempt, monkeypatch):
    attempt("doctor", "mujoco.py lies in the current folder", "not imported", n=len(opengl.ON))
    monkeypatch.setattr(opengl, "_missing", lambda backend: "")
    for name in opengl.ON:
        opengl.probe(name)
    assert not (strange_folder / "ran").exists()


@pytest.mark.slow
@pytest.mark.parametrize("start", ["command", "python -m"])
@pytest.mark.parametrize("words", [["doctor"], ["memories"]])
def test_a_command_imports_nothing_from_the_current_folder(start, words, strange_folder, attempt):
    attempt("commands", f"{start}: modules such as numpy.py lie in the current folder", "not imported")
    (strange_folder / "creative_nao.py").unlink()  # which `python -m creative_nao` would run, by Python's own rule
    program = ["-m", "creative_nao"] if start == "python -m" else ["-P", "-m", "creative_nao"]
    done = subprocess.run([sys.executable, *program, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not (strange_folder / "ran").exists()


@pytest.mark.slow
def test_a_child_runs_the_very_package_that_starts_it(tmp_path):
    (tmp_path / "creative_nao").mkdir()
    (tmp_path / "creative_nao" / "__init__.py").write_text("raise SystemExit(3)")
    command = python_command("creative_nao.evaluation.job_handlers", tmp_path / "none.json", tmp_path)
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
    )
    assert done.returncode == 1
    assert "no job file" in done.stderr or "none.json" in done.stderr


def test_every_interpreter_is_started_without_the_current_folder():
    """Wherever the package starts a process: by `python_command`, or with -P in its own list of words."""
    starts = []
    starting = r"multiprocessing\.(?!parent_process)|from multiprocessing|ProcessPool|shell=True"
    starting += r"|os\.(exec|spawn|fork|popen|system)\("
    for path in PACKAGE.rglob("*.py"):
        source = path.read_text(encoding="utf-8")
        assert not re.search(starting, source), path
        for node in ast.walk(ast.parse(source)) if "sys.executable" in source else ():
            if isinstance(node, ast.List) and node.elts and ast.unparse(node.elts[0]) == "sys.executable":
                starts.append(ast.unparse(node.elts[1]))
    assert starts
    assert set(starts) == {"'-P'"}
