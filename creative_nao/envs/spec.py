"""What Gymnasium is told of an environment before and after it is made: its length, its arguments as JSON."""

from __future__ import annotations

import dataclasses
import json
import os
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from gymnasium.envs.registration import EnvSpec

from creative_nao.errors import SettingsError

if TYPE_CHECKING:  # it loads numba, which registering an environment should not
    from creative_nao.envs.observation import Parts


class EpisodeLength(int):
    """Steps of an episode as a registered environment tells them: `gymnasium.spec(name).max_episode_steps`.

    The environments end their episodes themselves. Gymnasium's TimeLimit, which this number brings along, would know
    neither the argument `n_actions` nor that `set_state` takes steps back; so no count of steps is at or beyond it.
    """

    __slots__ = ()

    def __le__(self, other: object) -> bool:
        return False


class EpisodeSpec(EnvSpec):
    """Specification of a made environment; `max_episode_steps` is the length of its own episodes."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name == "max_episode_steps" and isinstance(value, EpisodeLength)):  # of the registered environment
            super().__setattr__(name, value)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, EnvSpec) and vars(self) == vars(other)

    __hash__ = None  # pyright: ignore[reportAssignmentType]

    def to_json(self) -> str:
        """Return it as JSON, from which ``EnvSpec.from_json`` makes an equal one.

        Raises:
            SettingsError: If an argument is no JSON, such as a memory that is neither a name nor a file.
        """
        for name, value in self.kwargs.items():
            is_settings: bool = dataclasses.is_dataclass(value)
            try:
                json.dumps(dataclasses.asdict(cast(Any, value)) if is_settings else value)
            except (TypeError, ValueError):
                raise SettingsError(
                    f"`{name}` should be a name, a file or other JSON, for the environment to be described as JSON, "
                    f"but is a {type(value).__name__}"
                ) from None
        return super().to_json()


class Specified:
    """Base of an environment that tells the length of its episodes in its `spec`."""

    _spec: EpisodeSpec | None = None

    @property
    def n_decisions(self: Any) -> int:
        """Steps that one action takes."""
        return self._batch.n_decisions

    @property
    def max_episode_steps(self: Any) -> int:
        """Most steps of an episode."""
        return self._batch.n_episode_steps

    @property
    def observation_parts(self: Any) -> Parts:
        """Parts of an observation, in order."""
        return self._batch.parts

    @property
    def try_columns(self: Any) -> Parts:
        """Columns of one try in the part `tries` of the observation; none where it has no such part."""
        return self._batch.columns

    @property
    def spec(self) -> EnvSpec | None:
        """What the environment was made with by `gymnasium.make` or `make_vec`, else None."""
        return self._spec

    @spec.setter
    def spec(self: Any, spec: EnvSpec | None) -> None:
        if spec is None:
            self._spec = None
            return
        values: dict[str, Any] = {
            field.name: getattr(spec, field.name) for field in dataclasses.fields(spec) if field.init
        }
        values["max_episode_steps"] = self.max_episode_steps
        values["kwargs"] = {
            name: os.fspath(value) if isinstance(value, os.PathLike) else value
            for name, value in spec.kwargs.items()
            if name != "max_episode_steps"
        }
        self._spec = EpisodeSpec(**values)


def leave_text_as_it_is() -> None:
    """Have Gymnasium's wrappers NumpyToTorch, JaxToTorch, ... leave texts in `info` as they are, which they refuse."""
    try:
        from gymnasium.wrappers.array_conversion import array_conversion
    except Exception:  # Gymnasium's own error: array-api-compat is not installed, and so there are no such wrappers
        return
    numbers = array_conversion.dispatch(np.ndarray)

    def convert(value: np.ndarray, xp: Any, device: Any = None) -> Any:
        if value.dtype.kind not in "OU":
            return numbers(value, xp, device)
        converted = value.copy()
        for place, one in np.ndenumerate(value):
            converted[place] = array_conversion(one, xp, device)
        return converted

    array_conversion.register(np.ndarray, convert)
    array_conversion.register(str, lambda value, *_, **__: value)
