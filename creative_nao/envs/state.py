"""The exact state of an environment as plain values and arrays: to go back to, to copy, to keep in a file."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao.errors import FileFormatError, SettingsError
from creative_nao.tensorfile import load_tensors, save_tensors

KIND = "environment-state"


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

    def check(self, kind: str) -> None:
        """Refuse a state of another environment.

        Raises:
            SettingsError: Naming both.
        """
        if self.kind != kind:
            raise SettingsError(f"`state` should be one of a {kind}, but is one of a {self.kind}")

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the state to one safetensors file and return its path."""
        return save_tensors(path, kind=KIND, header={"of": self.kind, "values": self.values}, tensors=self.arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> EnvState:
        """Read a file of `save`.

        Raises:
            NotFoundError: If there is no such file.
            FileFormatError: If it is torn or foreign.
        """
        header, arrays = load_tensors(path, kind=KIND)
        if not isinstance(header.get("of"), str) or not isinstance(header.get("values"), dict):
            raise FileFormatError(f"{path}: the header of the {KIND} lacks a field")
        return cls(header["of"], header["values"], arrays)


def generator_state(rng: np.random.Generator | None) -> dict[str, Any] | None:
    """Return the state of a generator as JSON-able values."""
    return None if rng is None else dict(rng.bit_generator.state)


def generator_from(state: dict[str, Any] | None) -> np.random.Generator | None:
    """Return a generator in this state.

    Raises:
        SettingsError: If it is no state of Gymnasium's generator.
    """
    if state is None:
        return None
    bits = np.random.PCG64()
    try:
        bits.state = state  # pyright: ignore[reportAttributeAccessIssue]
    except (TypeError, ValueError, KeyError) as error:
        raise SettingsError(f"`state` should hold a state of numpy's PCG64, but does not: {error}") from error
    return np.random.Generator(bits)
