"""One memory behind the page: movements at PB points and paths, what they are worth, and in words."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass

import numpy as np

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.joints import JOINTS
from creative_nao.maps import PBMap
from creative_nao.maps.figure_style import action_letter
from creative_nao.measures import Attribution, attribution, excursion_limit, excursions, score, speed_limits
from creative_nao.measures.attribution import WINDOW_S
from creative_nao.measures.outcome import APPROPRIATE
from creative_nao.model import Memory


@dataclass(frozen=True, eq=False)
class Recall:
    """A movement that a memory made, and what it is worth."""

    points: np.ndarray  # in the PB space, shape (n, 2); a path has more than one
    trajectory: np.ndarray  # joint angles [rad], shape (n_steps, 8)
    outcome: str  # `learned`, `unlearned`, `fluctuating` or `non_moving`
    nearest: int  # index of the basic action most like it
    novelty: float  # DTW distance to that one [rad]
    speeds: np.ndarray  # of each joint between ticks [rad/s], shape (n_steps - 1, 8)

    @property
    def pb(self) -> tuple[float, float]:
        """Where the PB ends."""
        return float(self.points[-1, 0]), float(self.points[-1, 1])


class MemoryService:
    """A memory behind a lock: worker threads of many browser tabs ask it one after the other.

    SettingsError if the memory has other than the eight arm joints or two PB units.
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
        """Generate the movement at a PB point or along several; ShapeError unless they are (n, 2) in [-1, 1]."""
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2 or not len(points) or not (np.abs(points) <= 1).all():
            raise ShapeError(f"`points` should have shape (n, 2) and lie in [-1, 1], but is {points.tolist()}")
        with self._lock:
            memory = self.memory
            trajectory = memory.generate(points)[0] if len(points) == 1 else memory.generate_path(points)
            return self.evaluate(points, trajectory)

    def recognise(self, trajectory: np.ndarray) -> tuple[np.ndarray, float, Recall]:
        """Return the PB point most like a recording [rad], (n_steps, 8), the DTW left [rad], and it scored."""
        with self._lock:
            inferred = self.memory.infer_pb(trajectory)
            return inferred.pb, float(inferred.error), self.evaluate(inferred.pb[None], trajectory)

    def evaluate(self, points: np.ndarray, trajectory: np.ndarray) -> Recall:
        """Score a movement [rad], shape (n_steps, 8), of PB points, shape (n, 2)."""
        scores = score(trajectory[None], self.memory.demonstrations)
        return Recall(
            points, trajectory, str(scores.outcome[0]), int(scores.nearest[0]), float(scores.novelty[0]),
            np.abs(np.diff(trajectory, axis=0)) / self.memory.dt_s,
        )  # fmt: skip


NEAR = 0.12  # how far `more_like` steps, as standard deviation in each PB unit
FAR_SHARE = 0.9  # `less_like` draws from the farthest tenth


def surprise(pb_map: PBMap, rng: np.random.Generator) -> np.ndarray:
    """Return a random point whose movement is appropriate and new, shape (2,); SettingsError if there is none."""
    return _draw(pb_map, pb_map.outcome == "unlearned", rng)


def more_like(pb_map: PBMap, liked: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return an appropriate point near one of those liked, shape (n, 2): a mutated child of one of them."""
    squared = ((pb_map.pb - liked[rng.integers(len(liked))]) ** 2).sum(axis=1) / NEAR**2
    return _draw(pb_map, np.where(squared > 1e-12, np.exp(-squared / 2), 0.0) * pb_map.appropriate, rng)


def less_like(pb_map: PBMap, disliked: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return an appropriate point far from all of those disliked, shape (n, 2)."""
    distance = np.min([((pb_map.pb - point) ** 2).sum(axis=1) for point in disliked], axis=0)
    usable = pb_map.appropriate
    return _draw(
        pb_map, usable & (distance >= np.quantile(distance[usable], FAR_SHARE)) if usable.any() else usable, rng
    )


def _draw(pb_map: PBMap, weight: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    total = float(weight.sum())
    if not total > 0:
        raise SettingsError("this memory's map has no such movement")
    return pb_map.pb[rng.choice(len(weight), p=weight / total)].copy()


def as_coordinate(value: object) -> float:
    """Return a PB coordinate in [-1, 1] from anything a browser sends; what is no finite number gives 0."""
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return 0.0
    return min(1.0, max(-1.0, number)) if math.isfinite(number) else 0.0


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
ALL_WORDS = OUTCOME_WORDS | BODY_WORDS


def spoken(name: str) -> str:
    """Return the name of a basic action as it is read aloud: `left_jab` is left jab."""
    return name.replace("_", " ")


def describe(recall: Recall, service: MemoryService, digits: int = 3) -> str:
    """Return one sentence for the eye and for a screen reader; the PB has so many decimals."""
    where = f"PB {recall.pb[0]:.{digits}f}, {recall.pb[1]:.{digits}f}"
    if len(recall.points) > 1:
        where = f"path of {len(recall.points)} points to {where}"
    letter, name = action_letter(recall.nearest), spoken(service.names[recall.nearest])
    verdict = "appropriate" if recall.outcome in APPROPRIATE else "inappropriate"
    text = f"{where}; {verdict}, {OUTCOME_WORDS[recall.outcome]}; nearest {letter} {name}; novelty {recall.novelty:.1f}"
    if recall.outcome == "fluctuating":
        excess = recall.speeds / service.limit_rad_s
        tick, joint = np.unravel_index(int(excess.argmax()), excess.shape)
        speed, limit, seconds = recall.speeds[tick, joint], service.limit_rad_s[joint], tick * service.memory.dt_s
        text += f"; {JOINTS[joint]} reaches {speed:.1f} rad/s at {seconds:.2f} s, the limit is {limit:.1f}"
    if recall.outcome == "non_moving":
        limit, travelled = excursion_limit(service.memory.demonstrations), float(excursions(recall.trajectory[None])[0])
        text += f"; the widest joint travels {travelled:.3f} rad, {limit:.3f} are needed"
    return text


def attribute(recall: Recall, service: MemoryService) -> Attribution:
    """Compare a movement with the basic actions; at a coarse tick the window is two ticks long."""
    memory = service.memory
    return attribution(recall.trajectory, memory.demonstrations, max(WINDOW_S, 2 * memory.dt_s))


def sentence(resemblance: Attribution, names: tuple[str, ...]) -> str:
    """Return what the strip shows in words, for instance ``Resembles A left jab to 2.2 s, then C left hook.``."""
    stretches = resemblance.stretches()
    parts = [f"{action_letter(stretch.action)} {spoken(names[stretch.action])}" for stretch in stretches]
    ends = [f" to {(stretch.end - 0.5) * resemblance.dt_s:.1f} s" for stretch in stretches[:-1]]
    return "Resembles " + ", then ".join(a + b for a, b in zip(parts, [*ends, ""], strict=True)) + "."
