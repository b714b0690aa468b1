"""What many tests share: a tiny trained memory, made once; and how two workers share the work of a whole run."""

import json
import os
from pathlib import Path

# Two threads of torch on two busy cores are up to ten times slower than one. Before anything imports it.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import gymnasium as gym
import numpy as np
import pytest

from creative_nao import measures, storage
from creative_nao.demonstrations import Demonstrations, load_demonstrations
from creative_nao.model import Memory, NetworkSettings, TrainingSettings, load_memory, train_network
from creative_nao.runtime import versions

TINY = NetworkSettings(layer_sizes=(12, 6, 3))
MANY = 200
"""From so many tests on, the compiled kernels are warmed up before the first."""


TOGETHER = ("tests/explorer/", "tests/evaluation/test_")
"""What begins so is run by one worker: these tests share a server and a browser, and a finished run."""


def pytest_configure(config):
    """Many tests train for a few epochs; that too little is recalled then is no finding."""
    config.addinivalue_line("filterwarnings", "ignore::creative_nao.errors.RecallWarning")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Give each file to one worker, as `--dist loadfile` does, and all files of `TOGETHER` to the same."""
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid):
            return next((start for start in TOGETHER if nodeid.startswith(start)), super()._split_scope(nodeid))

    return Scheduling(config, log) if config.option.dist == "loadfile" else None


def pytest_addoption(parser):
    parser.addoption("--write-attempts", type=Path, help="JSON file to record attempts in; its other cases stay")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    if report.when == "call":
        item.report_of_call = report
    return report


@pytest.fixture
def attempt(request):
    """Tell of what a test tries against the project: ``attempt(kind, case, outcome, n=1)``.

    `kind` is what is attacked, `case` what is tried, `outcome` how it should be answered, `n` how often it is tried.
    Whether it held is known when the test has ended; of tests that tell the same case, all have to hold. With
    `--write-attempts docs/attempts.json` it is recorded, and `python docs/make_pages.py attempts` writes the table.
    """
    told = []
    yield lambda kind, case, outcome, n=1: told.append({"kind": kind, "case": case, "outcome": outcome, "n": n})
    target = request.config.getoption("--write-attempts", default=None)
    if target is None or not told:
        return
    report = getattr(request.node, "report_of_call", None)
    where = request.node.nodeid.partition("::")[0]
    held = report is not None and report.passed
    with storage.alone(target.absolute().parent):
        known = json.loads(target.read_text(encoding="utf-8"))["cases"] if target.exists() else []
        cases = {(one["kind"], one["case"], one["id"]): one for one in known}
        for one in told:
            cases[one["kind"], one["case"], request.node.name] = {
                **one, "held": held, "test": where, "id": request.node.name
            }  # fmt: skip
        lines = ",\n".join("  " + json.dumps(cases[key], ensure_ascii=False) for key in sorted(cases))
        text = f'{{\n "versions": {json.dumps(versions())},\n "cases": [\n{lines}\n ]\n}}\n'
        storage.write_text(target, text)


def _generate():
    load_memory("half/0").generate(np.zeros((40, 2)))


def _recognise():
    memory = load_memory("half/0")
    memory.infer_pb(memory.demonstrations.trajectories[0], n_restarts=2)


def _compare():
    demos = load_demonstrations()
    measures.score(list(demos.trajectories), demos)


def _step():
    env = gym.make("CreativeNao/BoxingMental-v0", memory="half/0")
    env.reset(seed=0)
    env.step(env.action_space.sample())


def _train():
    train_network(load_demonstrations(), TrainingSettings(n_epochs=1), TINY, command="test")


WARM_UPS = ((_generate, _train, _recognise, _step, _compare), (_compare, _generate, _step, _recognise, _train))
"""In two orders: what another worker is compiling is waited for, and then read from the cache."""


@pytest.fixture(scope="session", autouse=True)
def kernels(request, tmp_path_factory):
    """In a whole run, have each kernel compiled by one worker and read from the cache by the others."""
    worker = os.environ.get("PYTEST_XDIST_WORKER")
    if worker is None or len(request.session.items) < MANY:
        return
    for warm_up in WARM_UPS[int(worker.removeprefix("gw")) % 2]:
        folder = tmp_path_factory.getbasetemp().parent / f"kernels{warm_up.__name__}"
        with storage.alone(folder, deadline_s=600.0):  # as long as compiling may take on a busy machine
            warm_up()


@pytest.fixture(scope="session")
def demonstrations() -> Demonstrations:
    """The six shipped basic actions."""
    return load_demonstrations()


@pytest.fixture(scope="session")
def tiny_memory(demonstrations) -> Memory:
    """A small network, trained for a moment: quick to make, good enough to move."""
    return train_network(demonstrations, TrainingSettings(n_epochs=300, seed=3), TINY, command="test")


@pytest.fixture(scope="session")
def waves() -> Demonstrations:
    """Two short actions of two joints with different lengths."""
    time = np.linspace(0, 2 * np.pi, 20)
    first = np.stack([0.5 * np.sin(time), 0.8 + 0.5 * np.cos(time)], axis=1)
    second = np.stack([0.5 * np.sin(2 * time), 0.8 + 0.3 * np.cos(time)], axis=1)[:15]
    return Demonstrations(("first", "second"), [first, second], dt_s=0.1, joints=("RShoulderPitch", "RElbowRoll"))
