import numpy as np
import pytest
import torch

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.maps import pb_grid
from creative_nao.model.network import PBMTRNN


def reference_generation(memory, pb, n_steps):
    """Closed loop with the readable network."""
    net = PBMTRNN(memory.network, memory.encoding.n_codes, memory.demonstrations.n_actions)
    net.load_parameter_vector(np.concatenate([array.ravel() for array in memory.parameters.values()]))
    codes = torch.zeros(len(pb), n_steps, memory.encoding.n_codes)
    codes[:, 0] = torch.from_numpy(memory.encoding.encode(memory.demonstrations.initial_posture).astype(np.float32))
    with torch.no_grad():
        predicted = net(codes, 1.0, torch.from_numpy(pb.astype(np.float32))).exp().numpy()
    return memory.encoding.decode(predicted)


def test_generation_equals_the_readable_network(tiny_memory):
    pb = np.random.default_rng(0).uniform(-1, 1, (70, 2))

    generated = tiny_memory.generate(pb)

    np.testing.assert_allclose(generated[:, 1:], reference_generation(tiny_memory, pb, 50), atol=2e-4)
    assert np.ptp(generated, axis=1).max() > 0.1  # it does move


def test_a_point_has_the_same_bits_alone_in_a_batch_and_in_the_map(tiny_memory):
    pb = pb_grid(40)  # 1600 points: several blocks, several threads
    together = tiny_memory.generate(pb)

    alone = np.concatenate([tiny_memory.generate(pb[k : k + 1]) for k in range(0, 1600, 100)])
    few = np.concatenate([tiny_memory.generate(pb[k : k + 7]) for k in range(0, 1600, 100)])

    assert np.array_equal(alone, together[::100])
    assert np.array_equal(few, np.concatenate([together[k : k + 7] for k in range(0, 1600, 100)]))


def test_every_movement_begins_in_the_mean_first_posture(tiny_memory):
    generated = tiny_memory.generate(np.zeros((1, 2)))

    assert np.array_equal(generated[0, 0], tiny_memory.demonstrations.initial_posture)


def test_a_longer_generation_begins_like_a_shorter_one(tiny_memory):
    pb = np.array([[0.3, -0.7]])

    assert np.array_equal(tiny_memory.generate(pb, n_steps=80)[:, :30], tiny_memory.generate(pb, n_steps=30))


@pytest.mark.parametrize(
    ("pb", "message"),
    [
        (np.zeros(2), r"`pb` should have shape \(n, 2\), but has \(2,\)"),
        (np.zeros((3, 4)), r"`pb` should have shape \(n, 2\), but has \(3, 4\)"),
        (np.array([[0.0, 0.0], [0.0, 1.5]]), r"should lie in \[-1, 1\], but row 1 is \[0.0, 1.5\]"),
        (np.array([[np.nan, 0.0]]), "row 0 is"),
    ],
)
def test_bad_points_are_named(tiny_memory, pb, message):
    with pytest.raises(ShapeError, match=message):
        tiny_memory.generate(pb)


def test_no_steps_is_an_error(tiny_memory):
    with pytest.raises(SettingsError, match="`n_steps` should be at least 1, but is 0"):
        tiny_memory.generate(np.zeros((1, 2)), n_steps=0)
