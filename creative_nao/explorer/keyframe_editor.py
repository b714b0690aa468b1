"""Demonstrations made in the page: key postures at times, joined like the shipped ones. Nothing changes in place.

A `KeyframeSet` holds `Draft`s, a draft holds `Key`s. Everything is checked where it is made, so that what a browser
sends or keeps for us is either sound or refused with one line.
"""

from __future__ import annotations

import io
import json
import re
from base64 import b64encode
from dataclasses import dataclass, replace

import numpy as np
from PIL import Image

from creative_nao.demonstrations import Demonstrations
from creative_nao.demonstrations.keyframes import ACTIONS, DT_S, GUARD, Movement, both_arms, keyframes
from creative_nao.errors import FileFormatError, SettingsError
from creative_nao.explorer.memory_service import (
    HEIGHT,
    LEFT,
    ORDER,
    PANEL_H,
    PANEL_W,
    TOP,
    WIDTH,
    frame,
    height_of,
    polyline,
    spoken,
)
from creative_nao.joints import JOINTS, MAX_SPEED_RAD_S, MIRROR_SIGN, N_JOINTS, limits
from creative_nao.maps import PBMap
from creative_nao.maps.figure_style import action_letter
from creative_nao.maps.picture import map_image
from creative_nao.measures import Criteria, dtw_matrix
from creative_nao.storage import as_json

MAX_DRAFTS = 8
MAX_KEYS = 24
MAX_DURATION_S = 12.0
MIN_GAP_S = 0.05
"""Shortest time between two keys [s]."""
MAX_TEXT = 60_000
"""Characters of the largest keyframes as text."""
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
class KeyframeSet:
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

    def with_draft(self, place: int, draft: Draft) -> KeyframeSet:
        """Put a draft at a place, which may be the one behind the last."""
        return KeyframeSet((*self.drafts[:place], draft, *self.drafts[place + 1 :]))

    def without(self, place: int) -> KeyframeSet:
        """Remove a draft."""
        return KeyframeSet(self.drafts[:place] + self.drafts[place + 1 :])

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
        """Return the keyframes as JSON."""
        return json.dumps(
            [[d.name, [[k.time_s, *(round(a, 6) for a in k.posture)] for k in d.keys]] for d in self.drafts]
        )

    @classmethod
    def from_text(cls, text: str) -> KeyframeSet:
        """Read a keyframes back.

        Raises:
            FileFormatError: If it is none.
            SettingsError: If it breaks a bound.
        """
        if not isinstance(text, str) or len(text) > MAX_TEXT:
            raise FileFormatError(f"a keyframes is text of at most {MAX_TEXT} characters")
        try:
            rows = as_json(text, "keyframes")
            drafts = [
                Draft(name, tuple(Key(float(k[0]), tuple(map(float, k[1:]))) for k in keys)) for name, keys in rows
            ]
        except SettingsError:
            raise
        except (TypeError, ValueError, IndexError, KeyError, OverflowError) as error:
            raise FileFormatError(f"not a keyframes of demonstrations: {error}") from error
        return cls(tuple(drafts))


def blank(name: str = "my_move") -> Draft:
    """Return a draft that holds the guard for a second and a half: something to begin with."""
    guard = tuple(float(angle) for angle in both_arms(GUARD, GUARD))
    return Draft(name, (Key(0.0, guard), Key(1.5, guard)))


def boxing() -> KeyframeSet:
    """Return the key postures of the six shipped basic actions."""
    drafts = []
    for name in ACTIONS:
        movement = keyframes(name)
        pairs = zip(movement.times_s.round(2), movement.postures, strict=True)
        drafts.append(Draft(name, tuple(Key(float(time), tuple(map(float, posture))) for time, posture in pairs)))
    return KeyframeSet(tuple(drafts))


def _mirror(posture: tuple[float, ...]) -> tuple[float, ...]:
    right, left = np.array(posture[:4]), np.array(posture[4:])
    return tuple(float(angle) for angle in np.concatenate([left * MIRROR_SIGN, right * MIRROR_SIGN]))


MIN_DURATION_S = 0.6
MIN_EXCURSION_RAD = 0.1
"""What the widest joint should travel at least [rad]."""
START_TOLERANCE_RAD = 0.3
"""How far a demonstration may start from the mean start of all [rad]: a memory starts all its movements there."""
PEAK_OF_MEAN = 1.875
"""Largest speed of a minimum-jerk segment, as a multiple of its mean speed."""


def peak_speeds(draft: Draft) -> np.ndarray:
    """Return the largest speed of each joint between two keys [rad/s], shape (n_keys - 1, 8)."""
    movement = draft.movement()
    return PEAK_OF_MEAN * np.abs(np.diff(movement.postures, axis=0)) / np.diff(movement.times_s)[:, None]


def fault(draft: Draft) -> str | None:
    """Return what is wrong with a draft, one line, or None if it can be taught."""
    speeds, limit = peak_speeds(draft), np.array([MAX_SPEED_RAD_S[joint] for joint in JOINTS])
    excess = speeds / limit
    if excess.max() > 1:
        segment, joint = np.unravel_index(int(excess.argmax()), excess.shape)
        begin, end = draft.keys[segment].time_s, draft.keys[segment + 1].time_s
        needed = (end - begin) * excess[segment, joint]
        return (
            f"{spoken(draft.name)}: {JOINTS[joint]} reaches {speeds[segment, joint]:.1f} rad/s between {begin:.2f} and "
            f"{end:.2f} s, its motor {limit[joint]:.1f}; give it {np.ceil(100 * needed) / 100:.2f} s"
        )
    if draft.duration_s < MIN_DURATION_S:
        return f"{spoken(draft.name)}: lasts {draft.duration_s:.2f} s, expected {MIN_DURATION_S} s or more"
    travelled = float(np.ptp(draft.trajectory(), axis=0).max())
    if travelled < MIN_EXCURSION_RAD:
        return (
            f"{spoken(draft.name)}: hardly moves, its widest joint travels {travelled:.2f} rad, expected "
            f"{MIN_EXCURSION_RAD} or more; add a key and drag the sliders"
        )
    return None


def shortcomings(keyframes: KeyframeSet) -> list[str]:
    """Return what keeps the set from being taught, one line each; empty when all is well."""
    found = [one for one in map(fault, keyframes.drafts) if one]
    if len(keyframes.drafts) < 2:
        return [*found, "a memory needs two demonstrations or more; add one, or the mirror image of the first"]
    every = np.concatenate([draft.trajectory() for draft in keyframes.drafts])
    still = [joint for joint, span in zip(JOINTS, np.ptp(every, axis=0), strict=True) if not span > 0]
    if still:
        found.append(f"{', '.join(still)} never moves in any demonstration; add a mirror image, or move it somewhere")
    return found


def advice(keyframes: KeyframeSet) -> list[str]:
    """Return what will make a memory worse, though it can be taught, one line each."""
    if len(keyframes.drafts) < 2:
        return []
    found = []
    starts = np.array([draft.keys[0].posture for draft in keyframes.drafts])
    away = np.abs(starts - starts.mean(axis=0))
    for draft, one in zip(keyframes.drafts, away, strict=True):
        if one.max() > START_TOLERANCE_RAD:
            found.append(
                f"{spoken(draft.name)} starts {one.max():.2f} rad from the mean start at {JOINTS[int(one.argmax())]}; "
                "a memory starts all its movements in one posture"
            )
    distances = dtw_matrix([draft.trajectory() for draft in keyframes.drafts])
    threshold = Criteria().learned_threshold
    for i, j in zip(*np.triu_indices(len(distances), 1), strict=True):
        if distances[i, j] < threshold:
            names = f"{spoken(keyframes.drafts[i].name)} and {spoken(keyframes.drafts[j].name)}"
            found.append(f"{names} are {distances[i, j]:.1f} apart: within {threshold:g} they count as one movement")
    return found


LOSS_W, LOSS_H = 300, 150


def draft_svg(draft: Draft, place: int) -> str:
    """Return the eight joints of a demonstration as small multiples; the keys are dots, the one at `place` is large."""
    angles = draft.trajectory()
    seconds = (len(angles) - 1) * DT_S
    panels = []
    for joint in ORDER:
        dots = "".join(
            f'<circle class="{"cn-key-now" if k == place else "cn-key-dot"}" cx="{PANEL_W * key.time_s / seconds:.1f}" '
            f'cy="{height_of(key.posture[joint]):.1f}" r="{4 if k == place else 2}"/>'
            for k, key in enumerate(draft.keys)
        )
        shift = f"translateX(calc(var(--robot-t, 0) * {PANEL_W}px))"
        panels.append(
            f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" xmlns="http://www.w3.org/2000/svg" role="img" '
            f'aria-label="{JOINTS[joint]} over time"><g transform="translate({LEFT} {TOP})">{frame(joint)}'
            f"{polyline(angles[:, joint], len(angles), 'cn-made')}{dots}"
            f'<line class="cn-cursor" y2="{PANEL_H}" style="transform:{shift}"/></g></svg>'
        )
    legend = f"Angles in rad over {seconds:.2f} s. Dots: keys, the large one is shown; dotted: limits."
    return f'<div class="cn-curves">{"".join(panels)}</div><div class="cn-legend">{legend}</div>'


def loss_svg(curve: np.ndarray, n_epochs: int) -> str:
    """Return the loss over the epochs, shape (n, 2), on a scale of powers of ten."""
    usable = curve[np.isfinite(curve[:, 1]) & (curve[:, 1] > 0)] if len(curve) else curve
    losses = np.log10(usable[:, 1]) if len(usable) else np.zeros(0)
    low, high = (np.floor(losses.min()), np.ceil(losses.max())) if len(losses) else (0.0, 3.0)
    high = max(high, low + 1)

    def y(value: float) -> float:
        return LOSS_H * (high - value) / (high - low)

    marks = "".join(
        f'<line class="cn-limit" x2="{LOSS_W}" y1="{y(k):.1f}" y2="{y(k):.1f}"/>'
        f'<text class="cn-tick" x="-5" y="{y(k) + 4:.1f}" text-anchor="end">{10.0**k:g}</text>'
        for k in np.arange(low, high + 1)
    )
    points = " ".join(
        f"{LOSS_W * epoch / max(n_epochs, 1):.1f},{y(loss):.1f}"
        for epoch, loss in zip(usable[:, 0], losses, strict=True)
    )
    last = f", now {usable[-1, 1]:.3g}" if len(usable) else ""
    return (
        f'<svg class="cn-loss" viewBox="-42 -8 {LOSS_W + 50} {LOSS_H + 34}" xmlns="http://www.w3.org/2000/svg" '
        f'role="img" aria-label="Loss over {n_epochs} epochs{last}">'
        f'<rect class="cn-panel" width="{LOSS_W}" height="{LOSS_H}"/>{marks}'
        f'<polyline class="cn-made" points="{points}"/>'
        f'<text class="cn-tick" x="0" y="{LOSS_H + 16}">0</text>'
        f'<text class="cn-tick" x="{LOSS_W}" y="{LOSS_H + 16}" text-anchor="end">{n_epochs:,} epochs</text>'
        f'<text class="cn-name" x="6" y="14">Loss</text></svg>'
    )


def grown_map(chart: PBMap | None) -> str:
    """Return the map of what is learned so far, with the letters of the demonstrations, or an empty place for it."""
    if chart is None:
        return '<div class="cn-grown" role="img" aria-label="No map yet"></div>'
    stream = io.BytesIO()
    Image.fromarray(np.round(255 * map_image(chart)[::-1]).astype(np.uint8)).save(stream, format="PNG")
    letters = "".join(
        f'<text x="{100 * (1 + x):.1f}" y="{100 * (1 - y):.1f}" dy="0.35em">{action_letter(place)}</text>'
        for place, (x, y) in enumerate(chart.learned_pb)
    )
    usable = 100 * float(chart.appropriate.mean())
    picture = b64encode(stream.getvalue()).decode()
    return (
        f'<div class="cn-grown" role="img" aria-label="Map of {chart.resolution} by {chart.resolution} points, '
        f'{usable:.0f} % of it appropriate"><img alt="" src="data:image/png;base64,{picture}">'
        f'<svg viewBox="0 0 200 200">{letters}</svg></div>'
    )
