"""Demonstrations made in the page: a set of drafts of key postures, each checked where it is made, none changed."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np

from creative_nao.demonstrations import Demonstrations
from creative_nao.demonstrations.keyframes import ACTIONS, DT_S, Movement, keyframes
from creative_nao.errors import SettingsError
from creative_nao.explorer.registry import spoken
from creative_nao.joints import JOINTS, MAX_SPEED_RAD_S, N_JOINTS, limits
from creative_nao.measures import Criteria, dtw_matrix
from creative_nao.schema import Field, must, record

MAX_DRAFTS = 8
MAX_DURATION_S = 12.0
MAX_KEYS = round(MAX_DURATION_S / DT_S) + 1  # a recording has one at every tick
MIN_GAP_S = 0.05  # shortest time between two keys [s]
_ROUNDING_RAD = 1e-9
MIN_DURATION_S = 0.6
MIN_EXCURSION_RAD = 0.1  # what the widest joint should travel at least [rad]
START_TOLERANCE_RAD = 0.3
"""How far a demonstration may start from the mean start of all [rad]: a memory starts all its movements there."""
PEAK_OF_MEAN = 1.875  # largest speed of a minimum-jerk segment, as a multiple of its mean speed
_is_draft_name = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,23}").fullmatch


KeyRow = Annotated[tuple[float, ...], Field(min_length=1 + N_JOINTS, max_length=1 + N_JOINTS)]
Rows = Annotated[tuple[tuple[str, tuple[KeyRow, ...]], ...], Field(min_length=1)]
"""Demonstrations as text: the name and the keys of each, a key as its time [s] and the angles [rad]."""


@record
class Key:
    """A posture [rad], in the order of `joints.JOINTS`, and when it is reached [s]."""

    time_s: float
    posture: Annotated[tuple[float, ...], Field(min_length=N_JOINTS, max_length=N_JOINTS)]

    def __post_init__(self) -> None:
        """Refuse a posture outside the joints' ranges."""
        low, high = limits()
        if not ((self.posture >= low - _ROUNDING_RAD) & (self.posture <= high + _ROUNDING_RAD)).all():
            raise SettingsError(f"the posture at {self.time_s:g} s should lie in the joints' ranges")


@record
class Draft:
    """A demonstration in the making: 2 to `MAX_KEYS` keys, the first at 0 s, the others `MIN_GAP_S` or more apart."""

    name: Annotated[str, must(_is_draft_name, "a letter, then up to 23 letters, digits or _")]
    keys: tuple[Key, ...]

    def __post_init__(self) -> None:
        """Check number and times of the keys."""
        if not 2 <= len(self.keys) <= MAX_KEYS:
            raise SettingsError(f"{self.name} should have 2 to {MAX_KEYS} keys, but has {len(self.keys)}")
        times = np.array([key.time_s for key in self.keys])
        if times[0] != 0 or not (np.diff(times) >= MIN_GAP_S - 1e-9).all() or not times[-1] <= MAX_DURATION_S:
            raise SettingsError(
                f"{self.name}: the keys should begin at 0 s, follow each other by {MIN_GAP_S} s or more and end by "
                f"{MAX_DURATION_S:g} s, but are at {', '.join(f'{time:g}' for time in times)}"
            )

    @property
    def duration_s(self) -> float:
        """Time from the first key to the last [s]."""
        return self.keys[-1].time_s

    def movement(self) -> Movement:
        """Return the keys joined by minimum-jerk curves."""
        return Movement(np.array([k.time_s for k in self.keys]), np.array([k.posture for k in self.keys]))

    def trajectory(self) -> np.ndarray:
        """Return the joint angles at every tick [rad], shape (n_steps, 8); the last tick reaches the last key."""
        return self.movement().at(np.arange(int(np.ceil(round(self.duration_s / DT_S, 6))) + 1) * DT_S)

    def peak_speeds(self) -> np.ndarray:
        """Return the largest speed of each joint between two keys [rad/s], shape (n_keys - 1, 8).

        A memory is taught postures at the tick: of keys no farther apart, as a recording's, it sees the mean speed.
        """
        movement = self.movement()
        gaps = np.diff(movement.times_s)[:, None]
        return np.where(gaps > DT_S + 1e-9, PEAK_OF_MEAN, 1.0) * np.abs(np.diff(movement.postures, axis=0)) / gaps

    def slowdown(self) -> float:
        """Return how many times slower the whole movement has to be for every motor to follow; 1 if none."""
        return max(1.0, float((self.peak_speeds() / _limits()).max()))

    def fault(self) -> str | None:
        """Return what is wrong, one line, or None if it can be taught."""
        speeds, limit = self.peak_speeds(), _limits()
        excess = speeds / limit
        if excess.max() > 1:
            segment, joint = np.unravel_index(int(excess.argmax()), excess.shape)
            begin, end = self.keys[segment].time_s, self.keys[segment + 1].time_s
            needed = (end - begin) * excess[segment, joint]
            return (
                f"{spoken(self.name)}: {JOINTS[joint]} reaches {speeds[segment, joint]:.1f} rad/s between {begin:.2f} "
                f"and {end:.2f} s, its motor {limit[joint]:.1f}; give it {np.ceil(100 * needed) / 100:.2f} s"
            )
        if self.duration_s < MIN_DURATION_S:
            return f"{spoken(self.name)}: lasts {self.duration_s:.2f} s, expected {MIN_DURATION_S} s or more"
        travelled = float(np.ptp(self.trajectory(), axis=0).max())
        if travelled < MIN_EXCURSION_RAD:
            return (
                f"{spoken(self.name)}: hardly moves, its widest joint travels {travelled:.2f} rad, expected "
                f"{MIN_EXCURSION_RAD} or more; add a key and drag the sliders"
            )
        return None


def _limits() -> np.ndarray:
    return np.array([MAX_SPEED_RAD_S[joint] for joint in JOINTS])


@record
class KeyframeSet:
    """The demonstrations of one tab, at most `MAX_DRAFTS`, no name twice."""

    drafts: tuple[Draft, ...]

    def __post_init__(self) -> None:
        """Check number and names."""
        if len(self.drafts) > MAX_DRAFTS:
            raise SettingsError(f"there may be {MAX_DRAFTS} demonstrations; remove one first")
        names = [draft.name for draft in self.drafts]
        for name in names:
            if names.count(name) > 1:
                raise SettingsError(f"two demonstrations are called {name}; a name may stand once")

    def demonstrations(self) -> Demonstrations:
        """Return the drafts as basic actions at the tick."""
        made_by = {"method": "key postures joined in the explorer's page", "keys": json.loads(self.to_text())}
        names = tuple(draft.name for draft in self.drafts)
        return Demonstrations(names, [draft.trajectory() for draft in self.drafts], DT_S, JOINTS, made_by)

    def shortcomings(self) -> list[str]:
        """Return what keeps the set from being taught, one line each; empty when all is well."""
        faults = [line for line in (draft.fault() for draft in self.drafts) if line]
        if len(self.drafts) < 2:
            return [*faults, "a memory needs two demonstrations or more; add one, or the mirror image of the first"]
        return faults

    def advice(self) -> list[str]:
        """Return what will make a memory worse, though it can be taught, one line each."""
        if len(self.drafts) < 2:
            return []
        lines, names = [], [spoken(draft.name) for draft in self.drafts]
        every = np.concatenate([draft.trajectory() for draft in self.drafts])
        still = [joint for joint, span in zip(JOINTS, np.ptp(every, axis=0), strict=True) if not span > 0]
        if still:
            lines.append(f"{', '.join(still)} never moves in any demonstration and is learned as still")
        starts = np.array([draft.keys[0].posture for draft in self.drafts])
        for name, away in zip(names, np.abs(starts - starts.mean(axis=0)), strict=True):
            if away.max() > START_TOLERANCE_RAD:
                lines.append(
                    f"{name} starts {away.max():.2f} rad from the mean start at {JOINTS[int(away.argmax())]}; "
                    "a memory starts all its movements in one posture"
                )
        distances = dtw_matrix([draft.trajectory() for draft in self.drafts])
        threshold = Criteria().learned_threshold
        for i, j in zip(*np.triu_indices(len(distances), 1), strict=True):
            if distances[i, j] < threshold:
                apart = f"{distances[i, j]:.1f} apart: within {threshold:g} they count as one movement"
                lines.append(f"{names[i]} and {names[j]} are {apart}")
        return lines

    def to_text(self) -> str:
        """Return the set as JSON."""
        return json.dumps(
            [[d.name, [[k.time_s, *(round(a, 6) for a in k.posture)] for k in d.keys]] for d in self.drafts]
        )

    def as_json(self) -> dict[str, Any]:
        """Return what the page shows of the set: each movement, its fault, what the set lacks, and advice."""
        return {
            "dt": DT_S,
            "movements": [draft.trajectory().round(5).tolist() for draft in self.drafts],
            "faults": [draft.fault() for draft in self.drafts],
            "slowdowns": [draft.slowdown() for draft in self.drafts],
            "shortcomings": self.shortcomings(),
            "advice": self.advice()[:4],
        }

    @classmethod
    def from_rows(cls, rows: Sequence[tuple[str, Sequence[Sequence[float]]]]) -> KeyframeSet:
        """Return a set from rows such as `to_text` writes; SettingsError if they break a bound."""
        return cls(tuple(Draft(name, tuple(Key(row[0], tuple(row[1:])) for row in keys)) for name, keys in rows))


def boxing() -> KeyframeSet:
    """Return the key postures of the six shipped basic actions."""
    drafts = []
    for name in ACTIONS:
        movement = keyframes(name)
        pairs = zip(movement.times_s.round(2), movement.postures, strict=True)
        drafts.append(Draft(name, tuple(Key(time_s, tuple(posture)) for time_s, posture in pairs)))
    return KeyframeSet(tuple(drafts))


def ranges() -> list[list[float]]:
    """Return the lowest and the highest angle of each joint [rad]."""
    return np.stack(limits(), axis=1).tolist()
