"""Neither importing the package nor asking a command for help warns: both run with every warning an error."""

import json
import subprocess
import sys

from creative_nao.cli.dispatch import COMMANDS

HELP = """
import contextlib, io, json, sys
from creative_nao.cli import main

told = {}
for command in json.loads(sys.argv[1]):
    with contextlib.redirect_stdout(io.StringIO()) as text:
        code = main([*command.split(), "--help"])
    told[command] = [code, text.getvalue()]
print(json.dumps(told))
"""


def strict(*words):
    done = subprocess.run([sys.executable, "-W", "error", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    return done.stdout


def test_importing_the_package_warns_of_nothing():
    assert strict("-c", "import creative_nao; print(creative_nao.__version__)").strip()


def test_every_public_name_is_reached_without_a_warning():
    """dm_control itself warns when it is loaded, whoever asks; nothing of ours may."""
    allowed = [word for name in ("dm_control", "dm_env") for word in ("-W", f"ignore::DeprecationWarning:{name}")]
    strict(*allowed, "-c", "import creative_nao as cn; [getattr(cn, name) for name in cn.__all__]")


def test_every_command_helps_without_a_warning():
    commands = [*COMMANDS, "agent train", "agent run", "agent tune"]
    told = json.loads(strict("-c", HELP, json.dumps(commands)))

    for command, (code, text) in told.items():
        assert code == 0, command
        assert f"usage: creative-nao {command}" in text
