"""What many tests share: a tiny trained memory, made once."""

import os

# Two threads of torch on two busy cores are up to ten times slower than one. Before anything imports it.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pytest

from creative_nao.demonstrations import Demonstrations, load_demonstrations
from creative_nao.model import Memory, NetworkSettings, TrainingSettings, train_network

TINY = NetworkSettings(layer_sizes=(12, 6, 3))


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
