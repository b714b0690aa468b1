"""The published physical maps, their summaries and docs/robot.md tell the same."""

import json
from pathlib import Path

import numpy as np
import pytest

from creative_nao.envs import BoxingEnv
from creative_nao.envs.physical_map import PhysicalMap
from creative_nao.measures.outcome import ALL_OUTCOMES

DOCS = Path(__file__).parents[2] / "docs"
MEMORIES = ("open/0", "half/0", "closed/0")
COLUMNS = {
    "resolution": "{0} x {0}",
    "mentally_appropriate_pct": "{:.1f}",
    "physically_appropriate_pct": "{:.1f}",
    "physical_of_mental_pct": "{:.1f}",
    "learned_pct": "{:.1f}",
    "unlearned_pct": "{:.1f}",
    "fluctuating_pct": "{:.1f}",
    "non_moving_pct": "{:.1f}",
    "joint_limit_pct": "{:.1f}",
    "fell_pct": "{:.1f}",
    "self_collision_pct": "{:.1f}",
    "torque_saturated_pct": "{:.1f}",
    "tracking_error_pct": "{:.1f}",
    "with_a_hit_pct": "{:.1f}",
}
"""Of the page's table, in order."""


@pytest.fixture(params=MEMORIES)
def memory(request):
    return request.param


@pytest.fixture
def chart(memory):
    return PhysicalMap.load(DOCS / "results" / "physical" / f"{memory.replace('/', '_')}.npz")


def test_the_summary_is_that_of_the_map(chart, memory):
    text = (DOCS / "results" / "physical" / f"{memory.replace('/', '_')}.json").read_text(encoding="utf-8")
    assert json.loads(text) == json.loads(json.dumps(chart.summary()))
    assert chart.record["settings"]["memory"] == memory


def test_the_page_has_the_figures_of_the_map(chart, memory):
    found = chart.summary()
    told = " | ".join(form.format(found[name]) for name, form in COLUMNS.items())
    assert f"| `{memory}` | {told} |" in (DOCS / "robot.md").read_text(encoding="utf-8")


def test_the_outcomes_of_a_map_are_all_there_is(chart):
    found = chart.summary()
    shares = [
        value for name, value in found.items() if name.endswith("_pct") and name.removesuffix("_pct") in ALL_OUTCOMES
    ]
    assert len(shares) == len(ALL_OUTCOMES)
    assert sum(shares) == pytest.approx(100.0)


def test_points_of_the_map_come_out_again(chart, memory):
    """Some points, played anew: other machines may differ in the last bits, so the distance has a tolerance."""
    env = BoxingEnv(memory)
    env.reset()
    for row in np.random.default_rng(0).choice(len(chart.pb), 3, replace=False):
        info = env.step(chart.pb[row])[4]
        assert info["outcome"] == chart.outcome[row]
        assert info["distance"] == pytest.approx(chart.distance[row], rel=1e-3)
