"""Train a learned map on the truth of memories: simulated episodes, every point's truth as the target.

Everything drawn at a step follows from the seed and the number of the step, so that a checkpoint holds weights and
moments only and a resumed training has the same bits.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import torch
from gymnasium.spaces import Box
from torch import Tensor, nn

from creative_nao.agents.callbacks import ProgressTable, write_record
from creative_nao.agents.learned_map.network import LOG_SPREAD, AttentiveMap
from creative_nao.agents.learned_map.truth import MemoryTruth, refuse_test_memories
from creative_nao.agents.resume import (
    ResumeState,
    TrainingRecord,
    check_weights,
    load_checkpoint,
    pack,
    save_checkpoint,
    unpack,
)
from creative_nao.agents.settings import Hyperparameters
from creative_nao.agents.training import TrainingPlan
from creative_nao.arrays import take
from creative_nao.envs.observation import layout, observation_space, try_columns
from creative_nao.errors import FileFormatError, SettingsError
from creative_nao.measures.outcome import ALL_OUTCOMES
from creative_nao.schema import Count, Field, NonNegative, Positive, UnitInterval, record

N_ACTIONS = 30
"""Movements performed in a simulated episode, at most."""
CANDIDATES = (1, 1, 2, 4, 8, 16, 64)
"""How many movements a simulated episode looks at for each one performed: one of these is drawn."""
LOSSES = ("loss", "appropriate", "distance")


@record
class SupervisedMap:
    """How a learned map is trained; the settings of the algorithm `learned_map` in its hyperparameter file."""

    policy_aliases: ClassVar[dict[str, type[AttentiveMap]]] = {"AttentiveMap": AttentiveMap}

    learning_rate: Positive = 2e-3
    """Highest step size of AdamW: it rises linearly to it and falls to zero as a cosine."""
    warm_up: UnitInterval = 0.1
    """Share of the steps in which it rises."""
    weight_decay: NonNegative = 0.01
    """Of AdamW."""
    max_grad_norm: Positive = 1.0
    """Largest norm of the gradient of a step."""
    batch_size: Count = 32
    """Simulated episodes of a step."""
    n_queries: Count = 128
    """PB points asked in each."""
    imagined_share: UnitInterval = 0.3
    """Share of the episodes in which what was imagined is shown to the network too."""
    n_rows: Annotated[int, Field(ge=N_ACTIONS)] = 96
    """Most tries shown in training."""


class SimulatedEpisode:
    """An episode over the truth of a memory, up to a movement drawn: what was tried, and what every point earns now.

    Args:
        truth: The memory.
        rng: Draws the behaviour: how many movements are performed, and the best of how many each of them is.
        imagined_share: Probability that what is imagined is kept, so that the best of all is performed.
        n_rows: Most tries kept.

    Attributes:
        tried: Places of the points tried: those imagined only, then those performed in the order of time.
        n_performed: How many of them were performed.
        reward: What each earned, or is worth now where it was imagined only, (n_tried,).
        known_distance: Distance of every point to the nearest movement known now, (n,), float32.
    """

    def __init__(self, truth: MemoryTruth, rng: np.random.Generator, imagined_share: float, n_rows: int) -> None:
        n, usable = len(truth.pb), truth.appropriate
        self.truth, self.known_distance = truth, truth.distances.min(axis=1)
        self.n_performed = int(rng.integers(N_ACTIONS))
        k, keeps = int(rng.choice(CANDIDATES)), bool(rng.random() < imagined_share)
        performed, earned = [], []
        pool = np.empty(0, np.int64)
        for _ in range(self.n_performed):
            pool = np.concatenate([pool, rng.integers(n, size=k)]) if keeps else rng.integers(n, size=k)
            best = int(pool[np.where(usable[pool], self.known_distance[pool], -1.0).argmax()])
            performed.append(best)
            earned.append(self.perform(best))
            pool = pool[pool != best]
        if keeps:
            pool = np.unique(np.concatenate([pool, rng.integers(n, size=int(rng.integers(k + 1)))]))
            pool = rng.permutation(pool[~np.isin(pool, performed)])[: n_rows - self.n_performed]
        else:
            pool = pool[:0]
        self.tried = np.concatenate([pool, np.array(performed, np.int64)])
        self.reward = np.concatenate([np.where(usable[pool], self.known_distance[pool], 0.0), earned])

    def perform(self, place: int) -> float:
        """Perform the movement of a point and return what it earns."""
        if not self.truth.appropriate[place]:
            return 0.0
        reward = float(self.known_distance[place])
        self.known_distance = np.minimum(self.known_distance, self.truth.gaps[place])
        return reward


def rows_of(truth: MemoryTruth, tried: np.ndarray, reward: np.ndarray) -> np.ndarray:
    """Return tries as rows of the -v1 observation, (n_tried, width), float32."""
    told = truth.distances[tried]
    outcome = np.eye(len(ALL_OUTCOMES), dtype=np.float32)[truth.outcome[tried]]
    columns = (
        np.ones((len(tried), 1)),
        truth.pb[tried],
        outcome,
        (reward / (reward + 1.0))[:, None],
        told / (told + 1.0),
    )
    return np.concatenate(columns, axis=1, dtype=np.float32)


def turned(n_pb: int, rng: np.random.Generator) -> np.ndarray:
    """Draw a symmetry of the PB space, which flips and swaps its axes: a matrix (n_pb, n_pb), float32."""
    return (np.eye(n_pb, dtype=np.float32) * rng.choice([-1.0, 1.0], n_pb).astype(np.float32))[rng.permutation(n_pb)]


def make_batch(truths: Sequence[MemoryTruth], recipe: SupervisedMap, rng: np.random.Generator) -> list[Tensor]:
    """Return a batch of b simulated episodes.

    Returns:
        Learned points (b, n_basic, n_pb), rows (b, n, width), whether performed (b, n), points asked (b, q, n_pb);
        and the truth there: whether appropriate (b, q), and the distance to everything known then (b, q).
    """
    parts: list[list[np.ndarray]] = [[] for _ in range(6)]
    n_pb, n_basic = truths[0].form
    width = try_columns(n_basic, n_pb)[-1].stop
    for _ in range(recipe.batch_size):
        truth = truths[rng.integers(len(truths))]
        episode = SimulatedEpisode(truth, rng, recipe.imagined_share, recipe.n_rows)
        turn, asked = turned(n_pb, rng), rng.integers(len(truth.pb), size=recipe.n_queries)
        rows, performed = np.zeros((recipe.n_rows, width), np.float32), np.zeros(recipe.n_rows, np.float32)
        n = len(episode.tried)
        rows[:n] = rows_of(truth, episode.tried, episode.reward)
        rows[:n, 1 : 1 + n_pb] = rows[:n, 1 : 1 + n_pb] @ turn.T
        performed[n - episode.n_performed : n] = 1.0
        usable, far = truth.appropriate[asked].astype(np.float32), episode.known_distance[asked]
        values = (truth.learned_pb @ turn.T, rows, performed, truth.pb[asked] @ turn.T, usable, far)
        for part, value in zip(parts, values, strict=True):
            part.append(value)
    points, rows, performed, pb, usable, far = (np.stack(part).astype(np.float32) for part in parts)
    longest = max(int((rows[..., 0] > 0.0).sum(axis=1).max()), 1)
    return [torch.from_numpy(one) for one in (points, rows[:, :longest], performed[:, :longest], pb, usable, far)]


def losses(told: Tensor, usable: Tensor, far: Tensor) -> tuple[Tensor, Tensor]:
    """Return both losses of what the network tells (b, q, 3): of being appropriate, and of the distance where it is.

    The first is the cross-entropy of the probability p, the second the negative log-likelihood of a normal
    distribution N(mu, s) of the distance, up to a constant: (d - mu)^2 / (2 s^2) + log s.
    """
    log_spread = told[..., 2].clamp(*LOG_SPREAD)
    likelihood = (told[..., 1] - far) ** 2 * torch.exp(-2.0 * log_spread) / 2.0 + log_spread
    return nn.functional.binary_cross_entropy_with_logits(told[..., 0], usable), (usable * likelihood).mean()


def judge(policy: AttentiveMap, truths: Sequence[MemoryTruth], seeds: Sequence[int]) -> tuple[float, ...]:
    """Return the reward of greedy episodes over the points of each memory, seed by seed.

    A seed decides how the axes of the PB space are flipped and swapped; to the memory that makes no difference.
    """
    found = []
    with torch.inference_mode():
        for truth in truths:
            for seed in seeds:
                found.append(_greedy_reward(policy, truth, turned(truth.form[0], np.random.default_rng(seed))))
    return tuple(found)


def _greedy_reward(policy: AttentiveMap, truth: MemoryTruth, turn: np.ndarray) -> float:
    pb, learned = truth.pb @ turn.T, truth.learned_pb @ turn.T
    known, earned, tried = truth.distances.min(axis=1), [], np.empty(0, np.int64)
    for _ in range(N_ACTIONS):
        rows = rows_of(truth, tried, np.array(earned))
        rows[:, 1 : 1 + pb.shape[1]] = pb[tried]
        values = policy.expected_reward(learned, rows, np.ones(len(rows)), pb, policy.settings.optimism)
        values[tried] = -np.inf
        best = int(values.argmax())
        earned.append(float(known[best]) if truth.appropriate[best] else 0.0)
        known = np.minimum(known, truth.gaps[best]) if truth.appropriate[best] else known
        tried = np.append(tried, best)
    return sum(earned)


def learning_rate(recipe: SupervisedMap, step: int, n_steps: int) -> float:
    """Return the step size of a step, counted from 0."""
    rising = max(recipe.warm_up * n_steps, 1.0)
    if step < rising:
        return recipe.learning_rate * (step + 1.0) / (rising + 1.0)
    return recipe.learning_rate * 0.5 * (1.0 + float(np.cos(np.pi * (step - rising) / max(n_steps - rising, 1.0))))


def train_map(
    plan: TrainingPlan,
    truths: Sequence[MemoryTruth],
    judged: Sequence[MemoryTruth],
    *,
    checkpoint: Path | None = None,
    resume: bool = False,
    logs: Path | None = None,
    progress: Callable[[TrainingRecord, int], None] | None = None,
    stop: threading.Event | None = None,
) -> tuple[AttentiveMap, TrainingRecord]:
    """Train a learned map; the counterpart of `training.train_agent` for what learns from memories.

    Args:
        plan: What to train; its intervals and `n_timesteps` count simulated episodes.
        truths: Memories to learn from, all with as many PB units and basic actions.
        judged: Validation memories; the weights that earn most there are kept.
        checkpoint: File to keep weights and moments in; None keeps none.
        resume: Go on from `checkpoint` if it is there; the result has the same bits.
        logs: Folder for `progress.csv` (the losses) and `evaluations.csv`; None writes none.
        progress: Called after each step with the record so far and the episodes simulated.
        stop: When set, training ends with a checkpoint.

    Returns:
        The map with its best weights, and the record.

    Raises:
        KeyboardInterrupt: After `stop` was set; the checkpoint is written.
        SettingsError: If a test memory is among them, a memory is in both, or the checkpoint is of another plan.
        FileFormatError: If the checkpoint is damaged.
    """
    _check(truths, judged)
    chosen, told = plan.hyperparameters, plan.as_json()
    told |= {"truths": [one.name for one in truths], "judged": [one.name for one in judged]}
    recipe = SupervisedMap(**chosen.arguments)
    torch.set_num_threads(1)  # so that sums are made in the same order everywhere
    torch.manual_seed(plan.seed)
    policy = untrained_map(truths[0].form, chosen)
    optimiser = torch.optim.AdamW(policy.parameters(), recipe.learning_rate, weight_decay=recipe.weight_decay)
    result, n_steps, done = TrainingRecord(), -(-chosen.n_timesteps // recipe.batch_size), 0
    seen: list[list[float]] = []
    if resume and checkpoint is not None and checkpoint.is_file():
        result, state = load_checkpoint(checkpoint, told)
        done = _restore(policy, optimiser, result, state, checkpoint, n_steps)
        seen = take(checkpoint, state.arrays, "seen", (None, len(LOSSES))).tolist()
    table = None if logs is None else ProgressTable(logs / "progress.csv", done * recipe.batch_size)

    def save() -> None:
        if checkpoint is not None:
            arrays = {"seen": np.array(seen, np.float64).reshape(-1, len(LOSSES))}
            values: dict[str, Any] = {"step": done, "weights": pack(policy.state_dict(), "weights", arrays)}
            values["optimiser"] = pack(optimiser.state_dict(), "optimiser", arrays)
            save_checkpoint(checkpoint, told, result, ResumeState(values, arrays))

    def evaluate() -> None:
        policy.set_training_mode(False)
        weights = {name: tensor.numpy().copy() for name, tensor in policy.state_dict().items()}
        result.evaluated(done * recipe.batch_size, judge(policy, judged, plan.judged_seeds), weights)

    def due(interval: int) -> bool:
        return done * recipe.batch_size // interval > (done - 1) * recipe.batch_size // interval

    if not result.evaluations:
        evaluate()
    while done < n_steps:
        if stop is not None and stop.is_set():
            save()
            raise KeyboardInterrupt
        policy.set_training_mode(True)
        rng = np.random.default_rng([plan.seed, done])
        torch.manual_seed(int(rng.integers(2**62)))  # of dropout
        *known, usable, far = make_batch(truths, recipe, rng)
        parts = losses(policy(*known), usable, far)
        loss = parts[0] + parts[1]
        for group in optimiser.param_groups:
            group["lr"] = learning_rate(recipe, done, n_steps)
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(policy.parameters(), recipe.max_grad_norm)
        optimiser.step()
        seen.append([loss.item(), *(part.item() for part in parts)])
        done += 1
        if due(plan.evaluation_interval) or done == n_steps:
            evaluate()
            if table is not None:
                means = np.mean(seen, axis=0).tolist()
                table.write(dict(zip(LOSSES, means, strict=True)), {}, done * recipe.batch_size)
            seen = []
        if due(plan.checkpoint_interval) or done == n_steps:
            save()
        if progress is not None:
            progress(result, done * recipe.batch_size)
    if logs is not None:
        write_record(logs, result)
    policy.load_state_dict({name: torch.from_numpy(one.copy()) for name, one in result.best_weights.items()})
    policy.set_training_mode(False)
    return policy, result


def untrained_map(form: tuple[int, int], chosen: Hyperparameters) -> AttentiveMap:
    """Return a map with first weights, for memories with `form` = PB units and basic actions."""
    n_pb, n_basic = form
    columns = try_columns(n_basic, n_pb)
    observed = observation_space(layout(n_basic, n_pb, n_rows=N_ACTIONS), columns)
    policy = SupervisedMap.policy_aliases[chosen.policy](
        observed, Box(-1.0, 1.0, (n_pb,), np.float32), **chosen.sb3_policy_kwargs()
    )
    if policy.n_basic != n_basic:
        raise SettingsError(f"`n_basic` should be {n_basic}, as these memories have, but is {policy.n_basic}")
    return policy


def _check(truths: Sequence[MemoryTruth], judged: Sequence[MemoryTruth]) -> None:
    if not truths or not judged:
        raise SettingsError("a learned map needs memories to learn from and others to be judged on")
    refuse_test_memories((*truths, *judged), "the memories of a training")
    forms = {one.form for one in (*truths, *judged)}
    if len(forms) > 1:
        raise SettingsError(
            f"the memories of a training should have one form, but have {sorted(forms)} (PB units, actions)"
        )
    learned = {one.learned_pb.tobytes() for one in truths}
    for one in judged:
        if one.learned_pb.tobytes() in learned:
            raise SettingsError(f"validation memory `{one.name}` is among those that are trained on")


def _restore(
    policy: AttentiveMap, optimiser: Any, result: TrainingRecord, state: ResumeState, path: Path, n_steps: int
) -> int:
    """Put a training into the state of a checkpoint and return the steps done."""
    try:
        policy.load_state_dict(unpack(state.values["weights"], state.arrays))
        optimiser.load_state_dict(unpack(state.values["optimiser"], state.arrays))
        check_weights(result.best_weights, policy)
        done = state.values["step"]
        if type(done) is not int or not 0 <= done <= n_steps:
            raise ValueError(f"`step` should be from 0 to {n_steps}, but is {done!r:.40}")
    except (KeyError, ValueError, TypeError, RuntimeError, IndexError, AttributeError) as error:
        raise FileFormatError(f"{path}: the state does not fit this training: {error}") from error
    return done
