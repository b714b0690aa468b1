"""Where dm-control is missing, as on Python 3.13: everything works but `creative_nao.envs.load`, which says why not."""

import json
import subprocess
import sys

import pytest

WITHOUT = "import sys; sys.modules['dm_control'] = None; "  # as if it were not installed, in a process of its own


def run(code):
    return subprocess.run([sys.executable, "-c", WITHOUT + code], capture_output=True, text=True)


def test_the_robot_boxes_in_its_memory_and_in_physics():
    code = """
import gymnasium as gym, creative_nao as cn
for name in ("BoxingMental", "Boxing"):
    env = gym.make(f"CreativeNao/{name}-v0", memory="half/0")
    env.reset(seed=0)
    env.step(env.action_space.sample())
env = gym.make_vec("CreativeNao/Boxing-v0", 2, memory="half/0")
env.reset(seed=0)
print(env.step(env.action_space.sample())[4]["hits"].shape)
import creative_nao.robot, creative_nao.demonstrations, creative_nao.explorer, creative_nao.testing
"""
    done = run(code)

    assert done.returncode == 0, done.stderr
    assert done.stdout == "(2,)\n"


@pytest.mark.slow
def test_commands_that_simulate_the_robot_work(tmp_path):
    code = f"""
import os; os.chdir({str(tmp_path)!r})
from creative_nao.cli import main
assert main("teach --out taught".split()) == 0
assert main("map half/0 --physical --resolution 2 --out map.npz".split()) == 0
assert main("export half/0 --pb 0.1 0.2 --out film.gif".split()) == 0
"""
    done = run(code)

    assert done.returncode == 0, done.stderr
    assert all((tmp_path / name).exists() for name in ("taught", "map.npz", "film.gif"))


def test_the_task_of_dm_control_says_in_one_line_what_is_missing():
    code = """
import creative_nao as cn
try:
    cn.envs.load("boxing")
except cn.MissingDependencyError as error:
    print(error)
"""
    done = run(code)

    assert done.stdout.startswith("`creative_nao.envs.load` needs dm-control"), done.stderr
    assert "Python 3.13" in done.stdout
    assert done.stdout.count("\n") == 1


@pytest.mark.slow
def test_the_doctor_names_what_is_missing():
    done = run("from creative_nao.cli import main; sys.exit(main(['doctor', '--json']))")

    assert done.returncode == 0, done.stderr
    task = json.loads(done.stdout)["dm_control"]
    assert not task["works"]
    assert "needs dm-control" in task["reason"]
