"""Files name modules, links and states: nothing is imported unasked, written elsewhere or put where it cannot be."""

import json
import sys

import gymnasium as gym
import numpy as np
import pytest
from victims import ENV

import creative_nao  # noqa: F401
from creative_nao.agents.play import PlayedEpisode, Score
from creative_nao.arrays import load_tensors, save_tensors
from creative_nao.cli import main
from creative_nao.envs import EnvState
from creative_nao.errors import FileFormatError, SettingsError
from creative_nao.evaluation.run import only_plain_files
from creative_nao.evaluation.suites import read_suite
from creative_nao.evaluation.verification import verify

MODULE = (
    "import pathlib\npathlib.Path(__file__).with_name('ran').touch()\ndef agent():\n    return lambda seen: [0, 0]\n"
)


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A module that leaves a file behind when it is imported, where Python finds it."""
    (tmp_path / "intruder.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path / "ran"
    sys.modules.pop("intruder", None)


SUITE = 'agents = ["{agent}"]\nenvs = ["{env}"]\nmemories = ["half/0"]\n'


@pytest.mark.parametrize(
    ("agent", "env", "named"), [("intruder:agent", ENV, "intruder:agent"), ("random", "intruder:X-v0", "intruder:X-v0")]
)
def test_a_suite_imports_nothing_unasked(agent, env, named, module, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(SUITE.format(agent=agent, env=env))
    with pytest.raises(SettingsError, match=f"`{named}` is a module that would be imported and run; .* add --trust"):
        read_suite(path)
    assert not module.exists()

    assert named in (*read_suite(path, trusted=True).agents, *read_suite(path, trusted=True).envs)
    assert module.exists() == (agent == "intruder:agent"), "an agent is tried at once, an environment when it is made"


def test_a_result_file_imports_nothing_unasked(module, victims, tmp_path):
    content = json.loads(victims["results"].path.read_text())
    content.pop("sha256")
    suite = {"name": "quick", "agents": ["intruder:agent"], "envs": [ENV], "memories": ["half/0"]}
    content["record"] = {"settings": {"suite": suite, "seed": 0}, "versions": {}, "memories": {}, "command": "x"}
    path = tmp_path / "results.json"
    path.write_text(json.dumps(content))
    with pytest.raises(SettingsError, match="`intruder:agent` is a module that would be imported and run"):
        verify(path)
    assert not module.exists()


@pytest.mark.parametrize("flags", [[], ["--replay"]])
def test_a_bundle_imports_nothing_unasked(flags, module, victims, tmp_path, capsys):
    header, arrays = load_tensors(victims["bundle"].path, kind="agent bundle")
    score = Score("intruder:X-v0", True, (PlayedEpisode("half/0", 0, 1.0),)).as_json()
    path = save_tensors(tmp_path / "b", kind="agent bundle", header={**header, "score": score}, tensors=arrays)
    assert main(["agent", "run", str(path), *flags]) == 2
    said = capsys.readouterr().err
    assert "the bundle names the environment intruder:X-v0, whose module would be imported and run" in said
    assert not module.exists()


def test_a_run_folder_with_a_link_is_not_continued(tmp_path):
    (tmp_path / "run" / "jobs").mkdir(parents=True)
    only_plain_files(tmp_path / "run")
    (tmp_path / "run" / "jobs" / "a.log").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(SettingsError, match=r"a\.log is a link"):
        only_plain_files(tmp_path / "run")


STATES = {
    "another kind": lambda v, a: None,
    "n_actions": lambda v, a: v.update(n_actions=-1),
    "n_actions ": lambda v, a: v.update(n_actions=True),
    "memory": lambda v, a: v.update(memory=["half/0"]),
    "random": lambda v, a: v.update(random=[1]),
    "PCG64": lambda v, a: v.update(random={"bit_generator": "PCG64", "state": {"state": 10**39, "inc": 1}}),
    "more": lambda v, a: v.update(more=1),
    "PCG64 ": lambda v, a: v["random"].update(uinteger=2**32),
    "inc": lambda v, a: v["random"]["state"].update(inc=2),
    "state": lambda v, a: v["random"]["state"].update(state=-1),
    "n_actions  ": lambda v, a: v.update(n_actions=31),
    "observation": lambda v, a: a.update(observation=a["observation"][:-1]),
    "observation   ": lambda v, a: a.update(observation=np.full_like(a["observation"], 1e9)),
    "observation    ": lambda v, a: a.update(observation=np.full_like(a["observation"], -1.001)),
    "accepted  ": lambda v, a: a.update(accepted=np.full((1, *a["accepted"].shape[1:]), 1e4), novelty=np.ones(1)),
    "novelty ": lambda v, a: a.update(accepted=np.zeros((1, *a["accepted"].shape[1:])), novelty=-np.ones(1)),
    "observation ": lambda v, a: a.update(observation=a["observation"] * np.float32(np.nan)),
    "observation  ": lambda v, a: a.update(observation=a["observation"].astype(np.float64)),
    "accepted": lambda v, a: a.update(accepted=np.zeros((0, 2, 8))),
    "accepted ": lambda v, a: a.update(accepted=np.zeros(())),
    "accepted actions": lambda v, a: a.update(accepted=np.zeros((9, *a["accepted"].shape[1:]))),
    "pair_sum": lambda v, a: a.update(pair_sum=np.full(1, 1e300)),
    "novelty": lambda v, a: a.pop("novelty"),
}


@pytest.mark.parametrize("part", STATES)
def test_a_state_that_does_not_fit_is_refused_by_its_part(part, tmp_path, attempt):
    attempt("a state of an environment", "wild numbers, shapes, generators", "refused by the name of the part")
    env = gym.make(ENV)
    env.reset(seed=0)
    env.step(np.array([0.1, 0.2]))
    good = env.unwrapped.get_state()
    values, arrays = json.loads(json.dumps(good.values)), dict(good.arrays)
    STATES[part](values, arrays)
    kind = "BoxingEnv" if part == "another kind" else good.kind
    with pytest.raises(SettingsError, match=part.strip() if part != "another kind" else "one of a BoxingMentalEnv"):
        env.unwrapped.set_state(EnvState(kind, values, arrays))
    env.unwrapped.set_state(EnvState.load(good.save(tmp_path / "good.safetensors")))


@pytest.mark.parametrize(
    ("part", "change"),
    [
        ("tick", lambda v, a: v.update(tick=3)),
        ("n_decided", lambda v, a: v.update(n_decided=10**6)),
        ("network_state", lambda v, a: a.update(network_state=a["network_state"][:, :3])),
        ("network_code", lambda v, a: a.update(network_code=np.zeros((1, 1), a["network_code"].dtype))),
    ],
)
def test_a_state_of_another_network_never_reaches_compiled_code(part, change):
    made = gym.make("CreativeNao/BoxingModulation-v0")
    made.reset(seed=0)
    good = made.unwrapped.get_state()
    values, arrays = dict(good.values), dict(good.arrays)
    change(values, arrays)
    with pytest.raises(SettingsError, match=part):
        made.unwrapped.set_state(EnvState(good.kind, values, arrays))


def test_an_error_over_a_damaged_checkpoint_of_an_agent_names_the_file(victims, tmp_path):
    path = tmp_path / "checkpoint"
    path.write_bytes(victims["agent_checkpoint"].path.read_bytes()[:-3])
    with pytest.raises(FileFormatError, match=r"checkpoint: the array .* is torn"):
        victims["agent_checkpoint"].load(path)
