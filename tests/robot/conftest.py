import mujoco
import numpy as np
import pytest

from creative_nao.demonstrations import load_demonstrations
from creative_nao.robot import Performer, Scene


@pytest.fixture(scope="session")
def scene():
    """Shared and never changed: tests that change the model build their own."""
    return Scene()


@pytest.fixture(scope="session")
def performer(scene):
    return Performer(scene)


@pytest.fixture(scope="session")
def demos():
    return load_demonstrations()


@pytest.fixture(scope="session")
def performances(performer, demos):
    return {
        name: performer.perform(trajectory, demos.dt_s, keep_frames=True)
        for name, trajectory in zip(demos.names, demos.trajectories, strict=True)
    }


@pytest.fixture
def data(scene):
    return mujoco.MjData(scene.model)


@pytest.fixture(scope="session")
def still(performer):
    """The guard, held for three seconds."""
    return np.repeat(performer.guard[None], 21, axis=0)
