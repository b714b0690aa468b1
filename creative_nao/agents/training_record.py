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
        header, arrays = load_tensors(path, kind=KIND)
        if header.get("format_version") != FORMAT_VERSION or not isinstance(header.get("plan"), dict):
            raise FileFormatError(f"{path}: the header of the checkpoint is incomplete or of another version")
        if (name := _difference(header["plan"], plan)) is not None:
            raise SettingsError(
                f"{path} is of a training with another `{name}`; give the same settings to go on, or another --out"
            )
        try:
            record = cls(
                arrays["record.episode_ends"].tolist(),
                arrays["record.episode_rewards"].tolist(),
                arrays["record.evaluation_ends"].tolist(),
                [tuple(row) for row in arrays["record.evaluations"].tolist()],
                _under("best.", arrays),
            )
            return record, TrainingState(header["state"], _under("state.", arrays))
        except KeyError as error:
            raise FileFormatError(f"{path}: part {error} of the checkpoint is missing") from None

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
