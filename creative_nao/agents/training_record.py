"""What a training has come to so far: episodes, evaluations, the best weights; with the state, a checkpoint file."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao import atomic
from creative_nao.agents.training_state import TrainingState
from creative_nao.errors import FileFormatError, SettingsError
from creative_nao.fields import Fields, only_arrays
from creative_nao.tensorfile import load_tensors, save_tensors

KIND = "agent checkpoint"
FORMAT_VERSION = 1


@dataclass
class TrainingRecord:
    """The record of a training; it grows while the training runs.

    Attributes:
        episode_ends: Decisions made, over all copies, when each training episode ended.
        episode_rewards: Reward of each.
        evaluation_ends: Decisions made when each evaluation took place.
        evaluations: Rewards of the episodes of each evaluation.
        best_weights: Weights of the policy at the best evaluation. The one before any training does not count: where
            no training helps, an untrained policy should not pass for a trained one.
    """

    episode_ends: list[int] = field(default_factory=list)
    episode_rewards: list[float] = field(default_factory=list)
    evaluation_ends: list[int] = field(default_factory=list)
    evaluations: list[tuple[float, ...]] = field(default_factory=list)
    best_weights: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def best_mean(self) -> float:
        """Highest mean reward of an evaluation after training began, minus infinity before the first."""
        ends = zip(self.evaluation_ends, self.evaluations, strict=True)
        return max((float(np.mean(one)) for end, one in ends if end > 0), default=-np.inf)

    def evaluated(self, n_decisions: int, rewards: tuple[float, ...], weights: dict[str, np.ndarray]) -> None:
        """Take an evaluation in, and its weights if it is the best so far."""
        if not self.best_weights or float(np.mean(rewards)) > self.best_mean:
            self.best_weights = weights
        self.evaluation_ends.append(n_decisions)
        self.evaluations.append(rewards)

    def save(self, path: Path, plan: dict[str, Any], state: TrainingState) -> None:
        """Write record and state as a checkpoint."""
        arrays = {f"state.{name}": array for name, array in state.arrays.items()}
        arrays |= {f"best.{name}": array for name, array in self.best_weights.items()}
        arrays |= {
            "record.episode_ends": np.array(self.episode_ends, dtype=np.int64),
            "record.episode_rewards": np.array(self.episode_rewards, dtype=np.float64),
            "record.evaluation_ends": np.array(self.evaluation_ends, dtype=np.int64),
            "record.evaluations": np.array(self.evaluations, dtype=np.float64),
        }
        header = {"format_version": FORMAT_VERSION, "plan": plan, "state": state.values}
        save_tensors(path, kind=KIND, header=header, tensors=arrays)

    @classmethod
    def load(cls, path: Path, plan: dict[str, Any]) -> tuple[TrainingRecord, TrainingState]:
        """Read a checkpoint of `save`.

        Raises:
            FileFormatError: If it is damaged.
            SettingsError: If it is of another plan; the message names the setting.
        """
        values, arrays = load_tensors(path, kind=KIND)
        header = Fields(values, f"{path}: header")
        header.version("format_version", FORMAT_VERSION)
        if (name := _difference(header.object("plan").values, plan)) is not None:
            raise SettingsError(
                f"{path} is of a training with another `{name}`; give the same settings to go on, or another --out"
            )
        for name, array in arrays.items():
            if array.dtype.kind == "f" and not np.isfinite(array).all():
                raise FileFormatError(f"{path}: part `{name[:60]}` of the checkpoint should be finite, but is not")
        columns = [_column(path, arrays, name, dtype, n_axes) for name, (dtype, n_axes) in _COLUMNS.items()]
        ends, rewards, judged_at, judged = columns
        if len(ends) != len(rewards) or len(judged_at) != len(judged):
            lengths = ", ".join(f"`{name}` {len(column)}" for name, column in zip(_COLUMNS, columns, strict=True))
            raise FileFormatError(f"{path}: parts of the checkpoint have different lengths: {lengths}")
        only_arrays(path, arrays, [*_COLUMNS, *(name for name in arrays if name.startswith(("state.", "best.")))])
        rows = [tuple(row) for row in judged.tolist()] if judged.ndim == 2 else []
        record = cls(ends.tolist(), rewards.tolist(), judged_at.tolist(), rows, _under("best.", arrays))
        return record, TrainingState(header.object("state").values, _under("state.", arrays))

    def write_csv(self, folder: Path) -> None:
        """Write `episodes.csv` and `evaluations.csv` into a folder."""
        rows = zip(self.episode_ends, self.episode_rewards, strict=True)
        atomic.write_text(folder / "episodes.csv", _csv(("n_decisions", "reward"), rows))
        judged = (
            (end, float(np.mean(rewards)), *rewards)
            for end, rewards in zip(self.evaluation_ends, self.evaluations, strict=True)
        )
        n_episodes = len(self.evaluations[0]) if self.evaluations else 0
        heads = ("n_decisions", "mean_reward", *(f"reward_{place}" for place in range(n_episodes)))
        atomic.write_text(folder / "evaluations.csv", _csv(heads, judged))


_COLUMNS: dict[str, tuple[type[np.generic], int]] = {
    "record.episode_ends": (np.int64, 1),
    "record.episode_rewards": (np.float64, 1),
    "record.evaluation_ends": (np.int64, 1),
    "record.evaluations": (np.float64, 2),
}


def _column(path: Path, arrays: dict[str, np.ndarray], name: str, dtype: type[np.generic], n_axes: int) -> np.ndarray:
    found = arrays.get(name)
    if found is None:
        raise FileFormatError(f"{path}: part `{name}` of the checkpoint is missing")
    if found.dtype != dtype or (found.ndim != n_axes and found.shape != (0,)):
        raise FileFormatError(
            f"{path}: part `{name}` of the checkpoint should be {np.dtype(dtype)} with {n_axes} axes, "
            f"but is {found.dtype} of shape {found.shape}"
        )
    return found


def _csv(heads: tuple[str, ...], rows: Any) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows(rows)
    return text.getvalue()


def _under(prefix: str, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}


def _difference(one: dict[str, Any], other: dict[str, Any], prefix: str = "") -> str | None:
    for name in sorted(one.keys() | other.keys()):
        left, right = one.get(name), other.get(name)
        if isinstance(left, dict) and isinstance(right, dict):
            if (found := _difference(left, right, f"{prefix}{name}.")) is not None:
                return found
        elif left != right:
            return prefix + name
    return None
