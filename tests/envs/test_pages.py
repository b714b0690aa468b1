"""What the pages of the environments say is so."""

import inspect
import re
import runpy
from pathlib import Path

import gymnasium as gym
import pytest

from creative_nao.envs import ENVIRONMENTS, BoxingEnv
from creative_nao.envs.observation import observation_space
from creative_nao.envs.viewing import Recorder
from creative_nao.measures.outcome import ALL_OUTCOMES
from creative_nao.robot import PhysicalLimits
from creative_nao.robot.performance import FALL_HEIGHT_M, FALL_TILT_RAD

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(params=ENVIRONMENTS)
def env(request):
    with gym.make(request.param) as env:
        yield env.unwrapped


def section(env, title):
    text = inspect.cleandoc((env if isinstance(env, type) else type(env)).__doc__)
    return re.search(rf"^## {title}\n(.*?)(?=^## |\Z)", text, re.DOTALL | re.MULTILINE).group(1)


def tables(text):
    """Rows of each table of a section, without its head."""
    blocks = re.findall(r"(?:^\|.*\n?)+", text, re.MULTILINE)
    return [
        [[cell.strip() for cell in line.strip("|").split(" | ")] for line in block.splitlines()[2:]] for block in blocks
    ]


def table(text):
    return tables(text)[0]


def test_the_table_of_actions_is_the_space(env):
    rows = table(section(env, "Action space"))

    assert [int(row[0]) for row in rows] == list(range(env.action_space.shape[0]))
    for index, _, low, high, unit in rows:
        assert (env.action_space.low[int(index)], env.action_space.high[int(index)]) == (float(low), float(high))
        assert unit == "1"


def test_the_tables_of_observations_are_the_space(env):
    """Index, name, meaning and range of every row are those of the layout, and nothing is left out."""
    text, space, parts = section(env, "Observation space"), env.observation_space, env.observation_parts
    after = text[text.index(f'`observation="{"trajectories" if env.try_columns else "cells"}"`') :]

    assert f": `Box({space.shape[0]},) float32`" in after.partition("\n")[0]
    for rows, described in zip(tables(after), filter(None, (parts, env.try_columns)), strict=False):
        assert [row[1] for row in rows] == [part.name for part in described]
        for (index, _, meaning, low, high, _), part in zip(rows, described, strict=True):
            first, _, last = index.partition("-")
            assert (int(first), int(last or first) + 1) == (part.start, part.stop)
            assert (meaning, float(low), float(high)) == (part.meaning, part.low, 1.0)
    assert space == observation_space(parts, env.try_columns)
    for part in parts:
        if part.name != "tries":
            assert (space.low[part.start : part.stop] == part.low).all()
    assert (space.high == 1.0).all()


def test_the_outcomes_are_all_there(env):
    assert ", ".join(f"`{name}`" for name in ALL_OUTCOMES) in " ".join(section(env, "Observation space").split())


def test_the_arguments_and_their_defaults_are_those_of_the_constructor(env):
    rows = table(section(env, "Arguments"))
    arguments = dict(inspect.signature(type(env).__init__).parameters)
    del arguments["drawing"]
    frames = inspect.signature(Recorder.__init__).parameters
    arguments |= {name: frames[name] for name in ("width", "height", "camera_name")}

    assert {row[0] for row in rows} == set(arguments) - {"self"}
    for name, default, _ in rows:
        assert default.strip("`").strip('"') == str(arguments[name].default), name


def test_the_version_decides_the_observation():
    """-v1 is -v0 with another setting."""
    for name in ("Boxing", "BoxingMental", "BoxingModulation"):
        old, new = (gym.spec(f"CreativeNao/{name}-v{k}") for k in range(2))
        assert (old.entry_point, old.vector_entry_point) == (new.entry_point, new.vector_entry_point)
        assert (old.kwargs, new.kwargs) == ({}, {"observation": "trajectories"})


def test_the_length_of_an_episode_is_the_one_told(env):
    text = section(env, "Episode end")

    assert f"`n_actions` ({env.n_actions})" in text
    if env.max_episode_steps > env.n_actions:
        assert re.search(rf"\b{env.max_episode_steps}\s+steps", text)


def test_every_page_has_all_sections(env):
    titles = re.findall(r"^ *## (.*)$", type(env).__doc__, re.MULTILINE)
    assert titles == [
        "Description", "Action space", "Observation space", "Rewards", "Starting state", "Episode end", "Arguments",
        "Version history",
    ]  # fmt: skip


def test_the_thresholds_of_the_body_are_the_ones_in_force():
    rows = dict(table(section(BoxingEnv, "Rewards")))
    limits = PhysicalLimits()

    assert f"{limits.joint_limit_rad} rad" in rows["joint_limit"]
    assert f"{limits.self_collision_share:.0%}".replace("%", " %") in rows["self_collision"]
    assert f"{limits.torque_saturated_share:.0%}".replace("%", " %") in rows["torque_saturated"]
    assert f"{limits.tracking_error_rad} rad" in rows["tracking_error"]
    assert f"{FALL_HEIGHT_M} m" in rows["fell"]
    assert f"{FALL_TILT_RAD} rad" in rows["fell"]


def test_the_page_of_the_documentation_is_current():
    pytest.importorskip("dm_control", reason="the page tells of its task")
    made = runpy.run_path(str(DOCS / "make_pages.py"))["environments_page"]()

    assert (DOCS / "environments.md").read_text(encoding="utf-8") == made, "run `docs/make_pages.py environments`"
