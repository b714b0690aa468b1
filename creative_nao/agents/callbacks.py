"""Callbacks of Stable-Baselines3: they record a training, evaluate, write checkpoints and logs, and stop when asked to.

Stable-Baselines3 is imported with this module, which training loads when it begins.
"""

from __future__ import annotations

import csv
import io
import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import KVWriter, Logger, TensorBoardOutputFormat

from creative_nao import storage
from creative_nao.agents.resume import (
    ResumeState,
    TrainingRecord,
    capture,
    check_weights,
    plain_numbers,
    restore,
    restore_log,
    restore_random,
    save_checkpoint,
)
from creative_nao.agents.settings import find_algorithm
from creative_nao.errors import FileFormatError


class EpisodeRecorder(BaseCallback):
    """Adds the reward of each training episode that ends to a record; `on_rollout_end` is told the decisions made."""

    def __init__(self, record: TrainingRecord, on_rollout_end: Callable[[int], None] | None = None) -> None:
        super().__init__()
        self.record, self._report = record, on_rollout_end

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if "episode" in info:
                self.record.episode_ends.append(self.num_timesteps)
                self.record.episode_rewards.append(float(info["episode"]["r"]))
        return True

    def _on_rollout_end(self) -> None:
        if self._report is not None:
            self._report(self.num_timesteps)


class TrainingCallback(EpisodeRecorder):
    """Records and evaluates a training, keeps checkpoints, and stops when asked to.

    It goes on from `state`, if there is one; `plan` is a `TrainingPlan`, `evaluate` returns the rewards of an
    evaluation of the present weights, and the other arguments are those of `train_agent`.
    """

    def __init__(
        self,
        record: TrainingRecord,
        state: ResumeState | None,
        plan: Any,
        evaluate: Callable[[], tuple[float, ...]],
        *,
        checkpoint: Path | None,
        progress: Callable[[TrainingRecord, int], None] | None,
        stop: threading.Event,
    ) -> None:
        super().__init__(record)
        self._state, self._plan, self._evaluate = state, plan, evaluate
        self._checkpoint, self._progress, self._stop = checkpoint, progress, stop
        # An algorithm that learns from whole rollouts is stopped within one by going back to its beginning.
        self._on_policy = find_algorithm(plan.hyperparameters.algorithm).on_policy
        self._logs: Path | None = None
        self._just_restored = state is not None
        self._rollout_start: ResumeState | None = None
        self._n_saved = -1

    def prepare(self, model: Any, logs: Path | None, tensorboard: Path | None) -> int:
        """Put the model into the state of the checkpoint, attach the logs; return the decisions already made."""
        if self._state is not None:
            restore(model, self._state)
            check_weights(self.record.best_weights, model.policy)
            self._n_saved = model.num_timesteps
        self._logs = logs
        writers: list[KVWriter] = []
        if logs is not None:
            logs.mkdir(parents=True, exist_ok=True)
            writers.append(ProgressTable(logs / "progress.csv", model.num_timesteps))
        if tensorboard is not None:
            tensorboard.mkdir(parents=True, exist_ok=True)
            writers.append(TensorBoardOutputFormat(str(tensorboard)))
        model.set_logger(Logger(None if logs is None else str(logs), writers))
        if self._state is not None:
            restore_log(model.logger, self._state)
        return model.num_timesteps

    def finish(self, model: Any) -> None:
        """Evaluate the last weights, keep the final state, and put the best weights into the policy."""
        self.model = model
        self._evaluate_if_due(last=True)
        if self._n_saved < model.num_timesteps:
            self._save()
        if self._logs is not None:
            write_record(self._logs, self.record)
        best = self.record.best_weights
        model.policy.load_state_dict({name: torch.from_numpy(array.copy()) for name, array in best.items()})
        model.policy.set_training_mode(False)
        model.logger.close()

    def _on_rollout_start(self) -> None:
        if self._just_restored:
            assert self._state is not None
            restore_random(self.model, self._state)
            self._just_restored = False
        elif self._stop.is_set():
            self._leave()
        self._evaluate_if_due()
        n_done = self.model.num_timesteps
        if self._progress is not None:
            self._progress(self.record, n_done)
        due = n_done // self._plan.checkpoint_interval > max(self._n_saved, 0) // self._plan.checkpoint_interval
        if self._checkpoint is not None and (self._on_policy or due):
            self._rollout_start = capture(self.model)
            if due:
                self._save(self._rollout_start)
                self._n_saved = n_done

    def _on_step(self) -> bool:
        if self._on_policy and self._stop.is_set():
            if self._rollout_start is not None:  # what has ended since will be played again
                n_kept = sum(end <= self._rollout_start.values["num_timesteps"] for end in self.record.episode_ends)
                del self.record.episode_ends[n_kept:], self.record.episode_rewards[n_kept:]
            self._leave(self._rollout_start)
        return super()._on_step()

    def _leave(self, state: ResumeState | None = None) -> None:
        self._save(state)
        raise KeyboardInterrupt

    def _save(self, state: ResumeState | None = None) -> None:
        if self._checkpoint is not None:
            save_checkpoint(self._checkpoint, self._plan.as_json(), self.record, state or capture(self.model))

    def _evaluate_if_due(self, last: bool = False) -> None:
        n_done, interval = self.model.num_timesteps, self._plan.evaluation_interval
        ends = self.record.evaluation_ends
        if ends and (ends[-1] == n_done or (not last and n_done // interval <= ends[-1] // interval)):
            return
        rewards = self._evaluate()
        weights = {
            name: tensor.detach().cpu().numpy().copy() for name, tensor in self.model.policy.state_dict().items()
        }
        self.record.evaluated(n_done, rewards, weights)
        self.logger.record("validation/mean_reward", sum(rewards) / len(rewards))


MAX_LOG_BYTES = 8_000_000


class ProgressTable(KVWriter):
    """Keeps what the algorithm logs as the rows of one CSV file; those up to `n_decisions` are kept if it is there."""

    def __init__(self, path: Path, n_decisions: int) -> None:
        self.path = path
        self.rows: list[dict[str, Any]] = []
        if n_decisions and path.is_file():
            # The row of the very decision at which the checkpoint was made was written before it.
            self.rows = [row for row in read_log(path) if int(row.get("n_decisions") or 0) <= n_decisions]

    def write(self, key_values: dict[str, Any], key_excluded: dict[str, Any], step: int = 0) -> None:
        """Add a row and write the file anew."""
        self.rows.append({"n_decisions": step, **plain_numbers(key_values)})
        heads = list(dict.fromkeys(head for row in self.rows for head in row))
        write_table(self.path, heads, ([row.get(head, "") for head in heads] for row in self.rows))

    def close(self) -> None:
        """Nothing is kept open."""


def read_log(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a log; a `FileFormatError` if it is none."""
    text = storage.read_text(path, "log of a training", MAX_LOG_BYTES)
    try:
        rows = [dict(row) for row in csv.DictReader(io.StringIO(text, newline=""))]
    except csv.Error as error:
        raise FileFormatError(f"{path}: not a log of a training: {error}") from None
    for row in rows:
        if None in row or not (row.get("n_decisions") or "0").isdecimal():
            raise FileFormatError(f"{path}: not a log of a training: `n_decisions` is {row.get('n_decisions')!r:.40}")
    return rows


def write_table(path: Path, heads: Iterable[str], rows: Iterable[Iterable[Any]]) -> Path:
    """Write rows as CSV in one step and return the path."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([heads, *rows])
    return storage.write_text(path, text.getvalue())


def write_record(folder: Path, record: TrainingRecord) -> None:
    """Write `episodes.csv` and `evaluations.csv` of a training into a folder."""
    ended = zip(record.episode_ends, record.episode_rewards, strict=True)
    write_table(folder / "episodes.csv", ("n_decisions", "reward"), ended)
    n_episodes = len(record.evaluations[0]) if record.evaluations else 0
    heads = ("n_decisions", "mean_reward", *(f"reward_{place}" for place in range(n_episodes)))
    rows = zip(record.evaluation_ends, record.evaluations, strict=True)
    write_table(folder / "evaluations.csv", heads, ((end, float(np.mean(one)), *one) for end, one in rows))
