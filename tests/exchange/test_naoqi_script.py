"""The program for the robot: run as a dry run, and against a robot that only writes down what it is told."""

import ast
import json
import subprocess
import sys

import numpy as np
import pytest

from creative_nao import exchange
from creative_nao.demonstrations import load_demonstrations
from creative_nao.joints import JOINTS

FAKE_NAOQI = """
import json, sys

class ALProxy(object):
    def __init__(self, service, ip, port):
        self.say("ALProxy", service, ip, port)
    def say(self, *words):
        print(json.dumps(words))
    def getStiffnesses(self, names):
        return [0.1] * len(names)
    def stiffnessInterpolation(self, names, values, times):
        self.say("stiffness", names, values, times)
    def angleInterpolation(self, names, angles, times, absolute):
        self.say("angles", names, angles, times, absolute)
        if "--fail" in sys.argv[0]:
            raise RuntimeError("motor too hot")
"""


@pytest.fixture(scope="module")
def jab():
    demos = load_demonstrations()
    return exchange.Motion(demos.trajectory("left_jab"), demos.dt_s, demos.joints, {"source": 'a"\n\'"""; exit(1) # ö'})


@pytest.fixture
def program(jab, tmp_path):
    return exchange.write(tmp_path / "punch.py", jab).path


def run(program, *words, naoqi=False):
    if naoqi:
        (program.parent / "naoqi.py").write_text(FAKE_NAOQI)
    done = subprocess.run([sys.executable, str(program), *words], capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr


def test_without_a_robot_it_tells_what_it_would_do(program, jab):
    code, out, err = run(program)

    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0] == "dry run: nothing is sent to a robot"
    assert "8 joints, 9.35 s, first posture after 2.00 s" in out
    assert [line.split()[0] for line in lines[-8:]] == list(JOINTS)
    fastest = np.abs(np.diff(jab.angles[:, 7])).max() / jab.dt_s
    assert lines[-1].endswith(f"up to {fastest:5.2f} rad/s")


def test_with_naoqi_it_raises_stiffness_moves_and_sets_it_back(program, jab):
    code, out, _ = run(program, "--ip", "nao.local", naoqi=True)
    calls = [json.loads(line) for line in out.splitlines()]

    assert code == 0
    assert calls[0] == ["ALProxy", "ALMotion", "nao.local", 9559]
    assert [call[0] for call in calls[1:]] == ["stiffness", "angles", "stiffness"]
    assert calls[1][2] == [0.8] * 8
    assert calls[3][2] == [0.1] * 8
    _, names, angles, times, absolute = calls[2]
    assert (names, absolute) == (list(JOINTS), True)
    assert np.array_equal(np.transpose(angles), jab.angles)
    assert times == [jab.times_s(jab.lead_s())] * 8


def test_stiffness_is_set_back_when_the_robot_refuses(program):
    code, out, err = run(program.rename(program.with_name("x--fail.py")), "--ip", "nao.local", naoqi=True)

    assert code == 1
    assert "motor too hot" in err
    assert json.loads(out.splitlines()[-1])[:3] == ["stiffness", list(JOINTS), [0.1] * 8]


def test_it_can_only_be_made_slower(program):
    _, out, _ = run(program, "--ip", "x", "--slower", "3", naoqi=True)

    assert json.loads(out.splitlines()[2])[3][0][0] == pytest.approx(6.0)
    code, _, err = run(program, "--slower", "0.5")
    assert (code, "--slower should be at least 1" in err) == (2, True)


def test_there_are_at_most_fifty_keys_a_second(jab, tmp_path):
    fine = exchange.Motion(np.repeat(jab.angles[:1], 401, axis=0), 0.0025)
    out = exchange.write(tmp_path / "a.py", fine)
    found = exchange.read(out.path)

    assert out.notes[0] == "keys every 0.0025 s brought to 0.02 s, 50 a second"
    assert found.motion.angles.shape == (51, 8)
    assert found.motion.dt_s == 0.02


def test_a_name_or_a_note_cannot_become_code(program):
    """Everything outside the fixed text is a literal, and all of it is ASCII."""
    text = program.read_bytes().decode("ascii")
    body = ast.parse(text).body
    values = {node.targets[0].id: node.value for node in body if isinstance(node, ast.Assign)}

    assert set(values) == {"names", "times", "keys", "metadata"}
    assert all(ast.literal_eval(values[name]) for name in ("names", "times", "keys"))
    assert json.loads(ast.literal_eval(values["metadata"].args[0]))["source"] == 'a"\n\'"""; exit(1) # ö'
    assert run(program)[0] == 0


def test_it_uses_nothing_that_python_2_does_not_know(program):
    """No annotations, no formatted strings, nothing but old syntax; `print` is imported from the future."""
    newer = (ast.JoinedStr, ast.AnnAssign, ast.Starred, ast.NamedExpr, ast.AsyncFunctionDef, ast.Nonlocal, ast.Match)
    tree = ast.parse(program.read_text())

    assert not [node for node in ast.walk(tree) if isinstance(node, newer)]
    assert not [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and node.returns]
    assert "from __future__ import print_function" in program.read_text()
