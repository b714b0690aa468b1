"""Settings of the network and of its training, its learnable numbers, the state of training, and the ratio of Eq. 5.

The defaults are the paper's, or the choices of docs/decisions.md.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Annotated, Any, Literal, TypeVar

import numpy as np

from creative_nao.errors import SettingsError, shown
from creative_nao.schema import Count, Field, Positive, Seed, UnitInterval, record

MAX_LAYERS = 64
MAX_NEURONS = 20_000  # of all layers together: their weights then take 1.6 GB
MAX_TIME_CONSTANT = 1e6

TimeConstant = Annotated[float, Field(ge=1, le=MAX_TIME_CONSTANT)]
Scale = Annotated[float, Field(ge=1e-6, le=1e6)]
Kind = TypeVar("Kind")


@record
class NetworkSettings:
    """Shape of a PB-MTRNN and its initial values; sizes of input and output follow from the joints."""

    layer_sizes: Annotated[tuple[Count, ...], Field(min_length=1, max_length=MAX_LAYERS)] = (40, 20, 10)
    """Number of neurons in P_F, P_M and P_S, from fast to slow; any number of layers."""
    time_constants: tuple[TimeConstant, ...] = (2.0, 4.0, 8.0)
    """Time constant of each layer [ticks], at least 1 (Eq. 2); P_I and P_O have 1."""
    n_pb: Annotated[int, Field(ge=1, le=MAX_NEURONS)] = 2
    """Number of parametric-bias units."""
    n_softmax_units: Annotated[int, Field(ge=2, le=MAX_NEURONS)] = 10
    """Softmax units per joint (Eq. 6)."""
    sigma: Scale = 0.5
    """Width of the softmax code (Eq. 6), in the unit that `sigma_unit` names."""
    sigma_unit: Literal["spacing2", "rad2"] = "spacing2"
    """`spacing2`: relative to the squared spacing of the reference angles; `rad2`: in rad^2."""
    weight_scale: Scale = 0.5
    """Initial weights are normal with standard deviation weight_scale / sqrt(fan-in)."""
    pb_weight_scale: Scale = 0.1
    """Initial PB weights are normal with standard deviation pb_weight_scale / sqrt(n_pb)."""

    def __post_init__(self) -> None:
        """Check what the layers have in common."""
        n_layers = len(self.layer_sizes)
        if len(self.time_constants) != n_layers:
            raise SettingsError(f"`time_constants` should be one per layer, {n_layers}, but is {self.time_constants}")
        if self.n_hidden > MAX_NEURONS:
            raise SettingsError(f"`layer_sizes` should be at most {MAX_NEURONS} neurons, but is {self.layer_sizes}")

    @property
    def n_hidden(self) -> int:
        """Number of neurons in all layers between input and output."""
        return sum(self.layer_sizes)


@record
class TrainingSettings:
    """How a network is trained: backpropagation through time with Adam, the best epoch kept."""

    closed_loop_ratio: UnitInterval = 0.5
    """Share of the network's own prediction in its input (Eq. 5): 0 open, 0.5 half closed, 1 closed loop."""
    schedule: Literal["constant", "annealed", "random"] = "constant"
    """`constant`; `annealed`: from 0 up to `closed_loop_ratio` over `anneal_epochs`; `random`: drawn for each epoch
    between 0 and `closed_loop_ratio`."""
    anneal_epochs: Count = 50_000
    """Epochs over which an annealed ratio rises."""
    n_epochs: Count = 100_000
    """Number of passes over all actions."""
    learning_rate: Positive = 0.001
    """Step size of Adam (betas 0.9 and 0.999, epsilon 1e-8)."""
    seed: Seed = 0
    """Seed of the initial weights; nothing else in training is random."""
    engine: Literal["fused", "reference"] = "fused"
    """`fused`: compiled epoch with hand-derived gradients; `reference`: readable torch autograd, slower."""
    first_input: Literal["own", "mean"] = "own"
    """What the network reads at tick 0 of training: each action's own first posture, as in the paper, or the mean of
    them, as in generation."""
    ending: Literal["free", "held"] = "free"
    """What is asked of an action between its end and that of the longest one: nothing, or to stay in its last posture.
    """
    attempt: Count = 1
    """Which of the seed's draws of initial weights it begins with, counted from 1."""
    condition: Literal["given", "auto"] = "given"
    """`given`: one training with these settings; `auto`: several, `attempts`, until every action comes back."""


AUTO = {"closed_loop_ratio": 1.0, "first_input": "mean", "ending": "held"}
"""Settings of the condition `auto`; docs/decisions.md tells why."""
FIRST_ATTEMPT_EPOCHS = 20_000
"""Epochs of the first attempt of `auto`; the later ones have twice as many as the one before."""


def attempts(training: TrainingSettings) -> tuple[TrainingSettings, ...]:
    """Return the trainings that a condition stands for, in order; of several, the first that succeeds counts.

    `auto` trains with the settings `AUTO` from other initial weights each time, for 20,000 epochs, then 40,000, and so
    on, as far as `n_epochs` reaches. Any other condition is itself.
    """
    if training.condition == "given":
        return (training,)
    found: list[TrainingSettings] = []
    left, length = training.n_epochs, FIRST_ATTEMPT_EPOCHS
    while left:
        n_epochs = min(left, length)
        if 0 < left - n_epochs < FIRST_ATTEMPT_EPOCHS:  # what is left over would be too short
            n_epochs = left
        values: dict[str, Any] = {**AUTO, "n_epochs": n_epochs, "attempt": len(found) + 1, "condition": "given"}
        found.append(dataclasses.replace(training, **values))
        left, length = left - n_epochs, 2 * length
    return tuple(found)


def check_kind(value: Any, kind: type[Kind], name: str) -> Kind:
    """Return an argument of a public function that has to be of a class; else a `SettingsError` names it."""
    if not isinstance(value, kind):
        raise SettingsError(f"`{name}` should be of the class {kind.__name__}, but is {shown(value)}")
    return value


_RATIOS, _ATTEMPTS = 1, 2  # keep a seed's draws of ratios and of later attempts apart from its initial weights

Shapes = dict[str, tuple[int, ...]]


def parameter_shapes(settings: NetworkSettings, n_codes: int, n_actions: int) -> Shapes:
    """Return name and shape of every parameter, in the order of the flat vector.

    Rows are presynaptic units and columns postsynaptic ones: `w_in` P_I to P_F, `w_out` P_F to P_O, `w_hidden` among
    P_F, P_M and P_S (zero where layers are not neighbours), `w_pb` PB to all of them; `b_out` and `b_hidden` biases;
    `rho` the internal states of the PB units, one row per action (Eq. 1).
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
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes.values()])
    parts = np.split(vector, ends[:-1])
    return {name: part.reshape(shape) for (name, shape), part in zip(shapes.items(), parts, strict=True)}


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


def initial_vector(settings: NetworkSettings, n_codes: int, n_actions: int, seed: int, attempt: int = 1) -> np.ndarray:
    """Draw the initial parameters: small random weights, zero biases and zero rho (docs/decisions.md).

    A weight has standard deviation weight_scale / sqrt(fan-in), a PB weight pb_weight_scale / sqrt(n_pb). With PB
    weights of order 1 all learned PB vectors stay near the origin and the map degenerates.

    Returns:
        Shape (n_parameters,), float32. One seed and attempt, one vector.
    """
    rng = np.random.default_rng(seed if attempt == 1 else [seed, _ATTEMPTS, attempt])
    shapes = parameter_shapes(settings, n_codes, n_actions)
    vector = np.zeros(n_parameters(shapes), dtype=np.float32)
    parameters = views(vector, shapes)
    n_fast = settings.layer_sizes[0]
    mask = neighbour_mask(settings)
    fan_in = mask.sum(axis=0)
    fan_in[:n_fast] += n_codes  # P_F has input from P_I too
    scale, pb_scale = settings.weight_scale, settings.pb_weight_scale
    parameters["w_in"][:] = scale * rng.standard_normal((n_codes, n_fast)) / np.sqrt(fan_in[:n_fast])
    parameters["w_out"][:] = scale * rng.standard_normal((n_fast, n_codes)) / np.sqrt(n_fast)
    parameters["w_hidden"][:] = scale * rng.standard_normal(mask.shape) * mask / np.sqrt(fan_in)
    parameters["w_pb"][:] = pb_scale * rng.standard_normal(shapes["w_pb"]) / np.sqrt(settings.n_pb)
    return vector


VECTORS = ("vector", "first_moment", "second_moment", "best_vector")


@dataclasses.dataclass
class TrainingState:
    """Everything that decides how training goes on: saved in a checkpoint, a resumed run gives the same bits."""

    vector: np.ndarray  # parameters, (n_parameters,) float32
    first_moment: np.ndarray  # Adam's running mean of the gradient
    second_moment: np.ndarray  # Adam's running mean of the squared gradient
    best_vector: np.ndarray  # parameters of the epoch with the lowest loss so far
    loss_history: np.ndarray  # loss of each epoch done (Eq. 4, summed over actions), (epoch,) float64
    best_loss: float = math.inf
    best_epoch: int = 0

    @property
    def epoch(self) -> int:
        """Number of epochs done."""
        return len(self.loss_history)

    @property
    def vectors(self) -> list[np.ndarray]:
        """The four vectors in the order of `VECTORS`."""
        return [getattr(self, name) for name in VECTORS]

    @classmethod
    def initial(
        cls, settings: NetworkSettings, n_codes: int, n_actions: int, seed: int, attempt: int = 1
    ) -> TrainingState:
        """Return the state before the first epoch."""
        vector = initial_vector(settings, n_codes, n_actions, seed, attempt)
        return cls(vector, np.zeros_like(vector), np.zeros_like(vector), vector.copy(), np.zeros(0))


def closed_loop_ratios(training: TrainingSettings, start: int, stop: int) -> np.ndarray:
    """Return the closed-loop ratio of each epoch from `start` (counted from 0) up to `stop`, float64 in [0, 1].

    The ratio of an epoch depends on the settings alone, not on where a run was interrupted or how long it is.
    """
    final = training.closed_loop_ratio
    if training.schedule == "annealed":
        return final * np.minimum(np.arange(start, stop) / training.anneal_epochs, 1.0)
    if training.schedule == "random":
        rng = np.random.default_rng([training.seed, _RATIOS])
        return final * rng.uniform(size=stop)[start:]
    return np.full(stop - start, final)


def candidates(training: TrainingSettings, ratios: np.ndarray) -> np.ndarray:
    """Return which epochs, given by their ratios, may be the best: those within a tenth of the ratio asked for.

    The loss is easier at a lower ratio, so that losses of different ratios say nothing about each other.
    """
    return ratios >= 0.9 * training.closed_loop_ratio
