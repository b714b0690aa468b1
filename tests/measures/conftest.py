from dataclasses import dataclass

import numpy as np
import pytest


@dataclass(frozen=True)
class Taught:
    """The least that counts as basic actions; no file is read, so the numbers are known here."""

    trajectories: list[np.ndarray]
    dt_s: float = 0.1


@pytest.fixture
def taught():
    """Three actions of eight joints: joint k swings k + 1 times by 0.5 rad, at most 1.5 rad/s."""
    time = np.linspace(0.0, 1.0, 40)
    actions = []
    for k in range(3):
        angles = np.zeros((40, 8))
        angles[:, k] = 0.5 * (1 - np.cos(2 * np.pi * (k + 1) * time))
        actions.append(angles)
    return Taught(actions)


@pytest.fixture
def blends(taught):
    """A small map: 200 mixtures of the basic actions, some of them too fast and some at rest."""
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.full(3, 0.5), size=200) * rng.uniform(0.0, 2.2, size=(200, 1))
    weights[:10] = 0.0
    return np.einsum("na,atj->ntj", weights, np.array(taught.trajectories))
