"""What the documents tell is true: their Python runs, their files exist, their commands are known."""

import contextlib
import importlib.util
import io
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

from creative_nao.cli.dispatch import COMMANDS, main

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
FILES = {".csv", ".safetensors", ".npz", ".motion", ".py", ".json", ".yaml"}
IN_ARCHIVE = (ROOT / "PKG-INFO").is_file()
"""Whether these are the tests of a source archive, which leaves the films out."""
TEXTS = {page.relative_to(ROOT).as_posix(): page.read_text(encoding="utf-8") for page in PAGES}


def blocks(language):
    for name, text in TEXTS.items():
        for number, block in enumerate(re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)):
            yield pytest.param(block, id=f"{name}-{number}")


@pytest.mark.parametrize("block", [*blocks("python")])
def test_python_blocks_run(block, tmp_path, monkeypatch):
    """Each block alone, with names of its own; the nightly test starts an interpreter for each."""
    monkeypatch.chdir(tmp_path)
    exec(compile(block, "block", "exec"), {"__name__": "__main__"})


@pytest.mark.slow
@pytest.mark.parametrize("block", [*blocks("python")])
def test_python_blocks_run_in_a_fresh_interpreter(block, tmp_path):
    subprocess.run(
        [sys.executable, "-W", "error::DeprecationWarning:creative_nao", "-c", block], check=True, cwd=tmp_path
    )


def lines(text):
    """Return the commands of a page's shell blocks, one by one, in order."""
    for block in re.findall(r"```sh\n(.*?)```", text, re.DOTALL):
        for line in block.splitlines():
            yield from (part.strip() for part in re.split(r"&&|#", line) if part.strip())


def commands(program):
    for name, text in TEXTS.items():
        for line in lines(text):
            if line.startswith(program):
                yield pytest.param(shlex.split(line)[1:], id=f"{name}: {line}")


@cache
def help_of(command):
    with contextlib.redirect_stdout(io.StringIO()) as told:
        assert main([*command.split(), "--help"]) == 0
    return told.getvalue()


@pytest.mark.parametrize("words", [*commands("creative-nao")])
def test_commands_in_the_documents_have_known_options(words):
    """The long ones are run elsewhere (tests/cli, tests/evaluation); here every flag must be one that --help tells."""
    command = " ".join(words[:2]) if " ".join(words[:2]) in COMMANDS else words[0]
    assert command in COMMANDS
    for flag in (word for word in words if word.startswith("--")):
        assert flag in help_of(command)


@pytest.mark.parametrize("words", [*commands("python ")])
def test_programs_in_the_documents_are_there_and_have_known_options(words):
    """Examples are run by tests/test_examples.py; benchmarks and page makers by those who publish their figures."""
    if words[0] == "-m":
        assert importlib.util.find_spec(words[1])
        assert all((ROOT / word.partition("=")[2]).is_file() for word in words[2:])
        return
    assert (ROOT / words[0]).is_file()
    source = (ROOT / words[0]).read_text(encoding="utf-8")
    for flag in (word for word in words if word.startswith("--")):
        argument = flag.removeprefix("--").replace("-", "_")
        assert f'"{flag}"' in source or re.search(rf"\b{argument}: ", source)  # by argparse, or by tyro


def is_cheap(words, folder):
    """Whether a command takes seconds, and every file that it reads is there."""
    if words[0] not in {"memories", "score", "export", "infer"} or words[-1].endswith((".gif", ".mp4")):
        return False
    read = [word for before, word in pairwise(words) if before != "--out" and Path(word).suffix in FILES]
    return all((folder / word).exists() for word in read)


@pytest.mark.parametrize("name", TEXTS)
def test_the_cheap_commands_of_a_page_run_in_their_order(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for line in lines(TEXTS[name]):
        words = shlex.split(line)
        if line.startswith("creative-nao") and is_cheap(words[1:], tmp_path):
            assert main(words[1:]) == 0, f"{line}: {capsys.readouterr().err}"
        elif line.startswith("python examples/02"):
            monkeypatch.setattr(sys, "argv", [str(ROOT / words[1]), *words[2:]])
            runpy.run_path(str(ROOT / words[1]), run_name="__main__")


def typed(page):
    """Return what a reader of a page types, in order: a command, or the file `name` of a block of Python before it."""
    for language, block in re.findall(r"```(sh|python)\n(.*?)```", TEXTS[page], re.DOTALL):
        if language == "python":
            yield block
        else:
            yield from (shlex.split(line) for line in lines(f"```sh\n{block}```"))


QUICK = {"01_make_env", "02_teach_your_own_actions", "03_train_a_memory", "06_put_an_action_on_a_nao", "score"}
"""What of the tutorials takes seconds; the nightly test runs all."""


def tutorial(folder, run):
    """Run everything of the tutorials in `folder` as a reader does, each block of Python saved as my_policy.py."""
    shutil.copytree(ROOT / "examples", folder / "examples")
    n_run = 0
    for step in typed("docs/tutorials.md"):
        if isinstance(step, str):
            (folder / "my_policy.py").write_text(step)
        else:
            n_run += run(step)
    return n_run


def test_the_quick_tutorials_run_as_they_stand(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    def run(words):
        if words[0] == "python" and Path(words[1]).stem in QUICK:
            monkeypatch.setattr(sys, "argv", words[1:])
            runpy.run_path(words[1], run_name="__main__")
        elif words[1] in QUICK:
            assert main(words[1:]) == 0, capsys.readouterr().err
        else:
            return 0
        return 1

    assert tutorial(tmp_path, run) == len(QUICK)
    told = capsys.readouterr().out
    assert re.search(r"left_wave +PB .* DTW distance [0-2]\.", told), "both waves are learned"


@pytest.mark.slow
def test_every_tutorial_runs_as_it_stands(tmp_path):
    """In one folder and in order, by the installed programs; a suite of hours is begun and stopped."""
    programs = {"python": [sys.executable], "creative-nao": [sys.executable, "-m", "creative_nao"]}
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}

    def run(words):
        command = [*programs[words[0]], *words[1:]]
        hours = words[1:3] == ["evaluate", "search"]
        if hours:  # with one memory and few actions, by the name that the next line takes
            (tmp_path / "search.toml").write_text(
                'agents = ["supervised", "random"]\nenvs = ["CreativeNao/BoxingMental-v0"]\nmemories = ["half/10"]\n'
                'n_seeds = 2\nn_actions = 30\nresolution = 20\nname = "search"\n'
            )
            command[command.index("search")] = "search.toml"
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{shlex.join(words)}: {done.stderr}"
        return 1

    assert tutorial(tmp_path, run) == sum(isinstance(step, list) for step in typed("docs/tutorials.md"))


def test_the_first_commands_of_the_readme_are_those_that_are_tested():
    shells = re.findall(r"```sh\n(.*?)```", TEXTS["README.md"], re.DOTALL)

    assert shells[:3] == [
        "pip install -e . && creative-nao evaluate quick\n", 'pip install -e ".[explore]" && creative-nao explore\n',
        'pip install -e ".[dev]" && pytest\n',
    ]  # fmt: skip
    assert shells[2].strip() in (ROOT / ".ci" / "run").read_text()


@pytest.mark.parametrize("name", TEXTS)
def test_links_and_file_names_lead_somewhere(name):
    page = ROOT / name
    for target in re.findall(r"\]\((?!https?://)([^)#]+)\)", TEXTS[name]):
        assert (page.parent / target).exists() or (IN_ARCHIVE and target.endswith(".gif")), target
    for path in re.findall(r"`((?:[a-z_]+/)+[a-z_]+\.py)`", TEXTS[name]):
        assert (ROOT / path).exists() or (ROOT / "creative_nao" / path).exists(), path


def test_every_command_is_in_the_readme():
    for name in COMMANDS:
        assert f"| `creative-nao {name}` |" in TEXTS["README.md"]


def test_every_environment_is_documented():
    from creative_nao.envs import ENVIRONMENTS

    assert all(name in TEXTS["README.md"] for name in ENVIRONMENTS)


def test_every_page_and_example_is_in_the_contents():
    contents = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    for page in (ROOT / "docs").glob("*.md"):
        assert f": {page.name}\n" in contents, f"add {page.name} to `nav` in mkdocs.yml"
    for example in (ROOT / "examples").glob("*.*"):
        assert f"`examples/{example.name}`" in TEXTS["docs/tutorials.md"], example.name


def test_the_site_is_built_without_a_warning(tmp_path):
    pytest.importorskip("zensical", reason="the site is built with the extra `docs`")
    shutil.copytree(ROOT / "docs", tmp_path / "docs")
    shutil.copy(ROOT / "mkdocs.yml", tmp_path)
    result = subprocess.run(
        [sys.executable, "-m", "zensical", "build", "--strict"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip

    assert result.returncode == 0, result.stdout + result.stderr
    assert (tmp_path / "site" / "index.html").is_file()


@pytest.mark.parametrize(("walk", "most"), [("One PB value, from", 10), ("One recording, from", 40)])
def test_a_walk_through_the_code_enters_few_files(walk, most):
    (section,) = re.findall(rf"## {walk}.*?(?=\n## )", TEXTS["docs/architecture.md"], re.DOTALL)
    entered = set(re.findall(r"`((?:[a-z_]+/)+[a-z_]+\.py)`", section))
    assert 5 <= len(entered - {"envs/vector_env.py", "envs/rollout.py"}) <= most
    assert all((ROOT / "creative_nao" / path).is_file() for path in entered)
