"""The exact state of an environment as plain values and arrays: to restore, to copy, to keep in a file."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from creative_nao.arrays import load_tensors, save_tensors
from creative_nao.errors import FileFormatError, SettingsError, shown
from creative_nao.model.config import check_kind
from creative_nao.schema import Field, JsonObject, Text, dump, must, parse, record

KIND = "environment-state"
MAX_COUNT = 10**9
MAX_NUMBER = 1e6
"""Largest number of a state, where `_RANGES` says nothing else; MuJoCo calls 1e10 unstable."""
MAX_ANGLE = 1e3
"""Largest joint angle of a movement [rad]."""
_ANGLES = ("accepted", "unfolded", "posture", "candidate_trajectory")
_RANGES = {
    **dict.fromkeys(("observation", "pb_path", "candidate_pb"), (-1.0, 1.0)),
    **dict.fromkeys(_ANGLES, (-MAX_ANGLE, MAX_ANGLE)),
    **dict.fromkeys(("novelty", "pair_sum"), (0.0, 1e9)),
    "network_code": (0.0, 1.01),  # a softmax and a tanh, whose last bits are rounded
    "network_activity": (-1.01, 1.01),
}
"""Least and largest number of each array of a state."""
NETWORK_ARRAYS = ("network_code", "network_state", "network_activity")
"""Arrays whose size depends on the memory that a state names."""
_GROWING = ("accepted", "novelty")


@record
class StateHeader:
    """What the file of a state says beside its arrays; the fields are those of `EnvState`."""

    of: Text
    values: JsonObject


@dataclass(frozen=True, eq=False)
class EnvState:
    """Everything that decides how an episode goes on; what `render` would show is not part of it.

    Attributes:
        kind: Which environment it is of, a class name.
        values: What JSON can hold: the memory's name, counters, the state of the random generator.
        arrays: The rest: observation, repertoire, physics, the network between ticks.
    """

    kind: str
    values: dict[str, Any]
    arrays: dict[str, np.ndarray]

    def __post_init__(self) -> None:
        """Refuse parts of a wrong kind; what is in them is checked where the state is used."""
        for part, kind in (("kind", str), ("values", dict), ("arrays", dict)):
            check_kind(getattr(self, part), kind, part)

    def check(self, like: EnvState) -> None:
        """Refuse a state that does not fit an environment whose present state is `like`, in kind, size or range.

        Raises:
            SettingsError: Naming the part.
        """
        check_kind(self, EnvState, "state")
        if self.kind != like.kind:
            raise SettingsError(f"`state` should be one of a {like.kind}, but is one of a {self.kind}")
        for what, mine, theirs in (("values", self.values, like.values), ("arrays", self.arrays, like.arrays)):
            if surplus := sorted(map(str, mine.keys() ^ theirs.keys())):
                raise SettingsError(
                    f"`state`: its {what} should be {', '.join(sorted(theirs))}; see `{surplus[0][:60]}`"
                )
        for name, example in like.values.items():
            value = self.values[name]
            if name == "random":
                fits = value is None or isinstance(value, dict)  # `generator_from` looks into it
            elif isinstance(example, int):
                fits = type(value) is int and 0 <= value <= MAX_COUNT
            else:
                fits = isinstance(value, str)
            if not fits:
                raise SettingsError(f"`state`: its `{name}` should be like {example!r:.60}, but is {shown(value)}")
        n_accepted = len(self.arrays["accepted"]) if self.arrays["accepted"].ndim else 0
        if n_accepted > self.values["n_actions"]:
            raise SettingsError(f"`state`: {n_accepted} accepted actions of {self.values['n_actions']} cannot be")
        for name, example in like.arrays.items():
            shape = (n_accepted, *example.shape[1:]) if name in _GROWING else example.shape
            array, sized = self.arrays[name], name not in NETWORK_ARRAYS
            if array.ndim != len(shape) or array.dtype != example.dtype or (sized and array.shape != shape):
                raise SettingsError(
                    f"`state`: its array `{name}` should be {example.dtype} of shape {shape}, but is {array.dtype} of "
                    f"{array.shape}"
                )
            low, high = _RANGES.get(name, (-MAX_NUMBER, MAX_NUMBER))
            if array.size and not (low <= array.min() and array.max() <= high):  # false for NaN, too
                raise SettingsError(
                    f"`state`: its array `{name}` should hold numbers from {low:g} to {high:g}, but reaches from "
                    f"{array.min():g} to {array.max():g}"
                )

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the state to one safetensors file and return its path."""
        header = dump(StateHeader(self.kind, self.values))
        return save_tensors(path, kind=KIND, header=header, tensors=self.arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> EnvState:
        """Read a file of `save`; a missing one raises NotFoundError, a torn or foreign one FileFormatError."""
        values, arrays = load_tensors(path, kind=KIND)
        header = parse(StateHeader, values, f"{path}: header")
        for name, array in arrays.items():
            if array.dtype.kind == "f" and not np.isfinite(array).all():
                raise FileFormatError(f"{path}: the array `{name[:60]}` should hold finite numbers, but does not")
        return cls(header.of, {"n_imagined": 0, **header.values}, arrays)  # states of 0.1.0 count none


_Bits128 = Annotated[int, must(lambda number: 0 <= number < 2**128, "a whole number from 0 to 2^128 - 1")]


@record
class _Words:
    state: _Bits128
    inc: Annotated[_Bits128, must(lambda number: number % 2, "an odd number")]


@record
class _GeneratorState:
    """A state of numpy's PCG64, as its `state` tells it."""

    bit_generator: Literal["PCG64"]
    state: _Words
    has_uint32: Annotated[int, Field(ge=0, le=1)]
    uinteger: Annotated[int, Field(ge=0, lt=2**32)]


def generator_state(rng: np.random.Generator | None) -> dict[str, Any] | None:
    """Return the state of a generator as JSON-able values."""
    return None if rng is None else dict(rng.bit_generator.state)


def generator_from(state: dict[str, Any] | None) -> np.random.Generator | None:
    """Return a generator in this state; what is no state of Gymnasium's generator raises SettingsError."""
    if state is None:
        return None
    found = parse(_GeneratorState, state, "`state`: its state of numpy's PCG64", error=SettingsError)
    bits = np.random.PCG64()
    bits.state = dump(found)  # pyright: ignore[reportAttributeAccessIssue]
    return np.random.Generator(bits)
