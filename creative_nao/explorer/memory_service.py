"""One memory behind the page: movements at PB points and paths, what they are worth, in words and as SVG."""

from __future__ import annotations

import html
import math
import threading
from dataclasses import dataclass

import numpy as np

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.joints import JOINTS, LIMITS_RAD
from creative_nao.maps import PBMap
from creative_nao.maps.figure_style import action_colour, action_letter, rgb
from creative_nao.measures import Attribution, Stretch, attribution, excursion_limit, excursions, score, speed_limits
from creative_nao.measures.attribution import WINDOW_S
from creative_nao.measures.outcome import APPROPRIATE
from creative_nao.model import Memory


@dataclass(frozen=True, eq=False)
class Recall:
    """A movement that a memory made, and what it is worth.

    Attributes:
        points: Where in the PB space it comes from, shape (n, 2); a path has more than one point.
        trajectory: Joint angles [rad], shape (n_steps, 8).
        outcome: `learned`, `unlearned`, `fluctuating` or `non_moving`.
        nearest: PageAddress of the basic action most like it.
        novelty: DTW distance to that one [rad].
        speeds: Speed of each joint between ticks [rad/s], shape (n_steps - 1, 8).
    """

    points: np.ndarray
    trajectory: np.ndarray
    outcome: str
    nearest: int
    novelty: float
    speeds: np.ndarray

    @property
    def pb(self) -> tuple[float, float]:
        """Where the PB ends."""
        return float(self.points[-1, 0]), float(self.points[-1, 1])

    @property
    def appropriate(self) -> bool:
        """Whether a robot can use it."""
        return self.outcome in APPROPRIATE


class MemoryService:
    """A memory behind a lock: worker threads of many browser tabs ask it one after the other.

    Args:
        memory: A memory with two PB units and the eight arm joints.

    Raises:
        SettingsError: If the memory has other joints or another number of PB units.
    """

    def __init__(self, memory: Memory) -> None:
        if memory.network.n_pb != 2:
            raise SettingsError(
                f"the explorer shows memories with n_pb = 2, but {memory.name} has {memory.network.n_pb}"
            )
        if memory.joints != JOINTS:
            raise SettingsError(
                f"the explorer shows memories of the eight arm joints {', '.join(JOINTS)}, "
                f"but {memory.name} has {', '.join(memory.joints)}"
            )
        self.memory = memory
        self.limit_rad_s = speed_limits(memory.demonstrations)
        self._lock = threading.Lock()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the basic actions."""
        return self.memory.demonstrations.names

    def recall(self, points: np.ndarray) -> Recall:
        """Let the memory move at a PB point, or along several.

        Args:
            points: Shape (n, 2) in [-1, 1]; with more than one, the PB moves from each to the next.

        Raises:
            ShapeError: If `points` has another shape, is not finite or leaves [-1, 1].
        """
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2 or not len(points) or not (np.abs(points) <= 1).all():
            raise ShapeError(f"`points` should have shape (n, 2) and lie in [-1, 1], but is {points.tolist()}")
        with self._lock:
            alone = len(points) == 1
            trajectory = self.memory.generate(points)[0] if alone else self.memory.generate_path(points)
            return self._judged(points, trajectory)

    def judge(self, points: np.ndarray, trajectory: np.ndarray) -> Recall:
        """Say what a movement from elsewhere is worth, for instance a recording [rad], shape (n_steps, 8)."""
        with self._lock:
            return self._judged(np.asarray(points, dtype=np.float64), trajectory)

    def recognise(self, trajectory: np.ndarray) -> tuple[np.ndarray, float, Recall]:
        """Find the point of the memory most like a recording [rad] at the memory's tick, shape (n_steps, 8).

        Returns:
            The PB point, the DTW distance left [rad], and the recording itself, judged.
        """
        with self._lock:
            found = self.memory.infer_pb(trajectory)
            return found.pb, float(found.error), self._judged(found.pb[None], trajectory)

    def _judged(self, points: np.ndarray, trajectory: np.ndarray) -> Recall:
        scores = score(trajectory[None], self.memory.demonstrations)
        return Recall(
            points, trajectory, str(scores.outcome[0]), int(scores.nearest[0]), float(scores.novelty[0]),
            np.abs(np.diff(trajectory, axis=0)) / self.memory.dt_s,
        )  # fmt: skip


NEAR = 0.12
"""How far `more_like` steps, as standard deviation in each PB unit."""
FAR_SHARE = 0.9
"""`less_like` draws from the farthest tenth."""


def surprise(chart: PBMap, rng: np.random.Generator) -> np.ndarray:
    """Return a random point whose movement is appropriate and new, shape (2,).

    Raises:
        SettingsError: If the map has no such point.
    """
    return _draw(chart, (chart.outcome == "unlearned").astype(float), rng)


def more_like(chart: PBMap, liked: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return an appropriate point near one of those liked, shape (n, 2): a mutated child of one of them."""
    parent = liked[rng.integers(len(liked))]
    squared = ((chart.pb - parent) ** 2).sum(axis=1) / NEAR**2
    return _draw(chart, np.where(squared > 1e-12, np.exp(-squared / 2), 0.0) * chart.appropriate, rng)


def less_like(chart: PBMap, shunned: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return an appropriate point far from all of those shunned, shape (n, 2)."""
    distance = np.min([((chart.pb - one) ** 2).sum(axis=1) for one in shunned], axis=0)
    usable = np.flatnonzero(chart.appropriate)
    weight = np.zeros(len(chart.pb))
    if usable.size:
        weight[usable] = distance[usable] >= np.quantile(distance[usable], FAR_SHARE)
    return _draw(chart, weight, rng)


def way(learned_pb: np.ndarray, first: int, last: int) -> np.ndarray:
    """Return the path from one basic action's point to another's, shape (2, 2)."""
    return np.array([learned_pb[first], learned_pb[last]])


def _draw(chart: PBMap, weight: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    total = float(weight.sum())
    if not total > 0:
        raise SettingsError("this memory's map has no such movement")
    return chart.pb[rng.choice(len(weight), p=weight / total)].copy()


def as_coordinate(value: object, otherwise: float = 0.0) -> float:
    """Return a PB coordinate in [-1, 1] from anything a browser sends; what is no finite number gives `otherwise`."""
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return otherwise
    return min(1.0, max(-1.0, number)) if math.isfinite(number) else otherwise


OUTCOME_WORDS = {
    "learned": "like a basic action",
    "unlearned": "new: nobody taught it",
    "fluctuating": "too fast for the motors",
    "non_moving": "hardly moves",
}
BODY_WORDS = {
    "joint_limit": "beyond a joint's range",
    "torque_saturated": "motors at their limit",
    "tracking_error": "the arms cannot follow",
    "self_collision": "touches itself",
    "fell": "falls",
}
"""What only a body adds."""


def spoken(name: str) -> str:
    """Return the name of a basic action as it is read aloud: `left_jab` is left jab."""
    return name.replace("_", " ")


def describe(recall: Recall, service: MemoryService, digits: int = 3) -> str:
    """Return one sentence for the eye and for a screen reader; the PB has so many decimals."""
    where = f"PB {recall.pb[0]:.{digits}f}, {recall.pb[1]:.{digits}f}"
    if len(recall.points) > 1:
        where = f"path of {len(recall.points)} points to {where}"
    letter, name = action_letter(recall.nearest), spoken(service.names[recall.nearest])
    verdict = "appropriate" if recall.appropriate else "inappropriate"
    text = f"{where}; {verdict}, {OUTCOME_WORDS[recall.outcome]}; nearest {letter} {name}; novelty {recall.novelty:.1f}"
    why = reason(recall, service)
    return f"{text}; {why}" if why else text


def reason(recall: Recall, service: MemoryService) -> str:
    """Return why a movement is inappropriate, with the figures, or an empty string."""
    if recall.outcome == "fluctuating":
        excess = recall.speeds / service.limit_rad_s
        tick, joint = np.unravel_index(int(excess.argmax()), excess.shape)
        speed, seconds = recall.speeds[tick, joint], tick * service.memory.dt_s
        limit = service.limit_rad_s[joint]
        return f"{service.memory.joints[joint]} reaches {speed:.1f} rad/s at {seconds:.2f} s, the limit is {limit:.1f}"
    if recall.outcome == "non_moving":
        limit = excursion_limit(service.memory.demonstrations)
        travelled = float(excursions(recall.trajectory[None])[0])
        return f"the widest joint travels {travelled:.3f} rad, {limit:.3f} are needed"
    return ""


HALF_RAD = 0.2
"""Distance per posture at which half of the colour is left [rad]."""
MAX_STOPS = 60
"""Colours along one stretch, so that a long recording does not become a long page."""
LETTER_PCT = 4.0
"""Narrowest stretch that has room for its letter, in percent of the strip."""


def attribute(recall: Recall, service: MemoryService) -> Attribution:
    """Compare a movement with the basic actions; at a coarse tick the window is two ticks long."""
    memory = service.memory
    return attribution(recall.trajectory, memory.demonstrations, max(WINDOW_S, 2 * memory.dt_s))


def sentence(found: Attribution, names: tuple[str, ...]) -> str:
    """Return what the strip shows in words, for instance ``Resembles A left jab to 2.2 s, then C left hook.``."""
    stretches = found.stretches()
    parts = [f"{action_letter(one.action)} {spoken(names[one.action])}" for one in stretches]
    ends = [f" to {(one.end - 0.5) * found.dt_s:.1f} s" for one in stretches[:-1]]
    return "Resembles " + ", then ".join(a + b for a, b in zip(parts, [*ends, ""], strict=True)) + "."


def strip_html(recall: Recall, service: MemoryService) -> str:
    """Return the strip and its sentence as HTML; a cursor follows the CSS variable ``--robot-t``."""
    found = attribute(recall, service)
    parts = "".join(_stretch(one, found, service.names) for one in found.stretches())
    text = html.escape(sentence(found, service.names))
    return (
        f'<div class="cn-strip" aria-hidden="true">{parts}<i class="cn-strip-cursor"></i></div>'
        f'<div class="cn-legend cn-resembles">{text}</div>'
    )


def _stretch(one: Stretch, found: Attribution, names: tuple[str, ...]) -> str:
    last = max(len(found) - 1, 1)
    begin, end = (100 * min(max(tick - 0.5, 0), last) / last for tick in (one.first, one.end))
    if one.end == len(found):
        end = 100.0
    letter = action_letter(one.action) if end - begin >= LETTER_PCT else ""
    red, green, blue = (round(255 * channel) for channel in rgb(action_colour(one.action)))
    ticks = np.unique(np.linspace(one.first, one.end - 1, MAX_STOPS).round().astype(int))
    strength = 0.15 + 0.85 * 2.0 ** (-found.distances[ticks, one.action] / HALF_RAD)
    stops = [f"rgba({red},{green},{blue},{value:.2f})" for value in strength]
    shades = ",".join(stops if len(stops) > 1 else stops * 2)
    title = html.escape(f"{spoken(names[one.action])}, {one.distance:.2f} rad away", quote=True)
    return (
        f'<b title="{title}" style="left:{begin:.2f}%;width:{end - begin:.2f}%;'
        f'background:linear-gradient(90deg,{shades})">{letter}</b>'
    )


PANEL_W, PANEL_H = 150, 78
LEFT, TOP = 20, 16
WIDTH, HEIGHT = LEFT + PANEL_W + 4, TOP + PANEL_H + 4
ORDER = (4, 5, 6, 7, 0, 1, 2, 3)
"""Left arm above the right, as columns of a trajectory."""
LOW_RAD, HIGH_RAD = -2.2, 2.2


def curves_svg(recall: Recall, service: MemoryService) -> str:
    """Return the curves as one SVG a joint; colours follow the page, and a cursor the CSS variable ``--robot-t``."""
    basic = service.memory.demonstrations.trajectories[recall.nearest]
    n_ticks = max(len(recall.trajectory), len(basic), 2)
    share = (len(recall.trajectory) - 1) / (n_ticks - 1)
    panels = []
    for joint in ORDER:
        parts = [frame(joint), polyline(basic[:, joint], n_ticks, "cn-basic")]
        parts.append(polyline(recall.trajectory[:, joint], n_ticks, "cn-made"))
        fast = recall.speeds[:, joint] > service.limit_rad_s[joint] * (1 + 1e-12)
        parts += [_overspeed(recall.trajectory[t : t + 2, joint], int(t), n_ticks) for t in np.flatnonzero(fast)]
        shift = f"translateX(calc(var(--robot-t, 0) * {PANEL_W * share:.1f}px))"
        parts.append(f'<line class="cn-cursor" y2="{PANEL_H}" style="transform:{shift}"/>')
        too_fast = ", too fast" if fast.any() else ""
        panels.append(
            f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" xmlns="http://www.w3.org/2000/svg" role="img" '
            f'aria-label="{JOINTS[joint]} over time{too_fast}"><g transform="translate({LEFT} {TOP})">'
            f"{''.join(parts)}</g></svg>"
        )
    seconds = (n_ticks - 1) * service.memory.dt_s
    legend = (
        f"Angles in rad over {seconds:.2f} s. Solid: this movement; dashed: nearest basic action; dotted: limits; "
        f"red: faster than {service.limit_rad_s.max():.1f} rad/s."
    )
    return f'<div class="cn-curves">{"".join(panels)}</div><div class="cn-legend">{legend}</div>'


def frame(joint: int) -> str:
    """Return name, box, limits and ticks of a joint's panel."""
    name = JOINTS[joint]
    lines = [
        f'<text class="cn-name" x="0" y="-4">{name}</text>',
        f'<rect class="cn-panel" width="{PANEL_W}" height="{PANEL_H}"/>',
        *(
            f'<line class="cn-limit" x2="{PANEL_W}" y1="{height_of(v):.1f}" y2="{height_of(v):.1f}"/>'
            for v in LIMITS_RAD[name]
        ),
        *(f'<text class="cn-tick" x="-4" y="{height_of(v) + 3:.1f}" text-anchor="end">{v}</text>' for v in (-2, 0, 2)),
    ]
    return "".join(lines)


def height_of(angle: float) -> float:
    """Return where an angle [rad] lies in a panel, from its top."""
    return PANEL_H * (HIGH_RAD - angle) / (HIGH_RAD - LOW_RAD)


def _points(angles: np.ndarray, first: int, n_ticks: int) -> str:
    return " ".join(f"{PANEL_W * (first + k) / (n_ticks - 1):.1f},{height_of(a):.1f}" for k, a in enumerate(angles))


def polyline(angles: np.ndarray, n_ticks: int, kind: str) -> str:
    """Return the angles of one joint [rad], shape (n,), as a line of a class."""
    return f'<polyline class="{kind}" points="{_points(angles, 0, n_ticks)}"/>'


def _overspeed(angles: np.ndarray, tick: int, n_ticks: int) -> str:
    return f'<polyline class="cn-overspeed" points="{_points(angles, tick, n_ticks)}"/>'
