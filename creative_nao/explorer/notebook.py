"""Demonstrations made in the page: key postures at times, joined like the shipped ones. Nothing here changes in place.

A `Notebook` holds `Draft`s, a draft holds `Key`s. Everything is checked where it is made, so that what a browser sends
or keeps for us is either sound or refused with one line; `notebook_checks.py` tells whether it is fit to be taught.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace

import numpy as np

from creative_nao.demonstrations import Demonstrations
from creative_nao.demonstrations.keyframes import ACTIONS, DT_S, GUARD, Movement, both_arms, keyframes
from creative_nao.errors import FileFormatError, SettingsError
from creative_nao.joints import JOINTS, MIRROR_SIGN, N_JOINTS, limits
from creative_nao.untrusted import as_json

MAX_DRAFTS = 8
MAX_KEYS = 24
MAX_DURATION_S = 12.0
MIN_GAP_S = 0.05
"""Shortest time between two keys [s]."""
MAX_TEXT = 60_000
"""Characters of the largest notebook as text."""
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,23}")
_ROUNDING_RAD = 1e-9


@dataclass(frozen=True)
class Key:
    """A posture [rad], in the order of `joints.JOINTS`, and when it is reached [s]."""

    time_s: float
    posture: tuple[float, ...]


@dataclass(frozen=True)
class Draft:
    """One demonstration in the making.

    Attributes:
        name: A letter, then up to 23 letters, digits or underscores: it will name a file.
        keys: 2 to `MAX_KEYS`, the first at 0 s, each at least `MIN_GAP_S` after the one before.

    Raises:
        SettingsError: If a key or the name is not like that, or a posture leaves the joints' ranges.
    """

    name: str
    keys: tuple[Key, ...]

    def __post_init__(self) -> None:
        """Check everything, since it may come from a browser."""
        if not isinstance(self.name, str) or not _NAME.fullmatch(self.name):
            raise SettingsError(
                f"a name should be a letter, then up to 23 letters, digits or _, but is {self.name!r:.40}"
            )
        if not 2 <= len(self.keys) <= MAX_KEYS:
            raise SettingsError(f"{self.name} should have 2 to {MAX_KEYS} keys, but has {len(self.keys)}")
        times = np.array([key.time_s for key in self.keys], dtype=np.float64)
        if times[0] != 0 or not (np.diff(times) >= MIN_GAP_S - 1e-9).all() or not times[-1] <= MAX_DURATION_S:
            raise SettingsError(
                f"{self.name}: the keys should begin at 0 s, follow each other by {MIN_GAP_S} s or more and end by "
                f"{MAX_DURATION_S:g} s, but are at {', '.join(f'{time:g}' for time in times)}"
            )
        low, high = limits()
        for key in self.keys:
            posture = np.array(key.posture, dtype=np.float64)
            fits = posture.shape == (N_JOINTS,)
            if not fits or not ((posture >= low - _ROUNDING_RAD) & (posture <= high + _ROUNDING_RAD)).all():
                raise SettingsError(
                    f"{self.name}: the posture at {key.time_s:g} s should be {N_JOINTS} angles in the joints' ranges"
                )

    @property
    def duration_s(self) -> float:
        """Time from the first key to the last [s]."""
        return self.keys[-1].time_s

    @property
    def n_steps(self) -> int:
        """Postures of the demonstration, one a tick; the last key is reached within the last tick."""
        return int(np.ceil(round(self.duration_s / DT_S, 6))) + 1

    def movement(self) -> Movement:
        """Return the keys joined by minimum-jerk curves."""
        return Movement(np.array([k.time_s for k in self.keys]), np.array([k.posture for k in self.keys]))

    def trajectory(self) -> np.ndarray:
        """Return the joint angles at every tick [rad], shape (n_steps, 8)."""
        return self.movement().at(np.arange(self.n_steps) * DT_S)

    def with_key(self, time_s: float) -> tuple[Draft, int]:
        """Add a key on the curve as it is, or behind its end, and return the draft and the key's place."""
        time = round(float(time_s), 2)
        posture = tuple(float(angle) for angle in self.movement().at(np.array([time]))[0])
        keys = sorted([*self.keys, Key(time, posture)], key=lambda key: key.time_s)
        return replace(self, keys=tuple(keys)), next(k for k, key in enumerate(keys) if key.time_s == time)

    def without_key(self, place: int) -> Draft:
        """Remove a key; if it is the first, the next becomes the beginning."""
        keys = self.keys[:place] + self.keys[place + 1 :]
        start = keys[0].time_s if keys else 0.0
        return replace(self, keys=tuple(Key(round(key.time_s - start, 2), key.posture) for key in keys))

    def at_time(self, place: int, time_s: float) -> Draft:
        """Move a key in time."""
        return self._with(place, replace(self.keys[place], time_s=round(float(time_s), 2)))

    def posed(self, place: int, joint: int, angle: float) -> Draft:
        """Turn one joint of a key [rad], no farther than its range."""
        low, high = limits()
        posture = list(self.keys[place].posture)
        posture[joint] = min(max(float(angle), low[joint]), high[joint])
        return self._with(place, replace(self.keys[place], posture=tuple(posture)))

    def renamed(self, name: str) -> Draft:
        """Give it another name."""
        return replace(self, name=name)

    def mirrored(self, name: str) -> Draft:
        """Return the same with the arms changed over."""
        return Draft(name, tuple(Key(key.time_s, _mirror(key.posture)) for key in self.keys))

    def _with(self, place: int, key: Key) -> Draft:
        return replace(self, keys=(*self.keys[:place], key, *self.keys[place + 1 :]))


@dataclass(frozen=True)
class Notebook:
    """The demonstrations of one tab, at most `MAX_DRAFTS`, no name twice.

    Raises:
        SettingsError: If there are too many, or a name repeats.
    """

    drafts: tuple[Draft, ...]

    def __post_init__(self) -> None:
        """Check number and names."""
        if len(self.drafts) > MAX_DRAFTS:
            raise SettingsError(f"there may be {MAX_DRAFTS} demonstrations; remove one first")
        names = [draft.name for draft in self.drafts]
        for name in names:
            if names.count(name) > 1:
                raise SettingsError(f"two demonstrations are called {name}; a name may stand once")

    def with_draft(self, place: int, draft: Draft) -> Notebook:
        """Put a draft at a place, which may be the one behind the last."""
        return Notebook((*self.drafts[:place], draft, *self.drafts[place + 1 :]))

    def without(self, place: int) -> Notebook:
        """Remove a draft."""
        return Notebook(self.drafts[:place] + self.drafts[place + 1 :])

    def free_name(self, wish: str) -> str:
        """Return the wish, or the wish with a number, such that no draft is called so."""
        taken = {draft.name for draft in self.drafts}
        tries = (wish[: 24 - len(tail)] + tail for tail in ("", *(f"_{k}" for k in range(2, MAX_DRAFTS + 2))))
        return next(name for name in tries if name not in taken)

    def demonstrations(self) -> Demonstrations:
        """Return the drafts as basic actions at the tick."""
        record = {"method": "key postures joined in the explorer's page", "keys": json.loads(self.to_text())}
        names = tuple(draft.name for draft in self.drafts)
        return Demonstrations(names, [draft.trajectory() for draft in self.drafts], DT_S, JOINTS, record)

    def to_text(self) -> str:
        """Return the notebook as JSON."""
        return json.dumps(
            [[d.name, [[k.time_s, *(round(a, 6) for a in k.posture)] for k in d.keys]] for d in self.drafts]
        )

    @classmethod
    def from_text(cls, text: str) -> Notebook:
        """Read a notebook back.

        Raises:
            FileFormatError: If it is none.
            SettingsError: If it breaks a bound.
        """
        if not isinstance(text, str) or len(text) > MAX_TEXT:
            raise FileFormatError(f"a notebook is text of at most {MAX_TEXT} characters")
        try:
            rows = as_json(text, "notebook")
            drafts = [
                Draft(name, tuple(Key(float(k[0]), tuple(map(float, k[1:]))) for k in keys)) for name, keys in rows
            ]
        except SettingsError:
            raise
        except (TypeError, ValueError, IndexError, KeyError, OverflowError) as error:
            raise FileFormatError(f"not a notebook of demonstrations: {error}") from error
        return cls(tuple(drafts))


def blank(name: str = "my_move") -> Draft:
    """Return a draft that holds the guard for a second and a half: something to begin with."""
    guard = tuple(float(angle) for angle in both_arms(GUARD, GUARD))
    return Draft(name, (Key(0.0, guard), Key(1.5, guard)))


def boxing() -> Notebook:
    """Return the key postures of the six shipped basic actions."""
    drafts = []
    for name in ACTIONS:
        movement = keyframes(name)
        pairs = zip(movement.times_s.round(2), movement.postures, strict=True)
        drafts.append(Draft(name, tuple(Key(float(time), tuple(map(float, posture))) for time, posture in pairs)))
    return Notebook(tuple(drafts))


def _mirror(posture: tuple[float, ...]) -> tuple[float, ...]:
    right, left = np.array(posture[:4]), np.array(posture[4:])
    return tuple(float(angle) for angle in np.concatenate([left * MIRROR_SIGN, right * MIRROR_SIGN]))
