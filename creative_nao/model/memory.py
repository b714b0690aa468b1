"""A memory: a trained PB-MTRNN with everything needed to use it, in one file; and the memories that ship."""

from __future__ import annotations

import base64
import dataclasses
import functools
import hashlib
import html
import io
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from creative_nao.arrays import load_tensors, only_arrays, save_tensors, take, unsealed_sha256
from creative_nao.demonstrations import Demonstrations, load_demonstrations
from creative_nao.errors import CreativeNaoError, FileFormatError, NotFoundError, nearest_name
from creative_nao.exchange.motion import MAX_STEPS
from creative_nao.measures import score
from creative_nao.model.config import NetworkSettings, TrainingSettings, check_kind, parameter_shapes
from creative_nao.model.encoding import SoftmaxEncoding, encoding_of
from creative_nao.model.generation import ClosedLoopGenerator, along, pb_of_each_tick, pb_points
from creative_nao.model.recognition import N_SCREEN, Recognition, checked_trajectory, infer_pb
from creative_nao.schema import (
    Count,
    Index,
    JsonObject,
    Names,
    Seed,
    Version1,
    checked,
    checked_path,
    dump,
    parse,
    record,
)
from creative_nao.storage import read_json

KIND = "memory"
IN_HEADER = ("network", "training", "loss_every", "best_epoch", "best_loss", "record")  # fields of `Memory` as they are
MAX_CURVE_POINTS = 5000  # a memory keeps at most this many points of its learning curve; a checkpoint keeps all
MAX_WEIGHT = 1e6  # largest in a memory file; the largest of the shipped bank is 34. Beyond 1e30 sums would overflow
PREVIEW_RESOLUTION = 40  # points on each side of the map that a notebook shows


@record
class MemoryHeader:
    """What a memory file holds beside its arrays."""

    format_version: Version1
    network: NetworkSettings
    training: TrainingSettings
    joints: Names
    dt_s: float
    actions: Names
    demonstrations_record: JsonObject
    loss_every: Count
    best_epoch: Index
    best_loss: float
    record: JsonObject


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Memory:
    """A robot's memory: every point of its PB space is a movement, the taught ones and, between them, new ones.

    Make one with `creative_nao.train` or `creative_nao.load_memory`.

    Attributes:
        network: Sizes, time constants and code of the network.
        training: How it was trained.
        parameters: Weights by name, float32; shapes as in `model.config.parameter_shapes`.
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
    def generator(self) -> ClosedLoopGenerator:
        """The network prepared for generation, also of a few ticks at a time."""
        posture = self.demonstrations.initial_posture
        return ClosedLoopGenerator(self.network, self.parameters, self.encoding, posture)

    def generate(self, pb: ArrayLike, n_steps: int | None = None) -> np.ndarray:
        """Generate a movement from each PB point in closed loop: the robot imagines it.

        Args:
            pb: PB values in [-1, 1], shape (n, n_pb).
            n_steps: Ticks to generate; default: as long as the longest basic action.

        Returns:
            Joint angles [rad], shape (n, n_steps, n_joints), float64; row 0 is the initial posture, the mean first
            posture of the basic actions. A point gives the same bits alone and in any batch.

        Raises:
            ShapeError: If `pb` is not (n, n_pb) or holds values outside [-1, 1].
            SettingsError: If `n_steps` is not a whole number of at least 1.
        """
        return self.generator(pb_points(pb, self.network.n_pb, "pb"), self._steps(n_steps))

    def _steps(self, n_steps: int | None) -> int:
        return self.n_steps if n_steps is None else checked(Count, n_steps, "n_steps")

    def generate_path(
        self, points: ArrayLike, n_steps: int | None = None, at_ticks: Sequence[int] | np.ndarray | None = None
    ) -> np.ndarray:
        """Generate one movement while the PB moves in straight lines from point to point.

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
            SettingsError: If `n_steps` is not a whole number of at least 1, or `at_ticks` does not fit.
        """
        pb = pb_of_each_tick(points, self.network.n_pb, self._steps(n_steps), at_ticks)
        return self.generator(pb[None], len(pb))[0]

    def infer_pb(
        self,
        trajectory: ArrayLike,
        *,
        infer_initial_state: bool = False,
        n_restarts: int = 48,
        n_screen: int = N_SCREEN,
        seed: int = 0,
    ) -> Recognition:
        """Find the PB value from which this memory generates a movement, or the most similar one it has.

        Works with any number of PB units, joints and layers; `model/recognition.py` says how. Time grows with the
        length of the movement.

        Args:
            trajectory: Joint angles at the memory's tick [rad], shape (n_steps, n_joints), any length from two on.
            infer_initial_state: Whether to start in the given first posture instead of the memory's own, and to seek
                the initial internal state of the slowest layer too.
            n_restarts: Descents side by side.
            n_screen: Points of the even cover of the PB space; with three and more PB units, more help.
            seed: Shifts the cover and draws the trial steps. One seed, one answer.

        Returns:
            The PB value, the DTW distance of its movement to the given one, that movement, and where else the search
            ended.

        Raises:
            ShapeError: If `trajectory` is not finite or does not have the memory's joints.
            SettingsError: If a setting is of a wrong kind or out of range.
        """
        return infer_pb(
            self.generator,
            checked_trajectory(trajectory, self.joints),
            infer_initial_state=checked(bool, infer_initial_state, "infer_initial_state"),
            n_restarts=checked(Count, n_restarts, "n_restarts"),
            n_screen=checked(Count, n_screen, "n_screen"),
            seed=checked(Seed, seed, "seed"),
        )

    def __repr__(self) -> str:
        layers = "-".join(map(str, self.network.layer_sizes))
        return (
            f"Memory({self.name or 'without a name'}: {self.demonstrations.n_actions} actions of {len(self.joints)} "
            f"joints, layers {layers}, {self.network.n_pb} PB units,\n"
            f"       closed-loop ratio {self.closed_loop_ratio:g}, seed {self.training.seed}, "
            f"loss {self.best_loss:.4g} at epoch {self.best_epoch})"
        )

    def _repr_html_(self) -> str:
        """Return the map over the first two PB units for a notebook: the nearest basic action of each point."""
        import matplotlib
        from matplotlib.colors import to_hex
        from matplotlib.image import imsave

        axis = np.linspace(-1.0, 1.0, PREVIEW_RESOLUTION)
        points = np.zeros((len(axis) ** 2, self.network.n_pb))
        points[:, 0] = np.tile(axis, len(axis))
        points[:, 1:2] = np.repeat(axis, len(axis))[:, None]  # fills no column where there is only one unit
        scores = score(self.generate(points), self.demonstrations)
        colours = np.array([matplotlib.colormaps["tab10"](place % 10)[:3] for place in range(len(self.pb))])
        image = np.where(scores.appropriate[:, None], colours[scores.nearest], 1.0).reshape(len(axis), -1, 3)
        picture = io.BytesIO()
        imsave(picture, image, format="png", origin="lower")
        legend = [
            f'<span style="color:{to_hex(colour)}">&#9632;</span> {html.escape(name)}'
            for colour, name in zip(colours, self.demonstrations.names, strict=True)
        ]
        return (
            f"<pre>{html.escape(repr(self))}</pre>"
            f'<img width="240" height="240" style="image-rendering:pixelated" alt="PB map" '
            f'src="data:image/png;base64,{base64.b64encode(picture.getvalue()).decode()}">'
            f"<p>{', '.join(legend)}; white: too fast or not moving</p>"
        )

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the memory to one safetensors file, in one step, and return its path.

        A path that ends in ``.xz`` gets it packed: without loss, and of the basic actions that ship only the hashes.
        """
        header = MemoryHeader(
            format_version=1,
            actions=self.demonstrations.names,
            demonstrations_record=self.demonstrations.record,
            **{name: getattr(self, name) for name in ("joints", "dt_s", *IN_HEADER)},
        )
        tensors = {f"parameter/{name}": array for name, array in self.parameters.items()}
        tensors |= {f"demonstration/{place}": one for place, one in enumerate(self.demonstrations.trajectories)}
        tensors["loss_history"] = self.loss_history.astype(np.float32)
        return save_tensors(path, kind=KIND, header=dump(header), tensors=tensors, shared=_basic_actions)

    @classmethod
    def read(cls, path: str | os.PathLike[str], name: str = "") -> Memory:
        """Read a memory file.

        Raises:
            NotFoundError: If there is no such file.
            FileFormatError: If it is torn, foreign or inconsistent; the message names the part.
        """
        path = checked_path(path)
        values, tensors = load_tensors(path, kind=KIND, shared=_basic_actions)
        header = parse(MemoryHeader, values, f"{path}: header")
        parts = [f"demonstration/{place}" for place in range(len(header.actions))]
        shapes = parameter_shapes(header.network, len(header.joints) * header.network.n_softmax_units, len(parts))
        only_arrays(path, tensors, [*parts, *(f"parameter/{key}" for key in shapes), "loss_history"])
        return cls(
            parameters={
                key: take(path, tensors, f"parameter/{key}", shape, np.float32, least=-MAX_WEIGHT, most=MAX_WEIGHT)
                for key, shape in shapes.items()
            },
            demonstrations=_demonstrations(path, header, tensors),
            loss_history=take(path, tensors, "loss_history", (None,), np.float32),
            name=name or str(path),
            **{field: getattr(header, field) for field in IN_HEADER},
        )


@functools.cache
def _basic_actions() -> dict[str, np.ndarray]:
    """Return the angles of the shipped basic actions by the SHA-256 of their bytes."""
    return {hashlib.sha256(one.tobytes()).hexdigest(): one for one in load_demonstrations().trajectories}


def _demonstrations(path: Path, header: MemoryHeader, tensors: dict[str, np.ndarray]) -> Demonstrations:
    trajectories = []
    for name in (f"demonstration/{place}" for place in range(len(header.actions))):
        trajectory = take(path, tensors, name, (None, len(header.joints)), np.float64)
        if len(trajectory) > MAX_STEPS:
            told = f"has {len(trajectory)} postures, expected at most {MAX_STEPS}"
            raise FileFormatError(f"{path}: the array `{name}` {told}")
        trajectories.append(trajectory)
    record = header.demonstrations_record
    try:
        demonstrations = Demonstrations(header.actions, trajectories, header.dt_s, header.joints, record)
        encoding_of(demonstrations, header.network)  # raises where nothing moves
    except CreativeNaoError as error:
        raise FileFormatError(f"{path}: its demonstrations: {error}") from error
    return demonstrations


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Walk:
    """Movements at evenly spaced stops of a path.

    Attributes:
        pb: The stops, shape (n_points, n_pb).
        trajectories: What the memory generates at each [rad], shape (n_points, n_steps, n_joints).
    """

    pb: np.ndarray
    trajectories: np.ndarray

    def __len__(self) -> int:
        return len(self.pb)

    def __repr__(self) -> str:
        n_points, n_steps, n_joints = self.trajectories.shape
        return f"Walk({n_points} movements of {n_steps} ticks and {n_joints} joints, {self.pb.shape[1]} PB units)"


def walk(memory: Memory, points: ArrayLike, n_points: int, n_steps: int | None = None) -> Walk:
    """Stop at evenly spaced places of the line through `points` and generate one movement at each, as in Fig. 5.

    Args:
        memory: The memory.
        points: Corners of the line in [-1, 1], shape (n, n_pb).
        n_points: Stops, the first and the last point among them; at least 1, which is the first point.
        n_steps: Ticks of each movement; default: as long as the longest basic action.

    Raises:
        ShapeError: If `points` is not (n, n_pb) or leaves [-1, 1].
        SettingsError: If `memory` is none, or `n_points` or `n_steps` is not a whole number of at least 1.
    """
    check_kind(memory, Memory, "memory")
    corners = pb_points(points, memory.network.n_pb, "points", least=1)
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    reached = np.concatenate([[0.0], np.cumsum(lengths)])
    pb = along(corners, reached, np.linspace(0.0, reached[-1], checked(Count, n_points, "n_points")))
    return Walk(pb, memory.generate(pb, n_steps))


PRETRAINED = Path(__file__).parent / "pretrained"
SCORES = PRETRAINED / "scores.json"
_ENDING = ".safetensors.xz"
CONDITIONS = {"open": 0.0, "half": 0.5, "closed": 1.0}
"""The paper's three closed-loop ratios by name."""

BANKS = {2: "", 4: "-4pb", 8: "-8pb"}
"""PB units of the shipped memories, and what the names of those with more than the paper's two carry."""
_SEEDS = {"train": range(10), "validation": range(10, 12), "test": range(12, 16)}
SPLITS = {f"{split}{suffix}": seeds for suffix in BANKS.values() for split, seeds in _SEEDS.items()}
"""Seeds of each bank's three parts, with all its conditions: `train`, `train-4pb`, ... Agents learn on `train`, are
tuned on `validation` and judged on `test`, whose memories no training ever sees."""


def split_memories(split: str) -> tuple[str, ...]:
    """Return the names of the shipped memories of one part of the bank.

    Args:
        split: `train`, `validation` or `test`; of the memories with 4 or 8 PB units `train-4pb`, ..., `test-8pb`.

    Raises:
        NotFoundError: If there is no such part, or none of its memories ships.
    """
    if checked(str, split, "split") not in SPLITS:
        raise NotFoundError(f"no split `{split}`{nearest_name(split, SPLITS)}; there are {', '.join(SPLITS)}")
    names = tuple(name for name in shipped_memories(None) if split_of(name) == split)
    if not names:
        raise NotFoundError(f"no memory of the split `{split}` ships with this installation")
    return names


def split_of(name: str) -> str:
    """Return the part of the bank that a shipped memory such as ``half/0`` belongs to; ``none`` if to none."""
    condition, _, seed = checked(str, name, "name").rpartition("/")
    suffix = next((suffix for suffix in BANKS.values() if suffix and condition.endswith(suffix)), "")
    found = (split for split, seeds in _SEEDS.items() if seed.isdecimal() and int(seed) in seeds)
    return next((f"{split}{suffix}" for split in found), "none")


def shipped_scores() -> dict[str, dict[str, Any]]:
    """Return the figures of the shipped memories by name, as `creative-nao memories --rescore` wrote them.

    Each has `best_loss`, `worst_reproduction_dtw` [rad], and the figures of the paper's Table I over the 200 x 200 map.
    """
    return read_json(SCORES, "scores of the memories")["memories"] if SCORES.is_file() else {}


def shipped_memories(n_pb: int | None = 2) -> tuple[str, ...]:
    """Return the names of the shipped memories, condition and seed: ``open/0``, ``half/0``, ``closed/0``, ...

    Args:
        n_pb: PB units: 2, as in the paper; 4 or 8, whose names are ``half-4pb/0``, ...; None for all.
    """
    files = [path.name.removesuffix(_ENDING).rpartition("-") for path in PRETRAINED.glob(f"*-*{_ENDING}")]
    kinds = [f"{name}{suffix}" for units, suffix in BANKS.items() for name in CONDITIONS if n_pb in (None, units)]
    found = sorted((kinds.index(kind), int(seed)) for kind, _, seed in files if kind in kinds)
    return tuple(f"{kinds[place]}/{seed}" for place, seed in found)


def shipped_file(name: str) -> Path:
    """Return where the memory of a shipped name such as ``half/0`` stands."""
    return PRETRAINED / f"{name.replace('/', '-')}{_ENDING}"


def content_sha256(path: Path) -> str:
    """Return the SHA-256 of a memory as release 0.1.0 wrote it to a file: not packed, without digests in its header."""
    return unsealed_sha256(path, kind=KIND, shared=_basic_actions)


def load_memory(name: str | os.PathLike[str]) -> Memory:
    """Load a memory by shipped name or from a file.

    Args:
        name: A shipped name such as ``half/0`` or ``half-4pb/0``, or the path of a memory file.

    Raises:
        NotFoundError: If there is neither; the message offers the nearest name.
        FileFormatError: If the file is torn or foreign.
        SettingsError: If `name` is neither text nor a path.
    """
    text = str(checked_path(name, "name")) if not isinstance(name, str) else name
    names = shipped_memories(None)
    if text in names:
        return Memory.read(shipped_file(text), name=text)
    if os.path.isfile(text):  # unlike `Path.is_file`, says no to a name with a null character
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
