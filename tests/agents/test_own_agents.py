"""Agents of the user's own: functions, policies, and `package.module:factory`."""

import re
import subprocess
import sys
import zipfile

import numpy as np
import pytest

from creative_nao.agents import Agent, FunctionAgent, PolicyAgent, as_agent, load_entry_point, make_agent
from creative_nao.cli import main
from creative_nao.errors import NotFoundError, SettingsError, ShapeError
from creative_nao.evaluation.suites import actions_before, check_agent, resolve_agent

OBSERVATION = np.zeros(4, np.float32)

MODULE = """
import numpy as np
from creative_nao.agents import Agent

class Corner(Agent):
    def choose(self, observation):
        return np.array([1.0, -1.0])

class Policy:
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.full(2, 0.25, np.float32), state

def function():
    return lambda observation: observation[:2] + 0.5

class Family:
    corner = Corner

def wrong():
    return 7

def trained():
    policy = Policy()
    policy.n_actions_training = 9000
    return policy

number = 7
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    (tmp_path / "my_own_agents.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])
    yield "my_own_agents"
    sys.modules.pop("my_own_agents", None)


def first(agent, context):
    agent.begin(context)
    return agent.ask(OBSERVATION).tolist()


@pytest.mark.parametrize(
    ("factory", "expected"),
    [
        ("Corner", [1.0, -1.0]),
        ("Family.corner", [1.0, -1.0]),
        ("Policy", [0.25, 0.25]),
        ("function", [0.5, 0.5]),
    ],
)
def test_what_a_factory_makes_plays_under_the_name_typed(own, factory, expected, make_context):
    name = f"{own}:{factory}"
    assert check_agent(name) == name
    for make in (make_agent, resolve_agent, load_entry_point):
        agent = make(name)
        assert isinstance(agent, Agent)
        assert agent.name == name
        assert first(agent, make_context()) == expected


@pytest.mark.parametrize(
    ("name", "error", "text"),
    [
        (
            "my_own_agentz:Corner",
            NotFoundError,
            "there is no module `my_own_agentz`; it should be installed",
        ),
        ("my_own_agents.deep:Corner", NotFoundError, "there is no module `my_own_agents.deep`"),
        ("my_own_agents:Cornr", NotFoundError, r"`my_own_agents` has no `Cornr` \(did you mean `Corner`\?\)"),
        ("my_own_agents:number", SettingsError, "should name a function that makes an agent, but is 7"),
        ("my_own_agents:wrong", SettingsError, "an object with `predict` or a function .* but is 7"),
        ("my own:agents", SettingsError, "is named `package.module:factory`, but this is `my own:agents`"),
    ],
)
def test_a_mistake_in_the_name_is_told(own, name, error, text):
    with pytest.raises(error, match=text):
        load_entry_point(name)


@pytest.mark.parametrize(
    ("code", "told"),
    [
        ("import not_there_at_all", "importing `my_broken` fails: ModuleNotFoundError: No .* 'not_there_at_all'"),
        ("def agent(:", r"importing `my_broken` fails: SyntaxError"),
        ("1 / 0", r"importing `my_broken` fails: ZeroDivisionError: division by zero \(my_broken.py, line 1\)"),
        (
            "def agent():\n    raise OSError('no weights')",
            r"`agent` fails: OSError: no weights \(my_broken.py, line 2\)",
        ),
        ("def agent(seed): ...", r"`agent` fails: TypeError: .* missing 1 required positional argument"),
        (
            "def agent():\n    f = lambda seen: seen\n    f.n_actions_training = -1\n    return f",
            "`n_actions_training` of agent `my_broken:agent` should be at least 0, but is -1",
        ),
    ],
)
def test_an_error_of_the_user_s_own_code_is_one_line_with_its_place(own, tmp_path, capsys, code, told):
    (tmp_path / "my_broken.py").write_text(f"{code}\n")
    sys.modules.pop("my_broken", None)
    assert main(["agent", "run", "my_broken:agent", "--memory", "half/0"]) == 2
    said = capsys.readouterr().err
    assert re.fullmatch(f"creative-nao: .*{told}.*\n", said), said


def test_a_policy_of_stable_baselines_as_a_file_names_the_way_in(tmp_path, capsys):
    with zipfile.ZipFile(tmp_path / "mine.zip", "w") as archive:
        archive.writestr("data", "{}")
    assert main(["agent", "run", str(tmp_path / "mine.zip")]) == 2
    assert (
        "ZIP archive, as Stable-Baselines3 saves a policy: pickles, which are not read; name a function that loads "
        in (capsys.readouterr().err)
    )


def test_an_agent_of_one_s_own_tells_the_actions_of_its_training(own):
    assert [actions_before(f"{own}:{name}") for name in ("Corner", "Policy", "function", "trained")] == [0, 0, 0, 9000]


def test_a_function_that_leaves_the_space_is_named(make_context):
    agent = FunctionAgent(lambda observation: [2.0, 0.0], name="mine")
    with pytest.raises(ShapeError, match="agent `mine` should choose a PB vector inside"):
        first(agent, make_context())


def test_agents_pass_through_and_policies_are_wrapped():
    agent = make_agent("random")
    assert as_agent(agent) is agent
    assert agent.name == "random"

    class Policy:
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            return np.zeros(2, np.float32), state

    assert isinstance(as_agent(Policy()), PolicyAgent)
    assert as_agent(lambda observation: observation[:2]).name == "function"
    with pytest.raises(SettingsError, match="an agent should be an `Agent`"):
        as_agent(Agent)


def test_importing_the_agents_loads_no_package_of_theirs():
    code = (
        "import sys, creative_nao.agents; "
        "heavy = {'ribs', 'cmaes', 'optuna', 'sklearn', 'scipy.stats', 'torch', 'stable_baselines3'}; "
        "sys.exit(str(heavy & set(sys.modules)) if heavy & set(sys.modules) else 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
