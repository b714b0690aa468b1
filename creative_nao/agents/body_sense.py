"""Body sense: how likely the body refuses a movement, predicted from the imagined trajectory; no physics is simulated.

- `perform_movements` lets the simulated robot perform what imagining agents would choose, memory by memory.
- `train_sense` teaches a small network what became of them; `shipped_sense` is the one that planning agents use.

The network sees each tick of a movement: joint angles and speeds, and the directions in which upper arms and forearms
point (the robot's forward kinematics). It predicts, as a mean over the ticks, the three figures by which the body
refuses nearly all movements that it refuses, in units of their limits, and from them the probability of a refusal.
"""

from __future__ import annotations

import dataclasses
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
from creative_nao.schema import Count, Index, JsonObject, LongText, dump, parse, record

KIND, PERFORMED_KIND = "body sense", "performed movements"
SHIPPED = Path(__file__).parent / "pretrained" / "body_sense.safetensors"
LIMITS = PhysicalLimits()
FIGURES: dict[str, float] = {
    "self_collision": LIMITS.self_collision_share, "torque_saturated": LIMITS.torque_saturated_share,
    "tracking_error": LIMITS.tracking_error_rad,
}  # fmt: skip
"""What is predicted, `physical_map.FIGURES` explains it, and the limit beyond which the body has refused."""
N_ROUNDS, N_IMAGINED = 5, 1920  # how many times the most novel movements are chosen, and among how many
N_FEATURES = 28
_MIRRORED, _SIGN = np.array([4, 5, 6, 7, 0, 1, 2, 3]), np.tile(MIRROR_SIGN, 2)
_ARRAYS = ("centre", "spread", "w0", "b0", "w1", "b1", "w2", "b2", "steepness", "edge")
_BATCH, _LEARNING_RATE, _WEIGHT_DECAY = 128, 3e-3, 1e-2


@record
class SenseSettings:
    """Which usable movements of each memory are performed, and how the network learns from them."""

    n_uniform: Index = 100
    """Movements of a memory that are drawn uniformly."""
    n_novel: Count = 30
    """The most novel of 1,920, each the farthest from the basic actions and those before it, are taken five times."""
    n_hidden: Count = 64
    """Units of each of the network's two hidden layers."""
    n_epochs: Count = 40
    """Passes over all movements and their mirror images; the one with the lowest log loss on validation is kept."""
    seed: Index = 0
    """Seed of points, weights and order."""


@record
class _MovementHeader:
    """What the file of a memory's performed movements says beside its arrays."""

    memory: LongText
    dt_s: float
    n_uniform: Index
    n_novel: Index
    seed: Index
    record: JsonObject


@record
class SenseHeader:
    """How a body sense was made: memories whose movements taught it, and figures of `train_sense` on validation."""

    settings: SenseSettings
    memories: tuple[LongText, ...]
    validation: JsonObject
    record: JsonObject


def chosen_points(memory: Memory, settings: SenseSettings) -> tuple[np.ndarray, np.ndarray]:
    """Return the PB points (n, n_pb) of the movements that are performed, and those movements (n, n_steps, 8) [rad]."""
    rng = np.random.default_rng([settings.seed, zlib.crc32(memory.name.encode())])
    points, moves = [], []
    for k in range(N_ROUNDS + 1):
        drawn = rng.uniform(-1.0, 1.0, (N_IMAGINED, memory.network.n_pb)).astype(np.float32).astype(float)
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
    folder: Path, memories: Sequence[str], settings: SenseSettings, *, n_threads: int | None = None,
    progress: Callable[[int], object] = lambda _: None,
) -> None:  # fmt: skip
    """Let the robot perform movements of memories, a file of each, as half-0.safetensors, in `folder`.

    Files that are there are kept. 250 movements take 14 s of a core; `progress` hears how many memories are done.

    Raises:
        FileFormatError: If a file that is there was made with other settings, or is damaged.
        SettingsError: If a memory has other joints.
    """
    with closing(ThreadPool(n_threads)) as threads:
        pool = PhysicsPool(threads, SharedScene(bare=True))
        for n_done, name in enumerate(memories):
            progress(n_done)
            if (path := _file_of(folder, name)).exists():
                _read(path, name, settings)
                continue
            memory = load_memory(name)
            if memory.joints != JOINTS:
                raise SettingsError(f"memory `{name}` should have the joints {', '.join(JOINTS)}, but has others")
            points, moves = chosen_points(memory, settings)
            performances = [one for one, _ in pool.perform(moves, [memory.dt_s] * len(moves))]
            faults = [first_failure(one, LIMITS) for one in performances]
            figures = [physics_figures(one) for one in performances]
            chosen = (settings.n_uniform, settings.n_novel, settings.seed)
            header = _MovementHeader(name, memory.dt_s, *chosen, provenance(settings=dump(settings)))
            arrays = {
                "pb": points,
                "trajectory": moves.astype(np.float32),
                "fault": np.array([0 if one is None else 1 + PHYSICAL_FAILURES.index(one) for one in faults], np.int8),
                **{figure: np.array([one[figure] for one in figures], np.float32) for figure in FIGURES},
            }
            save_tensors(path, kind=PERFORMED_KIND, header=dump(header), tensors=arrays)
    progress(len(memories))


def _file_of(folder: Path, memory: str) -> Path:
    return folder / f"{memory.replace('/', '-')}.safetensors"


def _read(path: Path, memory: str, settings: SenseSettings) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return movements (n, n_steps, 8), refusals (n,) and `FIGURES` in their limits (n, 3), float32, and the tick."""
    values, arrays = load_tensors(path, kind=PERFORMED_KIND)
    header = parse(_MovementHeader, values, f"{path}: header")
    made = (header.memory, header.n_uniform, header.n_novel, header.seed)
    if made != (wanted := (memory, settings.n_uniform, settings.n_novel, settings.seed)):
        raise FileFormatError(f"{path}: memory, n_uniform, n_novel and seed should be {wanted}, but are {made}")
    only_arrays(path, arrays, ("pb", "trajectory", "fault", *FIGURES))
    moves = take(path, arrays, "trajectory", (None, None, len(JOINTS)), least=-10.0, most=10.0)
    n = len(moves)
    fault = take(path, arrays, "fault", (n,), kinds="i", least=0, most=len(PHYSICAL_FAILURES))
    ratios = [take(path, arrays, name, (n,), least=0.0, most=100.0) / limit for name, limit in FIGURES.items()]
    return moves, (fault > 0).astype(np.float32), np.stack(ratios, axis=1).astype(np.float32), header.dt_s


class BodySense:
    """Predicts from imagined movements whether the body refuses them: `header` and weights (`arrays`, float32)."""

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
        return np.minimum(1.0 - np.exp(-np.logaddexp(0.0, logit.astype(np.float64)).sum(axis=1)), 1.0 - 1e-6)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write it to a safetensors file and return the path."""
        return save_tensors(path, kind=KIND, header=dump(self.header), tensors=self.arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> BodySense:
        """Read it; `NotFoundError` without the file, `FileFormatError` if it is torn or foreign."""
        values, arrays = load_tensors(path, kind=KIND)
        header = parse(SenseHeader, values, f"{path}: header")
        only_arrays(path, arrays, _ARRAYS)
        n, m = header.settings.n_hidden, len(FIGURES)
        shapes = [(N_FEATURES,)] * 2 + [(N_FEATURES, n), (n,), (n, n), (n,), (n, m), (m,), (m,), (m,)]
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
    folder: Path, memories: Sequence[str], validation: Sequence[str], settings: SenseSettings, *,
    command: str | None = None, progress: Callable[[int, float], object] = lambda *_: None,
) -> BodySense:  # fmt: skip
    """Teach a network what became of the movements that `perform_movements` left in `folder`.

    The loss is that of the predicted figures (smooth L1) plus the log loss of the refusals. One thread of torch; the
    same settings and movements give the same weights on one machine. `progress` hears the epochs done and the log loss
    on validation. `header.validation` tells the `epoch` kept, `auc` (how often a refused movement has a larger
    probability than an accepted one), `log_loss`, and `n_refused` beside `n_expected` of `n_performed` movements.
    """
    import torch
    from torch.nn.functional import logsigmoid, smooth_l1_loss, softplus

    torch.set_num_threads(1)
    taught, judged = (
        [_read(_file_of(folder, name), name, settings) for name in some] for some in (memories, validation)
    )
    if len(ticks := {one[3] for one in (*taught, *judged)}) > 1:
        raise SettingsError(f"the memories should have one tick, but have {sorted(ticks)} s")
    (moves, *truth), (tried, hits, _) = (
        [np.concatenate([one[k] for one in some]) for k in range(3)] for some in (taught, judged)
    )
    (dt_s,) = ticks
    x = np.concatenate([features(moves, dt_s), features(moves[..., _MIRRORED] * _SIGN, dt_s)])
    centre, spread = x.mean(axis=(0, 1)), x.std(axis=(0, 1)) + np.float32(1e-6)
    x, x_judged = (torch.from_numpy((one - centre) / spread) for one in (x, features(tried, dt_s)))
    refused, ratios = (torch.from_numpy(np.concatenate([one, one])) for one in truth)
    sizes = (N_FEATURES, settings.n_hidden, settings.n_hidden, len(FIGURES))
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(settings.seed)
        layers = [torch.nn.Linear(*pair) for pair in itertools.pairwise(sizes)]
        batches = [torch.randperm(len(x)).split(_BATCH) for _ in range(settings.n_epochs)]
    layers[2].bias.data -= 2.0  # most movements are far below the limits
    steepness, edge = (torch.nn.Parameter(torch.full((len(FIGURES),), value)) for value in (4.0, 1.0))
    parameters = [*(one for layer in layers for one in layer.parameters()), steepness, edge]
    optimizer = torch.optim.AdamW(parameters, lr=_LEARNING_RATE, weight_decay=_WEIGHT_DECAY)
    cycle = torch.optim.lr_scheduler.OneCycleLR(optimizer, _LEARNING_RATE, total_steps=sum(map(len, batches)))

    def predict(some: Any) -> tuple[Any, Any]:
        hidden = torch.relu(layers[1](torch.relu(layers[0](some))))
        predicted = softplus(layers[2](hidden)).mean(dim=1)
        return predicted, logsigmoid(-steepness * (predicted - edge)).sum(dim=1)

    def log_loss_of(accepted: Any, missed: Any) -> Any:
        return -(accepted * (1.0 - missed) + (1.0 + 1e-6 - accepted.exp()).log() * missed).mean()

    best: tuple[float, int, list[np.ndarray]] = (np.inf, 0, [])
    for epoch, order in enumerate(batches, start=1):
        for some in order:
            predicted, accepted = predict(x[some])
            loss = smooth_l1_loss(predicted, ratios[some].clamp(max=3.0)) + log_loss_of(accepted, refused[some])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            cycle.step()
        with torch.no_grad():
            log_loss = float(log_loss_of(predict(x_judged)[1], torch.from_numpy(hits)))
        if log_loss < best[0]:
            best = (log_loss, epoch, [one.detach().numpy().T.copy() for one in parameters])
        progress(epoch, log_loss)
    made = SenseHeader(settings, tuple(memories), {}, provenance(settings=dump(settings), command=command))
    sense = BodySense(made, dict(zip(_ARRAYS, [centre, spread, *best[2]], strict=True)))
    chance, hit = sense.refusal(tried, dt_s), hits > 0
    n_pairs = int(hit.sum()) * int((~hit).sum())
    auc = float(mannwhitneyu(chance[hit], chance[~hit]).statistic) / n_pairs if n_pairs else None
    told = {"epoch": best[1], "auc": auc, "log_loss": best[0], "n_performed": len(hit), "n_refused": int(hit.sum())}
    sense.header = dataclasses.replace(made, validation={**told, "n_expected": float(chance.sum())})
    return sense
