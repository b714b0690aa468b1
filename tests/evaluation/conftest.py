import os
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from creative_nao.agents import PPOSettings  # noqa: E402 - after the path
from creative_nao.evaluation.run import evaluate  # noqa: E402
from creative_nao.evaluation.runner import LocalExecutor  # noqa: E402
from creative_nao.evaluation.suites import Suite  # noqa: E402

BOXING = "fake_boxing:Fake/Boxing-v0"
MENTAL = "fake_boxing:Fake/BoxingMental-v0"
TINY_PPO = PPOSettings(n_timesteps=240, n_envs=2, n_steps=60, batch_size=60, n_epochs=2, hidden=(8,))


@pytest.fixture(scope="session")
def in_workers():
    """Let the processes of jobs find the fake world."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")]))
        yield


@pytest.fixture(scope="session")
def make_suite(in_workers):
    def make(**changes):
        values = {
            "name": "fake",
            "agents": ("supervised", "random", "ppo"),
            "envs": (BOXING, MENTAL),
            "memories": ("fake/0",),
            "n_seeds": 2,
            "n_actions": 30,
            "training_env": MENTAL,
            "ppo": TINY_PPO,
            "oracle_envs": (MENTAL,),
            "resolution": 20,
            "seeds_per_job": 2,
        }
        return Suite(**{**values, **changes})

    return make


@pytest.fixture(scope="session")
def finished(tmp_path_factory, make_suite):
    """A finished run with two workers, made once."""
    folder = tmp_path_factory.mktemp("run") / "new"
    return evaluate(make_suite(), folder, seed=3, executor=LocalExecutor(2), command="creative-nao evaluate fake")
