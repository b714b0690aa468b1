"""Figures that cannot be measured are null with a reason, never a number that looks like one."""

import dataclasses
import html
import re

import fake_boxing
import pytest

from creative_nao.agents import make_agent
from creative_nao.evaluation.pages import env_label, render
from creative_nao.evaluation.protocol import play
from creative_nao.evaluation.report import findings, notes
from creative_nao.evaluation.results import Measured, Oracle, make_results
from creative_nao.evaluation.suites import trained_here

MENTAL = "fake_boxing:Fake/BoxingMental-v0"


@pytest.fixture
def suite(make_suite):
    return make_suite(agents=("supervised", "random"), envs=(MENTAL,))


def measured(**changes):
    """Two episodes of each agent; `changes` maps an agent to what is different in its first episode."""
    env = fake_boxing.FakeBoxing(physical=False)
    episodes = []
    for agent in ("supervised", "random"):
        for seed in (0, 1):
            found = play(make_agent(agent), env, env_id=MENTAL, memory="fake/0", seed=seed)
            episodes.append(dataclasses.replace(found, **changes.get(agent, {})) if seed == 0 else found)
    oracle = Oracle("fake/0", ((0.0, 0.0),), (10.0,), {"learned": 20.0, "unlearned": 60.0})
    return Measured(tuple(episodes), (), {"fake/0": oracle})


def rows(suite, found):
    return make_results(suite, found, base_seed=0)["rows"]


def test_a_figure_missing_in_one_seed_is_taken_over_the_others(suite):
    found = measured(random={"novelty": None, "diversity": None})
    row = rows(suite, found)[1]
    assert row["novelty"] == {"mean": found.episodes[3].novelty, "low": None, "high": None}
    assert row["novelty_reason"].startswith("over 1 of 2 seeds; in the others no appropriate action to measure")


def test_a_figure_missing_in_all_seeds_is_null_with_a_reason(make_suite):
    suite = make_suite(agents=("random",), envs=(MENTAL,), n_seeds=1)
    found = measured(random={"novelty": None, "diversity": None})
    alone = Measured((found.episodes[2],), (), found.oracles)
    row = rows(suite, alone)[0]
    assert (row["novelty"], row["novelty_reason"]) == (None, "no appropriate action to measure")
    assert (row["diversity"], row["diversity_reason"]) == (None, "fewer than two appropriate actions to compare")
    assert row["reward"]["low"] is None
    assert row["reward_reason"] == "no interval from a single seed"


def test_an_oracle_that_earns_nothing_has_no_share(suite):
    found = measured()
    nothing = dataclasses.replace(found, oracles={"fake/0": Oracle("fake/0", (), (), {"fluctuating": 100.0})})
    row = rows(suite, nothing)[0]
    assert (row["oracle_share"], row["oracle_share_reason"]) == (
        None,
        "the map offers the oracle no appropriate action",
    )


def test_the_intervals_do_not_depend_on_other_rows(suite, make_suite):
    found = measured()
    alone = make_suite(agents=("random",), envs=(MENTAL,))
    assert rows(alone, found)[0] == rows(suite, found)[1]


def sentences(template, **values):
    """What a part of the report says, a text for each of its items."""
    items = re.findall(r"<li>(.*?)</li>", render(template, **values), re.DOTALL)
    return [" ".join(html.unescape(item).split()) for item in items]


def told_findings(suite, results, found):
    return sentences("findings.html.jinja", **findings(suite, results, found))


def told_limits(suite):
    trained = [agent for agent in suite.agents if trained_here(agent)]
    return sentences("limits.html.jinja", suite=suite, trained=trained, env_label=env_label)


def text_of(suite, supervised, random):
    results = make_results(suite, measured(), base_seed=0)
    for row, (low, mean, high) in zip(results["rows"], (supervised, random), strict=True):
        row["reward"] = {"low": low, "mean": mean, "high": high}
    return told_findings(suite, results, measured())[0]


def test_overlapping_intervals_are_not_called_a_difference(suite):
    assert "these seeds leave it open" in text_of(suite, (1.0, 2.0, 3.0), (2.5, 3.0, 3.5))


def test_separate_intervals_are_called_ahead(suite):
    assert "random is ahead of all others" in text_of(suite, (1.0, 2.0, 2.4), (2.5, 3.0, 3.5))


def test_the_best_in_reward_is_not_called_the_most_diverse_when_it_is_not(suite):
    results = make_results(suite, measured(), base_seed=0)
    for row, reward, diversity in zip(results["rows"], (2.0, 3.0), (50.0, 40.0), strict=True):
        row["reward"] = {"mean": reward, "low": reward - 0.1, "high": reward + 0.1}
        row["diversity"] = {"mean": diversity, "low": None, "high": None}
    told = told_findings(suite, results, measured())[0]
    assert "random is not the most diverse, though: diversity is random 40.0, supervised 50.0." in told
    results["rows"][1]["diversity"]["mean"] = 60.0
    assert "diverse" not in told_findings(suite, results, measured())[0]


def test_limits_speak_of_training_only_where_something_was_trained(suite, make_suite):
    assert not any("trained on" in line for line in told_limits(suite) if "network" not in line)
    assert any("judged on the very memory" in line for line in told_limits(make_suite()))


def test_each_reason_is_told_once(suite):
    found = measured(random={"novelty": None}, supervised={"novelty": None})
    told = [(text, where) for text, where in notes({"rows": rows(suite, found)}) if text.startswith("novelty")]
    assert [where for _, where in told] == [[]]  # all rows


def test_what_physics_changes_is_counted_over_the_same_choices(make_suite):
    physical = "fake_boxing:Fake/Boxing-v0"
    both = make_suite(agents=("random",), envs=(physical, MENTAL), n_seeds=1)
    played = [
        play(make_agent("random"), fake_boxing.FakeBoxing(physical=body), env_id=env, memory="fake/0", seed=0)
        for env, body in ((physical, True), (MENTAL, False))
    ]
    found = Measured(tuple(played), (), measured().oracles)
    usable = [action.appropriate for action in played[1].actions]
    refused = sum(usable) - sum(action.appropriate for action in played[0].actions)
    change = 100.0 * (played[0].reward / played[1].reward - 1.0)
    told = told_findings(both, make_results(both, found, base_seed=0), found)[2]
    assert f"of {sum(usable)} actions that are usable in the mental environment, physics refused {refused};" in told
    assert f"earn {change:+.1f} %" in told
