"""Where dm-control is missing, as after a plain installation on Python 3.13: the mind works, the body says why not."""

import subprocess
import sys

import pytest

ADVICE = "pip install --no-deps dm-control"
WITHOUT = "import sys; sys.modules['dm_control'] = None; "  # as if it were not installed, in a process of its own


def run(code):
    return subprocess.run([sys.executable, "-c", WITHOUT + code], capture_output=True, text=True)


@pytest.mark.parametrize(
    "code",
    [
        "import gymnasium as gym, creative_nao; env = gym.make('CreativeNao/BoxingMental-v0', memory='half/0'); "
        "env.reset(seed=0); env.step(env.action_space.sample())",
        "import creative_nao as cn; memory = cn.load_memory('half/0'); "
        "assert memory.generate([[0.3, -0.1]]).shape == (1, 50, 8)",
        "from creative_nao.cli import main; assert main(['evaluate', '--help']) == 0",
        "from creative_nao.cli import main; assert main(['memories']) == 0",
        "import creative_nao.robot, creative_nao.demonstrations, creative_nao.explorer, creative_nao.testing",
    ],
    ids=["environment", "memory", "help", "memories", "imports"],
)
def test_what_needs_no_body_works(code):
    done = run(code)

    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    "code",
    [
        "from creative_nao.robot import Scene",
        "from creative_nao.robot import Nao",
        "import creative_nao as cn; cn.envs.load('boxing')",
        "import gymnasium as gym, creative_nao; gym.make('CreativeNao/Boxing-v0').reset(seed=0)",
        "import gymnasium as gym, creative_nao; env = gym.make_vec('CreativeNao/Boxing-v0', 2); "
        "env.reset(seed=0); env.step(env.action_space.sample())",
    ],
)
def test_what_needs_the_body_says_how_to_get_it(code):
    done = run(f"\nfrom creative_nao.errors import MissingDependencyError\ntry:\n    {code}\n"
               "except MissingDependencyError as error:\n    print(error)")  # fmt: skip

    assert ADVICE in done.stdout, done.stderr
    assert "Python 3.13" in done.stdout


@pytest.mark.parametrize(
    "words",
    [
        ["map", "half/0", "--physical", "--resolution", "2", "--out", "map.npz"],
        ["teach", "--out", "taught"],
        ["export", "half/0", "--pb", "0.1", "0.2", "--out", "film.gif"],
        ["evaluate", "quick", "--out", "run"],
        ["explore", "half/0", "--no-open", "--resolution", "9"],
    ],
    ids=lambda words: words[0],
)
def test_a_command_that_needs_the_body_ends_with_one_line(words, tmp_path):
    done = run(f"import os; os.chdir({str(tmp_path)!r}); from creative_nao.cli import main; sys.exit(main({words!r}))")

    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1
    assert ADVICE in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_the_doctor_names_what_is_missing():
    done = run("from creative_nao.cli import main; sys.exit(main(['doctor']))")

    assert done.returncode == 0, done.stderr
    assert "robot's body         no: " in done.stdout
    assert ADVICE in done.stdout
