"""Body sense: predicted refusals, and agents that heed them where the robot performs in physics."""

import dataclasses

import numpy as np
import pytest

from creative_nao.agents import BodySettings, Context, PlanAgent, make_agent
from creative_nao.agents.body_sense import (
    FIGURES,
    KIND,
    PERFORMED_KIND,
    BodySense,
    SenseSettings,
    features,
    perform_movements,
    shipped_sense,
    train_sense,
)
from creative_nao.agents.play import make_env, play_episode
from creative_nao.arrays import load_tensors, save_tensors
from creative_nao.demonstrations import load_demonstrations
from creative_nao.errors import FileFormatError
from creative_nao.robot.postures import arm_angles

MENTAL, PHYSICAL = "CreativeNao/BoxingMental-v0", "CreativeNao/Boxing-v0"
FEW = SenseSettings(n_uniform=3, n_novel=1, n_hidden=16, n_epochs=24)


@pytest.fixture
def demos():
    return load_demonstrations()


def write_movements(folder, name, n=400):
    """Write movements that the body refuses where the right elbow is bent by more than 0.8 rad."""
    rng = np.random.default_rng(len(name))
    moves = 0.3 * rng.standard_normal((n, 1, 8)).repeat(10, axis=1)
    moves[:, :, 3] = rng.uniform(0.1, 1.5, (n, 1))
    moves[:, :, 7] = -0.1
    refused = moves[:, 0, 3] > 0.8
    header = {"memory": name, "dt_s": 0.15, "n_uniform": 3, "n_novel": 1, "seed": 0, "record": {}}
    figures = {figure: np.where(refused, 2.0 * limit, 0.0).astype(np.float32) for figure, limit in FIGURES.items()}
    arrays = {"pb": np.zeros((n, 2)), "trajectory": moves.astype(np.float32), "fault": 3 * refused.astype(np.int8)}
    path = folder / f"{name.replace('/', '-')}.safetensors"
    return save_tensors(path, kind=PERFORMED_KIND, header=header, tensors=arrays | figures)


def test_what_was_performed_teaches_and_the_file_gives_the_same_sense_back(tmp_path):
    for name in ("half/0", "half/10"):
        write_movements(tmp_path, name)
    sense = train_sense(tmp_path, ["half/0"], ["half/10"], FEW, command="a test")
    assert sense.header.validation["auc"] > 0.9
    again = train_sense(tmp_path, ["half/0"], ["half/10"], FEW, command="a test")
    read = BodySense.load(sense.save(tmp_path / "sense.safetensors"))
    moves = 0.5 * np.random.default_rng(0).standard_normal((5, 10, 8))
    for other in (again, read):
        assert np.array_equal(sense.refusal(moves, 0.15), other.refusal(moves, 0.15))
    with pytest.raises(FileFormatError, match=r"half-0.*should be \('half/0', 100, 30, 0\), but are"):
        train_sense(tmp_path, ["half/0"], ["half/10"], SenseSettings())


def test_a_damaged_or_foreign_body_sense_is_refused(tmp_path):
    header, arrays = load_tensors(shipped_sense().save(tmp_path / "a.safetensors"), kind=KIND)
    for name, wrong in (("w1", arrays["w1"][:, 1:]), ("b0", arrays["b0"] * np.nan), ("spread", 0 * arrays["spread"])):
        path = save_tensors(tmp_path / "b.safetensors", kind=KIND, header=header, tensors=arrays | {name: wrong})
        with pytest.raises(FileFormatError, match=name):
            BodySense.load(path)
    path = save_tensors(tmp_path / "c.safetensors", kind=KIND, header={**header, "x": 1}, tensors=arrays)
    with pytest.raises(FileFormatError, match="no key `x`"):
        BodySense.load(path)


def test_the_shipped_sense_accepts_what_was_taught_and_refuses_crossed_arms(demos):
    taught = np.array(demos.trajectories)
    crossed = np.tile(arm_angles("Guard"), (1, 50, 1))
    crossed[..., 1], crossed[..., 5] = 0.3, -0.3  # both upper arms turned inwards,
    crossed[..., 3], crossed[..., 7] = 1.5, -1.5  # both elbows bent: the forearms cross before the chest
    sense = shipped_sense()
    assert sense.refusal(taught, demos.dt_s).max() < 0.05
    assert sense.refusal(crossed, demos.dt_s)[0] > 0.5
    assert sense.header.validation["auc"] > 0.95
    assert features(taught, demos.dt_s).shape == (6, 50, 28)


def play(agent, env_id=MENTAL, memory="half/11", n_actions=3, physics=None):
    env = make_env(env_id, memory, agent, n_actions)
    if physics is not None:
        env.unwrapped.physics = physics
    try:
        return [*play_episode(agent, env, seed=0, rng=np.random.default_rng(0), n_actions=n_actions)]
    finally:
        env.close()


def test_without_physics_the_body_takes_no_part():
    plain, *others = (play(make_agent(f"{name}@4")) for name in ("plan", "plan_with_sense", "plan_with_body"))
    for steps in others:
        assert np.array_equal([step.pb for step in steps], [step.pb for step in plain])
        assert [step.n_imagined for step in steps] == [step.n_imagined for step in plain]


def test_what_the_body_refuses_in_imagination_is_not_performed(monkeypatch):
    """A body that refuses what would be performed first: it costs an imagining, and the next best is performed."""
    imagine, asked = Context.imagine, []

    def refusing(self, pb, *, with_body=False):
        if not with_body:
            return imagine(self, pb)
        asked.append(np.asarray(pb, np.float32).ravel())
        return [{**imagine(self, pb)[0], "appropriate": len(asked) > 1}]

    monkeypatch.setattr(Context, "imagine", refusing)
    agent = PlanAgent()
    agent.body, agent.n_candidates = BodySettings("simulate", n_simulated=2, refused_scale=1e-3), 8
    steps = play(agent, physics=True)
    assert len(asked) == 4
    assert np.array_equal([step.pb for step in steps], asked[1:])
    assert not np.array_equal(asked[0], asked[1])
    assert 3 * 7 <= steps[-1].n_imagined <= 3 * 8


def test_a_refused_movement_makes_similar_ones_less_likely(demos):
    agent = PlanAgent()
    agent.body = BodySettings("sense")
    play(agent, n_actions=1)
    agent._refused, agent._sense = [], None
    near, far = demos.trajectories[0] + 0.01, demos.trajectories[1]
    assert agent.accepted([near, far]).tolist() == [1.0, 1.0]
    agent.refuse(demos.trajectories[0])
    chance = agent.accepted([near, far])
    assert chance[0] < chance[1] < 1.0
    agent.refuse(demos.trajectories[1])
    both = agent.accepted([near, far, demos.trajectories[2]])
    assert (both >= 0.0).all()  # a probability, however many were refused
    assert both[0] < chance[0]
    assert both[1] < both[2] < 1.0


@pytest.mark.slow
def test_performed_movements_are_kept_and_taken_over(tmp_path):
    done = []
    perform_movements(tmp_path, ["half/11"], FEW, n_threads=1, progress=done.append)
    path = tmp_path / "half-11.safetensors"
    content = path.read_bytes()
    perform_movements(tmp_path, ["half/11"], FEW, n_threads=1, progress=done.append)
    assert path.read_bytes() == content
    assert done == [0, 1, 0, 1]
    _, arrays = load_tensors(path, kind=PERFORMED_KIND)
    assert len(arrays["fault"]) == 3 + 5
    with pytest.raises(FileFormatError, match="should be \\('half/11', 3, 1, 1\\)"):
        perform_movements(tmp_path, ["half/11"], dataclasses.replace(FEW, seed=1))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["plan_with_sense@16", "plan_with_body@16"])
def test_a_planner_with_body_loses_little_to_its_body(name):
    """closed/12 is a memory on which the body refuses novel movements."""
    steps = play(make_agent(name), PHYSICAL, "closed/12", n_actions=6)
    assert sum(step.info["appropriate"] for step in steps) >= 5
