"""What the documents tell is true: their Python runs, their files exist, their commands are known."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from creative_nao.cli.dispatch import COMMANDS

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
TEXTS = {page.relative_to(ROOT).as_posix(): page.read_text(encoding="utf-8") for page in PAGES}


def blocks(language):
    for name, text in TEXTS.items():
        for number, block in enumerate(re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)):
            yield pytest.param(block, id=f"{name}-{number}")


@pytest.mark.parametrize("block", [*blocks("python")])
def test_python_blocks_run(block, tmp_path):
    subprocess.run(
        [sys.executable, "-W", "error::DeprecationWarning:creative_nao", "-c", block], check=True, cwd=tmp_path
    )


def commands():
    for name, text in TEXTS.items():
        for block in re.findall(r"```sh\n(.*?)```", text, re.DOTALL):
            for line in block.splitlines():
                for part in re.split(r"&&|#", line):
                    if part.strip().startswith("creative-nao"):
                        yield pytest.param(shlex.split(part)[1:], id=f"{name}: {part.strip()}")


@pytest.mark.parametrize("words", [*commands()])
def test_commands_in_the_documents_have_known_options(words):
    """The long ones are run elsewhere (tests/cli, tests/evaluation); here every flag must be one that --help tells."""
    assert words[0] in COMMANDS
    command = words[:2] if words[0] == "agent" else words[:1]
    told = subprocess.run(
        [sys.executable, "-m", "creative_nao", *command, "--help"], capture_output=True, text=True, check=True
    ).stdout
    for flag in (word for word in words if word.startswith("--")):
        assert flag in told


def test_the_two_commands_of_the_readme_are_those_that_are_tested():
    shells = re.findall(r"```sh\n(.*?)```", TEXTS["README.md"], re.DOTALL)

    assert shells[:2] == ["pip install -e . && creative-nao evaluate quick\n", 'pip install -e ".[dev]" && pytest\n']
    assert shells[1].strip() in (ROOT / ".ci" / "run").read_text()


@pytest.mark.parametrize("name", TEXTS)
def test_links_and_file_names_lead_somewhere(name):
    page = ROOT / name
    for target in re.findall(r"\]\((?!https?://)([^)#]+)\)", TEXTS[name]):
        assert (page.parent / target).exists(), target
    for path in re.findall(r"`((?:[a-z_]+/)+[a-z_]+\.py)`", TEXTS[name]):
        assert (ROOT / path).exists() or (ROOT / "creative_nao" / path).exists(), path


def test_every_command_is_in_the_readme():
    for name in COMMANDS:
        assert f"| `creative-nao {name}` |" in TEXTS["README.md"]


def test_every_environment_is_documented():
    from creative_nao.envs import ENVIRONMENTS

    assert all(name in TEXTS["README.md"] for name in ENVIRONMENTS)
