"""Body sense: how likely the body refuses a movement, predicted from the imagined trajectory; no physics is simulated.

- `perform_movements` lets the simulated robot perform what imagining agents would choose, memory by memory.
- `train_sense` teaches a small network what became of them; `shipped_sense` is the one that planning agents use.

The network sees each tick of a movement: joint angles and speeds, and the directions in which upper arms and forearms
point (the robot's forward kinematics). It predicts, as a mean over the ticks, the three figures by which the body
refuses nearly all movements that it refuses, in units of their limits, and from them the probability of a refusal.
"""

from __future__ import annotations

import functools
import itertools
import os
import zlib
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import mannwhitneyu

from creative_nao.arrays import load_tensors, only_arrays, save_tensors, take
from creative_nao.demonstrations.retargeting import directions
from creative_nao.envs.executors import PhysicsPool, SharedScene, ThreadPool, physics_figures
from creative_nao.errors import FileFormatError, SettingsError
from creative_nao.joints import JOINTS, MIRROR_SIGN
from creative_nao.measures import farthest_points, score
from creative_nao.model import Memory, load_memory
from creative_nao.robot import PhysicalLimits, first_failure
from creative_nao.robot.performance import PHYSICAL_FAILURES
from creative_nao.runtime import record as provenance
from creative_nao.schema import Count, Index, JsonObject, LongText, NonNegative, Positive, dump, parse, record

KIND, PERFORMED_KIND = "body sense", "performed movements"
SHIPPED = Path(__file__).parent / "pretrained" / "body_sense.safetensors"
_DEFAULT = PhysicalLimits()
FIGURES: dict[str, float] = {
    "self_collision": _DEFAULT.self_collision_share, "torque_saturated": _DEFAULT.torque_saturated_share,
    "tracking_error": _DEFAULT.tracking_error_rad,
}  # fmt: skip
"""What is predicted, `physical_map.FIGURES` explains it, and the limit beyond which the body has refused."""
_MIRRORED = np.array([4, 5, 6, 7, 0, 1, 2, 3])
_SIGN = np.tile(MIRROR_SIGN, 2)
_ARRAYS = ("centre", "spread", "w0", "b0", "w1", "b1", "w2", "b2", "steepness", "edge")
_MOST = 1.0 - 1e-6


@record
class MovementSettings:
    """Which movements of each memory are performed: usable ones, drawn uniformly and chosen for their novelty."""

    n_uniform: Index = 100
    """Drawn uniformly."""
    n_rounds: Index = 5
    """How many times the most novel ones are chosen, each time among others."""
    n_imagined: Count = 1920
    """Points drawn in a round."""
    n_novel: Count = 30
    """Chosen of them in a round, each the farthest from the basic actions and those before it."""
    seed: Index = 0
    """Seed of the points."""


@record
class _MovementHeader:
    """What the file of a memory's performed movements says beside its arrays."""

    memory: LongText
    settings: MovementSettings
    dt_s: float
    record: JsonObject


def chosen_points(memory: Memory, settings: MovementSettings) -> tuple[np.ndarray, np.ndarray]:
    """Return the PB points (n, n_pb) of the movements that are performed, and those movements (n, n_steps, 8) [rad]."""
    rng = np.random.default_rng([settings.seed, zlib.crc32(memory.name.encode())])
    points, moves = [], []
    for k in range(settings.n_rounds + 1):
        drawn = rng.uniform(-1.0, 1.0, (settings.n_imagined, memory.network.n_pb)).astype(np.float32).astype(float)
        generated = memory.generate(drawn)
        usable = score(generated, memory.demonstrations).appropriate
        if k == 0:
            rows = np.flatnonzero(usable)[: settings.n_uniform]
        else:
            rows = farthest_points(generated, memory.demonstrations, settings.n_novel, usable).indices
        points.append(drawn[rows])
        moves.append(generated[rows])
    return np.concatenate(points), np.concatenate(moves)


def perform_movements(
    folder: str | os.PathLike[str],
    memories: Sequence[str],
    settings: MovementSettings | None = None,
    *,
    n_threads: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Let the robot perform movements of memories and write a file for each into `folder`; those there are kept.

    Args:
        folder: Where the files are, or will be: ``half-0.safetensors`` of the memory half/0.
        memories: Names of memories with the eight arm joints.
        settings: Which movements; 250 of a memory take about 14 s of a core.
        n_threads: Movements performed at the same time; default: one a core.
        progress: Called with the number of memories that are done.

    Raises:
        FileFormatError: If a file that is there was made with other settings, or is damaged.
        SettingsError: If a memory has other joints.
    """
    settings = MovementSettings() if settings is None else settings
    with closing(ThreadPool(n_threads)) as threads:
        pool = PhysicsPool(threads, SharedScene(bare=True))
        for n_done, name in enumerate(memories):
            if progress is not None:
                progress(n_done)
            if (path := _file_of(folder, name)).exists():
                _read(path, name, settings)
                continue
            memory = load_memory(name)
            if memory.joints != JOINTS:
                raise SettingsError(f"memory `{name}` should have the joints {', '.join(JOINTS)}, but has others")
            points, moves = chosen_points(memory, settings)
            performances = [one for one, _ in pool.perform(moves, [memory.dt_s] * len(moves))]
            faults = [first_failure(one, PhysicalLimits()) for one in performances]
            figures = [physics_figures(one) for one in performances]
            header = _MovementHeader(name, settings, memory.dt_s, provenance(settings=dump(settings)))
            arrays = {
                "pb": points,
                "trajectory": moves.astype(np.float32),
                "fault": np.array([0 if one is None else 1 + PHYSICAL_FAILURES.index(one) for one in faults], np.int8),
                **{figure: np.array([one[figure] for one in figures], np.float32) for figure in FIGURES},
            }
            save_tensors(path, kind=PERFORMED_KIND, header=dump(header), tensors=arrays)
    if progress is not None:
        progress(len(memories))


def _file_of(folder: str | os.PathLike[str], memory: str) -> Path:
    return Path(folder) / f"{memory.replace('/', '-')}.safetensors"


def _read(path: Path, memory: str, settings: MovementSettings) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return movements (n, n_steps, 8), codes of their faults (n,), 0 for none, their figures (n, 3), and the tick."""
    values, arrays = load_tensors(path, kind=PERFORMED_KIND)
    header = parse(_MovementHeader, values, f"{path}: header")
    if (header.memory, header.settings) != (memory, settings):
        raise FileFormatError(
            f"{path}: holds movements of {header.memory} with {header.settings}, not of {memory} with {settings}"
        )
    only_arrays(path, arrays, ("pb", "trajectory", "fault", *FIGURES))
    moves = take(path, arrays, "trajectory", (None, None, len(JOINTS)), least=-10.0, most=10.0)
    n = len(moves)
    fault = take(path, arrays, "fault", (n,), kinds="i", least=0, most=len(PHYSICAL_FAILURES))
    figures = np.stack([take(path, arrays, name, (n,), least=0.0, most=100.0) for name in FIGURES], axis=1)
    return moves, fault, figures, header.dt_s


@record
class SenseSettings:
    """How the network learns. The epoch with the lowest log loss on the validation movements is kept."""

    n_hidden: Count = 64
    """Units of each of its two hidden layers."""
    n_epochs: Count = 40
    """Passes over all movements and their mirror images."""
    batch_size: Count = 128
    """Movements of a step."""
    learning_rate: Positive = 3e-3
    """Largest step size of AdamW; it rises first and falls to zero (one cycle)."""
    weight_decay: NonNegative = 1e-2
    """Of AdamW."""
    seed: Index = 0
    """Seed of weights and order."""


@record
class SenseHeader:
    """What the file of a body sense says beside its weights."""

    settings: SenseSettings
    movements: MovementSettings
    memories: tuple[LongText, ...]
    """Memories whose movements taught it."""
    validation: JsonObject
    """Figures on the validation memories: see `train_sense`."""
    record: JsonObject


class BodySense:
    """Predicts from imagined movements of the eight arm joints whether the body refuses them.

    Attributes:
        header: How it was made and how well it predicts.
        arrays: The weights, float32, by name.
    """

    def __init__(self, header: SenseHeader, arrays: dict[str, np.ndarray]):
        self.header, self.arrays = header, arrays

    def figures(self, moves: np.ndarray, dt_s: float) -> np.ndarray:
        """Return the `FIGURES` of movements (n, n_steps, 8) [rad] at ticks of `dt_s` [s], in their limits, (n, 3)."""
        a = self.arrays
        x = (features(moves, dt_s) - a["centre"]) / a["spread"]
        for layer in "01":
            x = np.maximum(x @ a[f"w{layer}"] + a[f"b{layer}"], 0.0)
        return np.logaddexp(np.float32(0.0), x @ a["w2"] + a["b2"]).mean(axis=1)

    def refusal(self, moves: np.ndarray, dt_s: float) -> np.ndarray:
        """Return the probability that the body refuses movements (n, n_steps, 8) [rad], (n,), below 1."""
        logit = self.arrays["steepness"] * (self.figures(moves, dt_s) - self.arrays["edge"])
        accepted = np.exp(-np.logaddexp(0.0, logit.astype(np.float64)).sum(axis=1))
        return np.minimum(1.0 - accepted, _MOST)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write it to a safetensors file and return the path."""
        return save_tensors(path, kind=KIND, header=dump(self.header), tensors=self.arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> BodySense:
        """Read it; `NotFoundError` without the file, `FileFormatError` if it is torn or foreign."""
        values, arrays = load_tensors(path, kind=KIND)
        header = parse(SenseHeader, values, f"{path}: header")
        only_arrays(path, arrays, _ARRAYS)
        n_features, n, n_figures = 28, header.settings.n_hidden, len(FIGURES)
        shapes = [(n_features,), (n_features,), (n_features, n), (n,), (n, n), (n,), (n, n_figures)]
        shapes += [(n_figures,)] * 3
        for name, shape in zip(_ARRAYS, shapes, strict=True):
            take(path, arrays, name, shape, np.float32, least=1e-9 if name == "spread" else -1e6, most=1e6)
        return cls(header, arrays)


@functools.cache
def shipped_sense() -> BodySense:
    """Return the shipped body sense."""
    return BodySense.load(SHIPPED)


def features(moves: np.ndarray, dt_s: float) -> np.ndarray:
    """Return what the network sees of movements (n, n_steps, 8) [rad], (n, n_steps, 28) float32.

    Angles [rad], speeds [rad/s], and of the right and the mirrored left arm the directions of upper arm and forearm.
    """
    moves = np.asarray(moves, np.float64)
    speeds = np.diff(moves, axis=1, prepend=moves[:, :1]) / dt_s
    arms = (moves[..., :4], moves[..., 4:] * MIRROR_SIGN)
    pointing = [one.reshape(*moves.shape[:2], 3) for arm in arms for one in directions(arm.reshape(-1, 4))]
    return np.concatenate([moves, speeds, *pointing], axis=-1).astype(np.float32)


def train_sense(
    folder: str | os.PathLike[str],
    memories: Sequence[str],
    validation: Sequence[str],
    settings: SenseSettings | None = None,
    movements: MovementSettings | None = None,
    *,
    command: str | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> BodySense:
    """Teach a network what became of the movements that `perform_movements` left in `folder`.

    The loss is that of the predicted figures (smooth L1) plus the log loss of the refusals. One thread of torch; the
    same settings and movements give the same weights on one machine.

    Args:
        folder: Of `perform_movements`.
        memories: Whose movements teach.
        validation: Whose movements judge: `header.validation` tells `auc` (how often a refused movement is given a
            larger probability than an accepted one), `log_loss` beside `log_loss_of_share` (of the constant that is
            right on average), `n_refused` beside `n_expected` of `n_performed` movements, and the `epoch` kept.
        settings: How it learns.
        movements: How they were chosen; the files say the same, or are refused.
        command: For the file's record; None takes the running one.
        progress: Called with the epochs done and the log loss on validation movements.
    """
    import torch
    from torch.nn.functional import logsigmoid, smooth_l1_loss

    settings, movements = settings or SenseSettings(), movements or MovementSettings()
    torch.set_num_threads(1)
    taught, judged = (_gathered(folder, names, movements) for names in (memories, validation))
    x = np.concatenate([taught[0], features(taught[3][..., _MIRRORED] * _SIGN, taught[4])])
    centre, spread = x.mean(axis=(0, 1)), x.std(axis=(0, 1)) + np.float32(1e-6)
    x, x_judged = (torch.from_numpy((one - centre) / spread) for one in (x, judged[0]))
    refused, ratios = (torch.from_numpy(np.concatenate([one, one])) for one in taught[1:3])
    n_hidden, n_figures = settings.n_hidden, len(FIGURES)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(settings.seed)
        sizes = (x.shape[-1], n_hidden, n_hidden, n_figures)
        layers = [torch.nn.Linear(*pair) for pair in itertools.pairwise(sizes)]
        order = [torch.randperm(len(x)) for _ in range(settings.n_epochs)]
    layers[2].bias.data -= 2.0  # most movements are far below the limits
    steepness, edge = (torch.nn.Parameter(torch.full((n_figures,), value)) for value in (4.0, 1.0))
    parameters = [*(one for layer in layers for one in layer.parameters()), steepness, edge]
    optimizer = torch.optim.AdamW(parameters, lr=settings.learning_rate, weight_decay=settings.weight_decay)
    batches = [some for epoch in order for some in epoch.split(settings.batch_size)]
    cycle = torch.optim.lr_scheduler.OneCycleLR(optimizer, settings.learning_rate, total_steps=len(batches))

    def predict(some: Any) -> tuple[Any, Any]:
        hidden = torch.relu(layers[1](torch.relu(layers[0](some))))
        predicted = torch.nn.functional.softplus(layers[2](hidden)).mean(dim=1)
        return predicted, logsigmoid(-steepness * (predicted - edge)).sum(dim=1)

    best: tuple[float, int, list[np.ndarray]] = (np.inf, 0, [])
    for k, some in enumerate(batches, start=1):
        predicted, accepted = predict(x[some])
        loss = smooth_l1_loss(predicted, ratios[some].clamp(max=3.0)) + _log_loss(refused[some], accepted)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        cycle.step()
        if k % (len(batches) // settings.n_epochs) == 0:
            with torch.no_grad():
                log_loss = float(_log_loss(torch.from_numpy(judged[1]), predict(x_judged)[1]))
            epoch = k * settings.n_epochs // len(batches)
            if log_loss < best[0]:
                best = (log_loss, epoch, [one.detach().numpy().T.copy() for one in parameters])
            if progress is not None:
                progress(epoch, log_loss)
    arrays: dict[str, np.ndarray] = dict(zip(_ARRAYS, [centre, spread, *best[2]], strict=True))
    provided = provenance(settings=dump(settings), command=command)
    header = SenseHeader(settings, movements, tuple(memories), {}, provided)
    chance, hit = BodySense(header, arrays).refusal(judged[3], judged[4]), judged[1] > 0
    share, n_pairs = float(hit.mean()), int(hit.sum()) * int((~hit).sum())
    told = {
        "epoch": best[1], "n_performed": len(hit), "n_refused": int(hit.sum()), "n_expected": float(chance.sum()),
        "auc": float(mannwhitneyu(chance[hit], chance[~hit]).statistic) / n_pairs if n_pairs else None,
        "log_loss": best[0],
        "log_loss_of_share": -share * np.log(share) - (1 - share) * np.log(1 - share) if n_pairs else None,
    }  # fmt: skip
    return BodySense(SenseHeader(settings, movements, tuple(memories), told, provided), arrays)


def _log_loss(refused: Any, log_accepted: Any) -> Any:
    """Return the mean log loss of refusals (n,) where the logarithms of the probabilities of acceptance are (n,)."""
    return -(log_accepted * (1.0 - refused) + (1.0 + 1e-6 - log_accepted.exp()).log() * refused).mean()


def _gathered(
    folder: str | os.PathLike[str], memories: Sequence[str], movements: MovementSettings
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
    """Return features, refusals (n,), figures in their limits (n, 3), all float32, movements, and the tick [s]."""
    read = [_read(_file_of(folder, name), name, movements) for name in memories]
    moves, fault, figures = (np.concatenate([one[k] for one in read]) for k in range(3))
    dt_s = read[0][3]
    if any(one[3] != dt_s for one in read):
        raise SettingsError(f"`memories` should have one tick, but have {sorted({one[3] for one in read})} s")
    ratios = (figures / np.array([*FIGURES.values()])).astype(np.float32)
    return features(moves, dt_s), (fault > 0).astype(np.float32), ratios, moves, dt_s
