"""The callback that watches a training: it records, judges, writes checkpoints and stops when asked to.

Everything happens between two rollouts, when nothing is half done. An algorithm that learns from whole rollouts may be
long within one; when it is asked to stop there, the state before that rollout is what is kept.
"""

from __future__ import annotations

import csv
import io
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from creative_nao import atomic
from creative_nao.agents.algorithms import find_algorithm
from creative_nao.agents.training_record import TrainingRecord
from creative_nao.agents.training_state import TrainingState, capture, check_weights, restore, restore_random
from creative_nao.errors import FileFormatError
from creative_nao.untrusted import read_text

if TYPE_CHECKING:
    from creative_nao.agents.training import TrainingPlan


def _rows(path: Path) -> list[dict[str, Any]]:
    text = read_text(path, "log of a training")
    try:
        rows = [dict(row) for row in csv.DictReader(io.StringIO(text, newline=""))]
    except csv.Error as error:
        raise FileFormatError(f"{path}: not a log of a training: {error}") from None
    for row in rows:
        if None in row or not (row.get("n_decisions") or "0").isdecimal():
            raise FileFormatError(f"{path}: not a log of a training: `n_decisions` is {row.get('n_decisions')!r:.40}")
    return rows


def watch(
    plan: TrainingPlan,
    record: TrainingRecord,
    state: TrainingState | None,
    *,
    judge: Callable[[], tuple[float, ...]],
    checkpoint: Path | None,
    tensorboard: Path | None,
    logs: Path | None,
    progress: Callable[[TrainingRecord, int], None] | None,
    stop: threading.Event,
) -> Any:
    """Return the callback; Stable-Baselines3 is loaded here."""
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.logger import KVWriter, Logger, TensorBoardOutputFormat

    on_policy = find_algorithm(plan.hyperparameters.algorithm).on_policy

    class ProgressTable(KVWriter):
        """Keeps what the algorithm logs as the rows of one CSV file."""

        def __init__(self, path: Path, n_decisions: int) -> None:
            self.path = path
            self.rows: list[dict[str, Any]] = []
            if n_decisions and path.is_file():
                # The row of the very decision at which the checkpoint was made was written before it.
                self.rows = [row for row in _rows(path) if int(row.get("n_decisions") or 0) <= n_decisions]

        def write(self, key_values: dict[str, Any], key_excluded: dict[str, Any], step: int = 0) -> None:
            self.rows.append({"n_decisions": step, **_numbers(key_values)})
            heads = list(dict.fromkeys(head for row in self.rows for head in row))
            text = io.StringIO()
            writer = csv.DictWriter(text, heads, lineterminator="\n")
            writer.writeheader()
            writer.writerows(self.rows)
            atomic.write_text(self.path, text.getvalue())

        def close(self) -> None:
            """Nothing is kept open."""

    class Watch(BaseCallback):
        def __init__(self) -> None:
            super().__init__()
            self.fresh = state is not None
            self.kept: TrainingState | None = None
            self.saved = -1

        def prepare(self, model: Any) -> int:
            """Put the model into the state of the checkpoint, attach the logs; return the decisions already made."""
            if state is not None:
                restore(model, state)
                check_weights(record.best_weights, model.policy)
            self.saved = model.num_timesteps if state is not None else -1
            writers: list[KVWriter] = []
            if logs is not None:
                logs.parent.mkdir(parents=True, exist_ok=True)
                writers.append(ProgressTable(logs, model.num_timesteps))
            if tensorboard is not None:
                tensorboard.mkdir(parents=True, exist_ok=True)
                writers.append(TensorBoardOutputFormat(str(tensorboard)))
            model.set_logger(Logger(str(logs.parent) if logs else None, writers))
            if state is not None:
                _log_again(model.logger, state)
            return model.num_timesteps

        def finish(self, model: Any) -> None:
            """Judge the last weights, keep the final state, and put the best weights into the policy."""
            self.model = model
            self._judge_if_due(last=True)
            if checkpoint is not None and self.saved < model.num_timesteps:
                record.save(checkpoint, plan.as_json(), _whole_state(model))
            import torch

            model.policy.load_state_dict({k: torch.from_numpy(v.copy()) for k, v in record.best_weights.items()})
            model.policy.set_training_mode(False)
            model.logger.close()

        def _on_rollout_start(self) -> None:
            if self.fresh:
                assert state is not None
                restore_random(self.model, state)
                self.fresh = False
            elif stop.is_set():
                self._leave(_whole_state(self.model))
            self._judge_if_due()
            n_done = self.model.num_timesteps
            if progress is not None:
                progress(record, n_done)
            due = n_done // plan.checkpoint_interval > max(self.saved, 0) // plan.checkpoint_interval
            if checkpoint is not None and (on_policy or due):
                self.kept = _whole_state(self.model)
                if due:
                    record.save(checkpoint, plan.as_json(), self.kept)
                    self.saved = n_done

        def _on_step(self) -> bool:
            if on_policy and stop.is_set():
                kept = self.kept
                if kept is not None:
                    n_done = kept.values["num_timesteps"]
                    while record.episode_ends and record.episode_ends[-1] > n_done:
                        record.episode_ends.pop()
                        record.episode_rewards.pop()
                self._leave(kept)
            for info in self.locals["infos"]:
                if "episode" in info:
                    record.episode_ends.append(self.num_timesteps)
                    record.episode_rewards.append(float(info["episode"]["r"]))
            return True

        def _leave(self, kept: TrainingState | None) -> None:
            if checkpoint is not None and kept is not None:
                record.save(checkpoint, plan.as_json(), kept)
            raise KeyboardInterrupt

        def _judge_if_due(self, last: bool = False) -> None:
            n_done, interval = self.model.num_timesteps, plan.evaluation_interval
            ends = record.evaluation_ends
            if ends and (ends[-1] == n_done or (not last and n_done // interval <= ends[-1] // interval)):
                return
            rewards = judge()
            weights = {k: v.detach().cpu().numpy().copy() for k, v in self.model.policy.state_dict().items()}
            record.evaluated(n_done, rewards, weights)
            self.logger.record("validation/mean_reward", sum(rewards) / len(rewards))

    return Watch()


def _numbers(logged: Mapping[str, Any]) -> dict[str, int | float]:
    """Return the numbers among what was logged, as Python's own."""
    plain = {name: value.item() if hasattr(value, "item") else value for name, value in logged.items()}
    return {name: value for name, value in plain.items() if isinstance(value, int | float)}


def _whole_state(model: Any) -> TrainingState:
    """Return the state with what was logged since the last row: the next row tells it."""
    found, counts = capture(model), model.logger.name_to_count
    # As text, since what is logged may be no number, which JSON does not know.
    found.values["logged"] = {
        name: [repr(value), counts.get(name, 0), list(model.logger.name_to_excluded.get(name, ()))]
        for name, value in _numbers(model.logger.name_to_value).items()
    }
    return found


def _log_again(logger: Any, state: TrainingState) -> None:
    for name, (text, count, excluded) in state.values.get("logged", {}).items():
        logger.name_to_value[name] = int(text) if text.lstrip("-").isdigit() else float(text)
        logger.name_to_excluded[name] = tuple(excluded)
        if count:
            logger.name_to_count[name] = count
