"""A memory: a trained PB-MTRNN with everything needed to use it, in one file.

Also here:
- The memories that come with the package, and finding a memory by name or path.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from creative_nao.arrays import load_tensors, save_tensors, take
from creative_nao.demonstrations import Demonstrations
from creative_nao.demonstrations.files import MAX_STEPS
from creative_nao.errors import (
    CreativeNaoError,
    FileFormatError,
    NotFoundError,
    SettingsError,
    ShapeError,
    nearest_name,
)
from creative_nao.fields import Fields, only_arrays
from creative_nao.model.config import NetworkSettings, TrainingSettings, parameter_shapes, settings_from_header
from creative_nao.model.encoding import SoftmaxEncoding
from creative_nao.model.generation import ClosedLoopGenerator
from creative_nao.model.paths import pb_of_each_tick

if TYPE_CHECKING:
    from creative_nao.model.recognition import Recognition


FORMAT_VERSION = 1
KIND = "memory"
MAX_CURVE_POINTS = 5000
"""A memory keeps at most this many points of its learning curve; a checkpoint keeps all."""


MIN_SPAN_RAD = 1e-9
"""A joint that moves less does not move: its reference angles could not be told apart."""
MAX_WEIGHT = 1e6
"""Largest weight of a memory file; the largest of the shipped bank is 34. Beyond 1e30 sums would overflow."""


@dataclasses.dataclass(frozen=True, eq=False)
class Memory:
    """A robot's memory: every point of its PB space is a movement, the taught ones and, between them, new ones.

    Make one with `creative_nao.train` or `creative_nao.load_memory`.

    Attributes:
        network: Sizes, time constants and code of the network.
        training: How it was trained.
        parameters: Weights by name, float32; shapes as in `model.parameters.parameter_shapes`.
        demonstrations: The basic actions it learned [rad].
        loss_history: Loss (Eq. 4, summed over actions and steps) every `loss_every` epochs.
        loss_every: Epochs from one value of `loss_history` to the next.
        best_epoch: Epoch whose weights are kept, counted from 1.
        best_loss: Its loss.
        record: Command, settings, versions and time of its making.
        name: Shipped name such as ``half/0``, or the file's path, or empty.
    """

    network: NetworkSettings
    training: TrainingSettings
    parameters: dict[str, np.ndarray]
    demonstrations: Demonstrations
    loss_history: np.ndarray
    loss_every: int
    best_epoch: int
    best_loss: float
    record: dict[str, Any]
    name: str = ""

    @property
    def pb(self) -> np.ndarray:
        """Learned PB value of each basic action (Eq. 1), shape (n_actions, n_pb) in (-1, 1), float64."""
        return np.tanh(self.parameters["rho"].astype(np.float64))

    @property
    def closed_loop_ratio(self) -> float:
        """Share of its own prediction that the network read in training (Eq. 5)."""
        return self.training.closed_loop_ratio

    @property
    def joints(self) -> tuple[str, ...]:
        """Name of each joint, in the order of a trajectory's columns."""
        return self.demonstrations.joints

    @property
    def dt_s(self) -> float:
        """Time from one posture to the next [s]."""
        return self.demonstrations.dt_s

    @property
    def n_steps(self) -> int:
        """Ticks of the longest basic action: the default length of generation."""
        return max(len(trajectory) for trajectory in self.demonstrations.trajectories)

    @functools.cached_property
    def encoding(self) -> SoftmaxEncoding:
        """The softmax code of the joints (Eq. 6 and 7)."""
        return encoding_of(self.demonstrations, self.network)

    @functools.cached_property
    def _generator(self) -> ClosedLoopGenerator:
        posture = self.demonstrations.initial_posture
        return ClosedLoopGenerator(self.network, self.parameters, self.encoding, posture)

    def generate(self, pb: np.ndarray, n_steps: int | None = None) -> np.ndarray:
        """Let the network act in its mind, in closed loop, from each PB point.

        Args:
            pb: PB values in [-1, 1], shape (n, n_pb).
            n_steps: Ticks to generate; default: as long as the longest basic action.

        Returns:
            Joint angles [rad], shape (n, n_steps, n_joints), float64; row 0 is the initial posture, the mean first
            posture of the basic actions. A point gives the same bits alone and in any batch.

        Raises:
            ShapeError: If `pb` is not (n, n_pb) or holds values outside [-1, 1].
            SettingsError: If `n_steps` is less than 1.
        """
        points = np.asarray(pb, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != self.network.n_pb:
            raise ShapeError(f"`pb` should have shape (n, {self.network.n_pb}), but has {points.shape}")
        if not (np.abs(points) <= 1).all():
            row = int(np.flatnonzero(~(np.abs(points) <= 1).all(axis=1))[0])
            raise ShapeError(f"`pb` should lie in [-1, 1], but row {row} is {points[row].tolist()}")
        steps = self.n_steps if n_steps is None else n_steps
        if steps < 1:
            raise SettingsError(f"`n_steps` should be at least 1, but is {steps}")
        return self._generator(points, steps)

    def generate_path(
        self, points: ArrayLike, n_steps: int | None = None, at_ticks: Sequence[int] | np.ndarray | None = None
    ) -> np.ndarray:
        """Let one movement unfold while the PB moves in straight lines from point to point.

        The state of the network goes on through every change, so the movement passes smoothly from one into another.

        Args:
            points: Where the PB moves, in [-1, 1], shape (n, n_pb).
            n_steps: Ticks to generate; default: as long as the longest basic action.
            at_ticks: When each point is reached, rising, shape (n,); two points at one tick are a jump. Default:
                evenly from tick 0 to the last.

        Returns:
            Joint angles [rad], shape (n_steps, n_joints); with a single point, what `generate` gives there.

        Raises:
            ShapeError: If `points` is not (n, n_pb) or leaves [-1, 1].
            SettingsError: If `n_steps` is less than 1, or `at_ticks` does not fit.
        """
        pb = pb_of_each_tick(points, self.network.n_pb, self.n_steps if n_steps is None else n_steps, at_ticks)
        return self._generator(pb[None], len(pb))[0]

    def infer_pb(
        self, trajectory: np.ndarray, *, infer_initial_state: bool = False, n_restarts: int = 48, seed: int = 0
    ) -> Recognition:
        """Find the PB value from which this memory generates a movement, or the most similar one it has.

        See `recognition.infer_pb` for how, and for one more option.

        Args:
            trajectory: Joint angles at the memory's tick [rad], shape (n_steps, n_joints), any length from two on.
            infer_initial_state: Whether to start in the given first posture instead of the memory's own, and to seek
                the initial internal state of the slowest layer too.
            n_restarts: Descents side by side.
            seed: One seed, one answer.

        Returns:
            The PB value, the DTW distance of its movement to the given one, that movement, and where else the search
            ended.

        Raises:
            ShapeError: If `trajectory` is not finite or does not have the memory's joints.
            SettingsError: If a setting is out of range.
        """
        from creative_nao.model.recognition import infer_pb

        return infer_pb(self, trajectory, infer_initial_state=infer_initial_state, n_restarts=n_restarts, seed=seed)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the memory to one safetensors file, in one step, and return its path."""
        header = {
            "format_version": FORMAT_VERSION,
            "network": dataclasses.asdict(self.network),
            "training": dataclasses.asdict(self.training),
            "joints": list(self.joints),
            "dt_s": self.dt_s,
            "actions": list(self.demonstrations.names),
            "demonstrations_record": self.demonstrations.record,
            "loss_every": self.loss_every,
            "best_epoch": self.best_epoch,
            "best_loss": self.best_loss,
            "record": self.record,
        }
        tensors = {f"parameter/{name}": array for name, array in self.parameters.items()}
        for place, trajectory in enumerate(self.demonstrations.trajectories):
            tensors[f"demonstration/{place}"] = trajectory
        tensors["loss_history"] = self.loss_history.astype(np.float32)
        return save_tensors(path, kind=KIND, header=header, tensors=tensors)

    @classmethod
    def read(cls, path: str | os.PathLike[str], name: str = "") -> Memory:
        """Read a memory file.

        Raises:
            NotFoundError: If there is no such file.
            FileFormatError: If it is torn, foreign or inconsistent; the message names the part.
        """
        values, tensors = load_tensors(path, kind=KIND)
        header = Fields(values, f"{path}: header")
        header.version("format_version", FORMAT_VERSION)
        network = settings_from_header(NetworkSettings, header.any("network"), str(path))
        training = settings_from_header(TrainingSettings, header.any("training"), str(path))
        joints, names = header.names("joints"), header.names("actions")
        shapes = parameter_shapes(network, len(joints) * network.n_softmax_units, len(names))
        parts = [f"demonstration/{place}" for place in range(len(names))]
        only_arrays(path, tensors, [*parts, *(f"parameter/{key}" for key in shapes), "loss_history"])
        return cls(
            network=network,
            training=training,
            parameters={key: _weights(path, tensors, f"parameter/{key}", shape) for key, shape in shapes.items()},
            demonstrations=_taught(path, header, tensors, names, joints, network),
            loss_history=take(path, tensors, "loss_history", (None,), np.float32),
            loss_every=header.whole("loss_every", least=1),
            best_epoch=header.whole("best_epoch", least=0),
            best_loss=header.number("best_loss"),
            record=header.object("record").values,
            name=name or str(path),
        )


def _weights(path: str | os.PathLike[str], tensors: dict[str, np.ndarray], name: str, shape: Any) -> np.ndarray:
    found = take(path, tensors, name, shape, np.float32)
    if found.size and np.abs(found).max() > MAX_WEIGHT:
        raise FileFormatError(
            f"{path}: the array `{name}` should hold weights of at most {MAX_WEIGHT:g}, "
            f"but holds {found.flat[np.abs(found).argmax()]:g}"
        )
    return found


def _taught(
    path: str | os.PathLike[str],
    header: Fields,
    tensors: dict[str, np.ndarray],
    names: tuple[str, ...],
    joints: tuple[str, ...],
    network: NetworkSettings,
) -> Demonstrations:
    taught = [take(path, tensors, f"demonstration/{i}", (None, len(joints)), np.float64) for i in range(len(names))]
    for place, trajectory in enumerate(taught):
        if len(trajectory) > MAX_STEPS:
            raise FileFormatError(
                f"{path}: the array `demonstration/{place}` has {len(trajectory)} postures, "
                f"expected at most {MAX_STEPS}"
            )
    record = header.object("demonstrations_record").values
    try:
        demonstrations = Demonstrations(names, taught, header.number("dt_s"), joints, record)
        encoding_of(demonstrations, network)
        return demonstrations
    except CreativeNaoError as error:
        raise FileFormatError(f"{path}: its demonstrations: {error}") from error


def encoding_of(demonstrations: Demonstrations, network: NetworkSettings) -> SoftmaxEncoding:
    """Return the softmax code whose references span each joint's range in the demonstrations (Eq. 6).

    Raises:
        SettingsError: If a joint does not move in any demonstration.
    """
    angles = np.concatenate(demonstrations.trajectories)
    spans = np.ptp(angles, axis=0)
    still = [joint for joint, span in zip(demonstrations.joints, spans, strict=True) if not span > MIN_SPAN_RAD]
    if still:
        raise SettingsError(
            f"{', '.join(still)} never moves in the demonstrations; leave the joint out or let it move, "
            "since the softmax code spans its range"
        )
    return SoftmaxEncoding(
        angles.min(axis=0), angles.max(axis=0), network.n_softmax_units, network.sigma, network.sigma_unit
    )


PRETRAINED = Path(__file__).parent / "pretrained"
SCORES = PRETRAINED / "scores.json"
CONDITIONS = {"open": 0.0, "half": 0.5, "closed": 1.0}
"""The paper's three closed-loop ratios by name."""

SPLITS = {"train": range(10), "validation": range(10, 12), "test": range(12, 16)}
"""Seeds of the bank's three parts, each with all conditions. Agents learn on `train`, are tuned on `validation` and
judged on `test`, whose memories no training ever sees."""


def split_memories(split: str) -> tuple[str, ...]:
    """Return the names of the shipped memories of one part of the bank.

    Args:
        split: `train`, `validation` or `test`.

    Raises:
        NotFoundError: If there is no such part, or none of its memories ships.
    """
    if split not in SPLITS:
        raise NotFoundError(f"no split `{split}`{nearest_name(split, SPLITS)}; there are {', '.join(SPLITS)}")
    names = tuple(name for name in shipped_memories() if int(name.split("/")[1]) in SPLITS[split])
    if not names:
        raise NotFoundError(f"no memory of the split `{split}` ships with this installation")
    return names


def split_of(name: str) -> str:
    """Return the part of the bank that a shipped memory such as ``half/0`` belongs to."""
    seed = int(name.split("/")[1])
    return next((split for split, seeds in SPLITS.items() if seed in seeds), "none")


def shipped_scores() -> dict[str, dict[str, Any]]:
    """Return the figures of the shipped memories by name, as `creative-nao memories --rescore` wrote them.

    Each has `best_loss`, `worst_reproduction_dtw` [rad], and the figures of the paper's Table I over the 200 x 200 map.
    """
    return json.loads(SCORES.read_text(encoding="utf-8"))["memories"] if SCORES.is_file() else {}


def shipped_memories() -> tuple[str, ...]:
    """Return the names of the shipped memories, condition and seed: ``open/0``, ``half/0``, ``closed/0``, ..."""
    found = [path.stem.rsplit("-", 1) for path in PRETRAINED.glob("*-*.safetensors")]
    order = list(CONDITIONS)
    return tuple(f"{c}/{s}" for c, s in sorted(found, key=lambda item: (order.index(item[0]), int(item[1]))))


def load_memory(name: str | os.PathLike[str]) -> Memory:
    """Load a memory by shipped name or from a file.

    Args:
        name: A shipped name such as ``half/0``, or the path of a memory file.

    Raises:
        NotFoundError: If there is neither; the message offers the nearest name.
        FileFormatError: If the file is torn or foreign.
    """
    text = os.fspath(name)
    names = shipped_memories()
    if text in names:
        condition, seed = text.split("/")
        return Memory.read(PRETRAINED / f"{condition}-{seed}.safetensors", name=text)
    if Path(text).is_file():
        return Memory.read(text)
    if text in SPLITS:
        raise NotFoundError(
            f"`{text}` is a part of the bank, not one memory; an environment draws from it, "
            f"split_memories({text!r}) lists it"
        )
    raise NotFoundError(
        f"no memory `{text}`{nearest_name(text, names)}: neither a file nor a shipped name; "
        f"shipped are {', '.join(names)}"
    )
