"""The page's network, scores and stretches are those of the package: the one JavaScript module is held to Python."""

import json

import numpy as np
import pytest

from creative_nao.measures import attribution, score
from creative_nao.model import load_memory

ENGINE = """async ([points, name]) => {
    const { Memory } = await import("/static/engine.js");
    const page = await (await fetch(`/api/memory?name=${name}`)).json();
    const memory = new Memory(page.memory);
    return JSON.stringify(points.map((path) => {
        const { angles, outcome, nearest, novelty } = memory.recall(path);
        return { angles: angles.map((row) => [...row]), outcome, nearest, novelty };
    }));
}"""


def compare(tab, name, n):
    memory = load_memory(name)
    points = np.random.default_rng(4).uniform(-1, 1, (n, 2))
    told = json.loads(tab(ENGINE, [[[point] for point in points.tolist()], name]))
    expected = memory.generate(points)
    scores = score(expected, memory.demonstrations)
    angles = np.array([one["angles"] for one in told])
    apart = np.abs(angles - expected).max(axis=(1, 2))
    assert apart.max() < 1e-3, np.sort(apart)[-10:]
    assert [one["nearest"] for one in told] == scores.nearest.tolist()
    assert [one["outcome"] for one in told] == scores.outcome.tolist()
    np.testing.assert_allclose([one["novelty"] for one in told], scores.novelty, atol=0.02)
    assert len(set(scores.outcome)) >= 3


def test_the_page_generates_and_scores_as_the_package(visit, server):
    compare(visit(server.url), "half/0", 150)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["half/0", "open/3", "closed/5"])
def test_on_two_thousand_points_the_page_and_the_package_agree(visit, server, name):
    compare(visit(server.url), name, 2000)


def test_paths_and_stretches_are_those_of_the_package(visit, server):
    memory = load_memory("half/0")
    path = np.array([[-0.6, 0.4], [0.3, 0.2], [0.7, -0.8]])
    tab = visit(server.url)
    told = json.loads(tab(ENGINE, [[path.tolist()], "half/0"]))[0]
    expected = memory.generate_path(path)
    assert np.abs(np.array(told["angles"]) - expected).max() < 1e-3
    parts = tab(
        """async (path) => {
        const { stretches } = await import("/static/engine.js");
        const { memory } = explorer.panels[0];
        return stretches(memory.recall(path).angles, memory).map(({ first, end, action }) => [first, end, action]);
    }""",
        path.tolist(),
    )
    meant = attribution(expected, memory.demonstrations).stretches()
    assert parts == [[one.first, one.end, one.action] for one in meant]
