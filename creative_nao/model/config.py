"""Settings of the network and of its training. The defaults are the paper's, or the choices of docs/decisions.md.

Also here:
- The learnable numbers of a PB-MTRNN as one flat vector, and what lies where in it.
- How the closed-loop ratio changes over training (Eq. 5): constant as in the paper, annealed, or random per epoch.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Literal

import numpy as np

from creative_nao.errors import FileFormatError, SettingsError
from creative_nao.fields import Fields

MAX_LAYERS = 64
MAX_NEURONS = 20_000
"""Of all layers together: their weights then take 1.6 GB."""
MAX_TIME_CONSTANT = 1e6
SIGMA_RANGE = (1e-6, 1e6)


@dataclasses.dataclass(frozen=True)
class NetworkSettings:
    """Shape of a PB-MTRNN and its initial values; sizes of input and output follow from the joints."""

    layer_sizes: tuple[int, ...] = (40, 20, 10)
    """Number of neurons in P_F, P_M and P_S, from fast to slow; any number of layers."""
    time_constants: tuple[float, ...] = (2.0, 4.0, 8.0)
    """Time constant of each layer [ticks], at least 1 (Eq. 2); P_I and P_O have 1."""
    n_pb: int = 2
    """Number of parametric-bias units."""
    n_softmax_units: int = 10
    """Softmax units per joint (Eq. 6)."""
    sigma: float = 0.5
    """Width of the softmax code (Eq. 6), in the unit that `sigma_unit` names."""
    sigma_unit: Literal["spacing2", "rad2"] = "spacing2"
    """`spacing2`: relative to the squared spacing of the reference angles; `rad2`: in rad^2."""
    weight_scale: float = 0.5
    """Initial weights are normal with standard deviation weight_scale / sqrt(fan-in)."""
    pb_weight_scale: float = 0.1
    """Initial PB weights are normal with standard deviation pb_weight_scale / sqrt(n_pb)."""

    def __post_init__(self) -> None:
        """Check every field."""
        object.__setattr__(self, "layer_sizes", tuple(self.layer_sizes))
        object.__setattr__(self, "time_constants", tuple(float(c) for c in self.time_constants))
        layers = f"1 to {MAX_LAYERS} layers"
        _require(1 <= len(self.layer_sizes) <= MAX_LAYERS, "layer_sizes", layers, self.layer_sizes)
        _require(all(_is_count(n) for n in self.layer_sizes), "layer_sizes", "positive whole numbers", self.layer_sizes)
        _require(
            len(self.time_constants) == len(self.layer_sizes),
            "time_constants",
            f"one per layer, {len(self.layer_sizes)}",
            self.time_constants,
        )
        _require(self.n_hidden <= MAX_NEURONS, "layer_sizes", f"at most {MAX_NEURONS} neurons", self.layer_sizes)
        within = all(1 <= c <= MAX_TIME_CONSTANT for c in self.time_constants)
        _require(within, "time_constants", f">= 1 and <= {MAX_TIME_CONSTANT:g}", self.time_constants)
        few = _is_count(self.n_pb) and self.n_pb <= MAX_NEURONS
        _require(few, "n_pb", f"a whole number >= 1 and <= {MAX_NEURONS}", self.n_pb)
        _require(
            _is_count(self.n_softmax_units) and 2 <= self.n_softmax_units <= MAX_NEURONS,
            "n_softmax_units",
            f"a whole number >= 2 and <= {MAX_NEURONS}",
            self.n_softmax_units,
        )
        low, high = SIGMA_RANGE
        for field in ("sigma", "weight_scale", "pb_weight_scale"):
            value = getattr(self, field)
            _require(low <= value <= high, field, f"a positive number from {low:g} to {high:g}", value)
        _require(self.sigma_unit in ("spacing2", "rad2"), "sigma_unit", "`spacing2` or `rad2`", self.sigma_unit)

    @property
    def n_hidden(self) -> int:
        """Number of neurons in all layers between input and output."""
        return sum(self.layer_sizes)


@dataclasses.dataclass(frozen=True)
class TrainingSettings:
    """How a network is trained: backpropagation through time with Adam, the best epoch kept."""

    closed_loop_ratio: float = 0.5
    """Share of the network's own prediction in its input (Eq. 5): 0 open, 0.5 half closed, 1 closed loop."""
    schedule: Literal["constant", "annealed", "random"] = "constant"
    """`constant`; `annealed`: from 0 up to `closed_loop_ratio` over `anneal_epochs`; `random`: drawn for each epoch
    between 0 and `closed_loop_ratio`."""
    anneal_epochs: int = 50_000
    """Epochs over which an annealed ratio rises."""
    n_epochs: int = 100_000
    """Number of passes over all actions."""
    learning_rate: float = 0.001
    """Step size of Adam (betas 0.9 and 0.999, epsilon 1e-8)."""
    seed: int = 0
    """Seed of the initial weights; nothing else in training is random."""
    engine: Literal["fused", "reference"] = "fused"
    """`fused`: compiled epoch with hand-derived gradients; `reference`: readable torch autograd, slower."""

    def __post_init__(self) -> None:
        """Check every field."""
        _require(0 <= self.closed_loop_ratio <= 1, "closed_loop_ratio", "from 0 to 1", self.closed_loop_ratio)
        schedules = ("constant", "annealed", "random")
        _require(self.schedule in schedules, "schedule", "`constant`, `annealed` or `random`", self.schedule)
        _require(_is_count(self.anneal_epochs), "anneal_epochs", "a whole number >= 1", self.anneal_epochs)
        _require(_is_count(self.n_epochs), "n_epochs", "a whole number >= 1", self.n_epochs)
        _require(0 < self.learning_rate < math.inf, "learning_rate", "a positive number", self.learning_rate)
        _require(isinstance(self.seed, int) and self.seed >= 0, "seed", "a whole number >= 0", self.seed)
        _require(self.engine in ("fused", "reference"), "engine", "`fused` or `reference`", self.engine)


def _is_count(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 1


def _require(good: bool, field: str, expected: str, came: object) -> None:
    if not good:
        raise SettingsError(f"`{field}` should be {expected}, but is {came!r}")


def settings_from_header(cls: type, fields: Any, where: str) -> Any:
    """Build settings of type `cls` from a file's JSON object.

    Raises:
        FileFormatError: If a field is unknown, of the wrong type or out of range; the message starts with `where`.
    """
    found = Fields(fields, f"{where}: {cls.__name__} in its header")
    kinds = {field.name: str(field.type) for field in dataclasses.fields(cls)}
    found.only(kinds)
    try:
        return cls(**{name: _typed(found, name, kinds[name]) for name in found.values})
    except SettingsError as error:
        raise FileFormatError(f"{found.where}: {error}") from error


def _typed(found: Fields, name: str, kind: str) -> Any:
    """Return a field as its annotation wants it."""
    if kind == "int":
        return found.whole(name)
    if kind == "float":
        return found.number(name)
    if not kind.startswith("tuple["):
        return found.text(name)
    numbers = found.listed(name, most=MAX_LAYERS)
    allowed = (int,) if kind.startswith("tuple[int") else (int, float)
    if any(type(number) not in allowed for number in numbers):
        raise found.refuse(name, "a list of numbers" if float in allowed else "a list of whole numbers")
    return tuple(numbers)


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


_STREAM = 1
"""Keeps the draws of the ratio apart from those of the initial weights, which use the same seed."""


def closed_loop_ratios(training: TrainingSettings, start: int, stop: int) -> np.ndarray:
    """Return the closed-loop ratio of each epoch from `start` to `stop`, counted from 0.

    The ratio of an epoch depends on the settings alone, not on where a run was interrupted or how long it is.

    Args:
        training: `closed_loop_ratio`, `schedule`, `anneal_epochs` and `seed` matter.
        start: First epoch.
        stop: Epoch after the last.

    Returns:
        Shape (stop - start,), float64, in [0, 1].
    """
    final = training.closed_loop_ratio
    if training.schedule == "annealed":
        return final * np.minimum(np.arange(start, stop) / training.anneal_epochs, 1.0)
    if training.schedule == "random":
        rng = np.random.default_rng([training.seed, _STREAM])
        return final * rng.uniform(size=stop)[start:]
    return np.full(stop - start, final)


def candidates(training: TrainingSettings, ratios: np.ndarray) -> np.ndarray:
    """Tell which epochs may be the best one: those whose ratio lies within a tenth of the one asked for.

    The loss is easier at a lower ratio, so that losses of different ratios say nothing about each other.

    Args:
        training: The settings.
        ratios: Closed-loop ratio of each epoch.

    Returns:
        Shape of `ratios`, bool; all True for a constant ratio.
    """
    return ratios >= 0.9 * training.closed_loop_ratio
