import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "evaluation"))  # the fake world is shared

import fake_boxing

from creative_nao.agents import Context


@pytest.fixture
def make_context():
    def make(n_actions=30, seed=0):
        env = fake_boxing.FakeBoxing
        return Context(env.action_space, env.observation_space, n_actions, np.random.default_rng(seed))

    return make
