"""Settings of the network and of its training. The defaults are the paper's, or the choices of docs/decisions.md."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Literal

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
