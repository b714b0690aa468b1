"""The trained agents in the package: small, named, trained on the train split, and they replay their recorded score."""

import dataclasses

import pytest

import creative_nao as cn
from creative_nao.agents import make_agent, shipped_agents
from creative_nao.agents.bundle import find_bundle, machine, replay
from creative_nao.agents.play import evaluate_policy
from creative_nao.envs import ENVIRONMENTS
from creative_nao.model import split_memories
from creative_nao.runtime import versions


def test_ppo_and_sac_ship_for_every_environment_of_the_first_release():
    first = [env.rpartition("/")[2] for env in ENVIRONMENTS if env[-3:] == "-v0" and "Rehearsal" not in env]
    wanted = {f"{agent}/{env}" for agent in ("ppo", "sac") for env in first}
    assert wanted <= set(shipped_agents())


@pytest.mark.parametrize("name", shipped_agents())
def test_a_shipped_agent_tells_how_it_was_made(name):
    header = cn.load_agent(name).header
    agent, _, told = name.partition("/")
    env, _, units = told.partition("-v1-")
    env, part = (f"{env}-v1", f"-{units}") if units else (env, "")
    assert find_bundle(name).stat().st_size < (700_000 if agent == "learned_map" else 300_000)
    assert header.agent == make_agent(name).name == agent
    assert header.memory == f"train{part}"
    assert header.score.env == f"CreativeNao/{env}"
    assert set(header.score.memories) == set(split_memories(f"validation{part}"))
    assert header.command.startswith(f"creative-nao agent train {agent} --env CreativeNao/{env} ")


def check_same(trained, found, recorded, rel):
    if trained.header.machine == machine() and trained.header.versions == versions():
        assert found == recorded
    else:  # torch may round a last bit otherwise, and a choice of 30 may then be another one
        assert found.mean == pytest.approx(recorded.mean, rel=rel)


RECORDED = (
    "ppo/BoxingMental-v0",
    "sac/BoxingMental-v0",
    "learned_map/BoxingMental-v1",
    "learned_map/BoxingModulation-v1",
)


@pytest.mark.parametrize("name", RECORDED)
def test_a_shipped_agent_plays_a_recorded_episode_again(name):
    trained = cn.load_agent(name)
    score = trained.header.score
    first = dataclasses.replace(score, episodes=score.episodes[:1])
    found = evaluate_policy(trained, first.env, first.memories, first.seeds, first.deterministic)
    check_same(trained, found, first, rel=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("name", shipped_agents())
def test_a_shipped_agent_replays_its_recorded_score(name):
    trained = cn.load_agent(name)
    check_same(trained, replay(trained), trained.header.score, rel=0.2)


@pytest.mark.parametrize("name", shipped_agents())
def test_a_shipped_agent_is_told_in_one_line(name):
    trained = cn.load_agent(name)
    for text in (repr(trained), repr(make_agent(name)), repr(trained.header.score)):
        assert "\n" not in text
        assert len(text) < 300


def test_a_wrong_shipped_name_brings_the_nearest():
    with pytest.raises(cn.NotFoundError, match=r"ppo/BoxingMentl-v0 \(did you mean `ppo/BoxingMental-v0`\?\)"):
        cn.load_agent("ppo/BoxingMentl-v0")
