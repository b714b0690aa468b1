"""The learnable numbers of a PB-MTRNN as one flat vector, and what lies where in it.

Both engines, the optimizer and the file format work on the same vector, so they cannot disagree about its order.
"""

from __future__ import annotations

import numpy as np

from creative_nao.model.config import NetworkSettings

Shapes = dict[str, tuple[int, ...]]


def parameter_shapes(settings: NetworkSettings, n_codes: int, n_actions: int) -> Shapes:
    """Return name and shape of every parameter, in the order of the flat vector.

    Rows are senders and columns receivers: `w_in` P_I to P_F, `w_out` P_F to P_O, `w_hidden` among P_F, P_M and P_S
    (zero where layers are not neighbours), `w_pb` PB to all of them; `b_out` and `b_hidden` biases; `rho` the internal
    states of the PB units, one row per action (Eq. 1).
    """
    n_fast, n_hidden = settings.layer_sizes[0], settings.n_hidden
    return {
        "w_in": (n_codes, n_fast),
        "w_out": (n_fast, n_codes),
        "w_hidden": (n_hidden, n_hidden),
        "w_pb": (settings.n_pb, n_hidden),
        "b_out": (n_codes,),
        "b_hidden": (n_hidden,),
        "rho": (n_actions, settings.n_pb),
    }


def views(vector: np.ndarray, shapes: Shapes) -> dict[str, np.ndarray]:
    """Return the parameters by name as views into the flat `vector`: writing to one writes to the vector."""
    found, start = {}, 0
    for name, shape in shapes.items():
        size = int(np.prod(shape))
        found[name] = vector[start : start + size].reshape(shape)
        start += size
    return found


def n_parameters(shapes: Shapes) -> int:
    """Return the length of the flat vector."""
    return sum(int(np.prod(shape)) for shape in shapes.values())


def neighbour_mask(settings: NetworkSettings) -> np.ndarray:
    """Return (n_hidden, n_hidden) float32: 1 where two neurons are in the same or in neighbouring layers, else 0."""
    layer = np.repeat(np.arange(len(settings.layer_sizes)), settings.layer_sizes)
    return (np.abs(layer[:, None] - layer[None, :]) <= 1).astype(np.float32)


def layer_time_constants(settings: NetworkSettings) -> np.ndarray:
    """Return the time constant of every hidden neuron [ticks], shape (n_hidden,) float32."""
    return np.repeat(np.array(settings.time_constants, dtype=np.float32), settings.layer_sizes)


def initial_vector(settings: NetworkSettings, n_codes: int, n_actions: int, seed: int) -> np.ndarray:
    """Draw the initial parameters: small random weights, zero biases and zero rho (docs/decisions.md).

    A weight has standard deviation weight_scale / sqrt(fan-in), a PB weight pb_weight_scale / sqrt(n_pb). With PB
    weights of order 1 all learned PB vectors stay near the origin and the map degenerates.

    Returns:
        Shape (n_parameters,), float32. One seed, one vector.
    """
    rng = np.random.default_rng(seed)
    shapes = parameter_shapes(settings, n_codes, n_actions)
    vector = np.zeros(n_parameters(shapes), dtype=np.float32)
    parameters = views(vector, shapes)
    n_fast = settings.layer_sizes[0]
    mask = neighbour_mask(settings)
    fan_in = mask.sum(axis=0)
    fan_in[:n_fast] += n_codes  # P_F also hears P_I
    parameters["w_in"][:] = settings.weight_scale * rng.standard_normal((n_codes, n_fast)) / np.sqrt(fan_in[:n_fast])
    parameters["w_out"][:] = settings.weight_scale * rng.standard_normal((n_fast, n_codes)) / np.sqrt(n_fast)
    parameters["w_hidden"][:] = settings.weight_scale * rng.standard_normal(mask.shape) * mask / np.sqrt(fan_in)
    parameters["w_pb"][:] = (
        settings.pb_weight_scale * rng.standard_normal(parameters["w_pb"].shape) / np.sqrt(settings.n_pb)
    )
    return vector
