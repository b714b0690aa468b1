"""A value of a wrong kind, handed to any public function of the room, raises one of our errors that names it."""

import numpy as np
import pytest

from creative_nao import load_memory, train
from creative_nao.errors import CreativeNaoError
from creative_nao.model import (
    NetworkSettings,
    TrainingSettings,
    reproduction,
    split_memories,
    split_of,
    train_many,
    train_network,
    walk,
)

TINY = NetworkSettings(layer_sizes=(3,), time_constants=(2.0,), n_softmax_units=2)
RAGGED = [[0.0, 0.0], [0.0]]
NO_POINTS = {
    "text": [["a", 1]], "ragged": RAGGED, "none": None, "complex": np.zeros((1, 2), complex),
    "masked": np.ma.masked_array(np.zeros((1, 2)), mask=True), "nan": [[np.nan, 0]], "object": {"pb": 1},
    "infinite": [[np.inf, 0]], "dates": np.zeros((1, 2), "datetime64[s]"),
}  # fmt: skip


@pytest.mark.parametrize("points", NO_POINTS.values(), ids=NO_POINTS)
def test_points_of_a_wrong_kind_are_named(tiny_memory, points):
    on_a_line = lambda p: walk(tiny_memory, p, 2)  # noqa: E731
    for name, call in (("pb", tiny_memory.generate), ("points", tiny_memory.generate_path), ("points", on_a_line)):
        with pytest.raises(CreativeNaoError, match=f"`{name}` should"):
            call(points)


@pytest.mark.parametrize("trajectory", ["x", None, RAGGED, np.zeros((5, 8), complex), np.ma.zeros((5, 8)), 3.0])
def test_a_movement_of_a_wrong_kind_is_named(tiny_memory, trajectory):
    with pytest.raises(CreativeNaoError, match="`trajectory` should"):
        tiny_memory.infer_pb(trajectory)


@pytest.mark.parametrize("value", [2.5, "3", True, None, [1], np.nan, 10**50])
def test_settings_of_a_wrong_kind_are_named(tiny_memory, waves, value):
    movement, point = tiny_memory.demonstrations.trajectories[0], np.zeros((1, 2))
    calls = {
        "n_restarts": lambda: tiny_memory.infer_pb(movement, n_restarts=value),
        "n_screen": lambda: tiny_memory.infer_pb(movement, n_screen=value),
        "n_points": lambda: walk(tiny_memory, point, value),
        "checkpoint_interval": lambda: train_network(waves, TrainingSettings(), TINY, checkpoint_interval=value),
        "seed": lambda: train(waves, seed=value, network=TINY),
        "n_epochs": lambda: train(waves, n_epochs=value, network=TINY),
        "n_workers": lambda: train_many(waves, [TrainingSettings(n_epochs=1)], TINY, n_workers=value or 0),
    }
    if value is not None:
        calls["n_steps"] = lambda: tiny_memory.generate(point, value)
    for name, call in calls.items():
        with pytest.raises(CreativeNaoError, match=f"`{name}` should"):
            call()
    with pytest.raises(CreativeNaoError, match="`infer_initial_state` should be true or false"):
        tiny_memory.infer_pb(movement, infer_initial_state="no")


def test_arguments_of_a_wrong_class_are_named(tiny_memory, waves):
    for name, call in {
        "name": lambda: load_memory(3),
        "path": lambda: tiny_memory.save(None),
        "checkpoint": lambda: train_network(waves, TrainingSettings(), TINY, checkpoint=3),
        "split": lambda: split_memories(["train"]),
        "demonstrations": lambda: train(None),
        "network": lambda: train(waves, network={"n_pb": 2}, n_epochs=1),
        "training": lambda: train_network(waves, {"n_epochs": 1}),
        "wanted": lambda: train_many(waves, [3]),
        "seeds": lambda: train(waves, seeds=5, network=TINY),
        "memory": lambda: walk("half/0", [[0, 0]], 3),
        "layer_sizes": lambda: NetworkSettings(layer_sizes=7),
        "n_pb": lambda: NetworkSettings(n_pb="2"),
    }.items():
        with pytest.raises(CreativeNaoError, match=f"`{name}`"):
            call()
    with pytest.raises(CreativeNaoError, match="`memory` should be of the class Memory"):
        reproduction(None)
    with pytest.raises(CreativeNaoError, match="`name` should be text"):
        split_of(3)
    with pytest.raises(CreativeNaoError, match="no memory"):
        load_memory("half\0")
    assert split_of("none of them") == "none"
