"""Train a learned map on the truth of memories: simulated episodes, every point's truth as the target.

Everything drawn at a step follows from the seed and the number of the step, so that a checkpoint holds weights and
moments only and a resumed training has the same bits.
"""

from __future__ import annotations

import contextlib
import copy
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar

import gymnasium as gym
import numpy as np
import torch
from gymnasium.spaces import Box
from torch import Tensor, nn

from creative_nao.agents.callbacks import ProgressTable, write_record
from creative_nao.agents.learned_map import episodes
from creative_nao.agents.learned_map.episodes import N_ACTIONS, SimulatedEpisode, play_greedily, random_warp
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
from creative_nao.schema import Count, Field, Index, NonNegative, Positive, UnitInterval, record

LOSSES = ("loss", "appropriate", "distance", "basic_distances")
N_OWN, OWN_ASKED, OWN_NOISE = 480, 96, 0.02
"""Episodes played by the map itself that are kept; points asked for each movement, and the noise on their values."""
N_IMAGINED = (24, 48, 96, 192)
"""Most imagined movements shown in the episodes of a step: one of these is drawn."""


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
    beta_2: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.98
    """Decay of the second moments of AdamW."""
    max_grad_norm: Positive = 1.0
    """Largest norm of the gradient of a step."""
    batch_size: Count = 32
    """Simulated episodes of a step; half as many where what was imagined is shown."""
    n_queries: Count = 128
    """PB points asked in each."""
    imagined_share: UnitInterval = 0.4
    """Share of the steps in which what was imagined is shown to the network too."""
    warp: NonNegative = 0.06
    """Strength of the random warps of the PB space: each is drawn between 0 and 1.5 times this."""
    swapped_actions: tuple[Index, ...] = ()
    """The basic actions in an order that hardly changes the distances between them, such as left and right swapped; so
    they stand in half of the episodes. Empty: in none."""
    basic_weight: NonNegative = 0.5
    """Weight of the error of the distances to the basic actions."""
    own_interval: Index = 300
    """Steps from one set of episodes that the map plays itself to the next; 0: it plays none."""
    own_size: Count = 48
    """Episodes of such a set."""
    averaging: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.995
    """Decay of the moving average of the weights, which is what is judged and kept."""


def losses(told: Tensor, usable: Tensor, far: Tensor, basic: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return the losses of what the network tells (b, q, 3 + n_basic): means over all points asked.

    The cross-entropy of the probability of being appropriate; where a point is, the negative log-likelihood of a normal
    distribution N(m, s) of the distance d to everything known, up to a constant: (d - m)^2 / (2 s^2) + log s; and there
    the mean squared error of the distances to the basic actions.
    """
    log_spread = told[..., 2].clamp(*LOG_SPREAD)
    likelihood = (told[..., 1] - far) ** 2 * torch.exp(-2.0 * log_spread) / 2.0 + log_spread
    cross_entropy = nn.functional.binary_cross_entropy_with_logits(told[..., 0], usable)
    return cross_entropy, (usable * likelihood).mean(), (usable * ((told[..., 3:] - basic) ** 2).mean(-1)).mean()


class Simulator:
    """Draws simulated episodes: of random behaviour, of planners, and of the map itself.

    Attributes:
        own: Episodes of the map: place of the memory and of the points performed, (n, 1 + N_ACTIONS).
    """

    def __init__(self, truths: Sequence[MemoryTruth], recipe: SupervisedMap) -> None:
        self.truths, self.recipe = truths, recipe
        self.own = np.empty((0, 1 + N_ACTIONS), np.int64)

    def begin(self, place: int, rng: np.random.Generator) -> SimulatedEpisode:
        """Return an episode in a memory, with a warp and an order of the actions of its own."""
        n_pb, n_basic = self.truths[place].n_units, self.truths[place].form[1]
        swapped = self.recipe.swapped_actions if rng.random() < 0.5 else ()
        warp = random_warp(n_pb, rng, 1.5 * self.recipe.warp * rng.random())
        return SimulatedEpisode(self.truths[place], warp, np.array(swapped or range(n_basic)))

    def batch(self, rng: np.random.Generator) -> tuple[list[Tensor], list[Tensor]]:
        """Return the `network_inputs` of a batch of episodes and its `queries_and_targets`."""
        recipe, imagines = self.recipe, bool(rng.random() < self.recipe.imagined_share)
        most, found = int(rng.choice(N_IMAGINED)), []
        for _ in range(max(recipe.batch_size // 2, 1) if imagines else recipe.batch_size):
            place, n = int(rng.integers(len(self.truths))), int(rng.integers(N_ACTIONS))
            again = None
            if not imagines and len(self.own) and rng.random() < 0.5:
                place, *again = self.own[rng.integers(len(self.own))].tolist()
            episode = self.begin(place, rng)
            if imagines:
                episode.perform_planned(n, rng)
                episode.imagined = rng.permutation(episode.imagined)[:most]
            elif again is None:
                episode.perform_best(n, int(rng.choice(episodes.CANDIDATES)), rng)
            for one in (again or [])[:n]:
                episode.perform(one)
            found.append(episode)
        return episodes.network_inputs(found), episodes.queries_and_targets(found, recipe.n_queries, rng)

    def play(self, policy: AttentiveMap, rng: np.random.Generator) -> None:
        """Let the map play episodes and keep them."""
        places = rng.integers(len(self.truths), size=self.recipe.own_size)
        played = [self.begin(place, rng) for place in places]
        play_greedily(policy, played, rng, OWN_ASKED, float(rng.choice([0.0, 0.5])), OWN_NOISE)
        new = np.concatenate([places[:, None], [one.performed for one in played]], axis=1)
        self.own = np.concatenate([self.own, new])[-N_OWN:]


def judge(policy: AttentiveMap, truths: Sequence[MemoryTruth], seeds: Sequence[int]) -> tuple[float, ...]:
    """Return the reward of greedy episodes over the points of each memory, seed by seed.

    A seed decides how the axes of the PB space are flipped and swapped; to the memory that makes no difference.
    """
    found = []
    for truth in truths:
        n_basic = truth.form[1]
        warps = [random_warp(truth.n_units, np.random.default_rng(seed)) for seed in seeds]
        played = [SimulatedEpisode(truth, warp, np.arange(n_basic)) for warp in warps]
        play_greedily(policy, played, np.random.default_rng(0))
        found += [float(sum(one.earned)) for one in played]
    return tuple(found)


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
    """
    _check(truths, judged)
    chosen, told = plan.hyperparameters, plan.as_json()
    told |= {"truths": [one.name for one in truths], "judged": [one.name for one in judged]}
    recipe = SupervisedMap(**chosen.arguments)
    batch_size = recipe.batch_size
    torch.set_num_threads(1)  # so that sums are made in the same order everywhere
    torch.manual_seed(plan.seed)
    policy = untrained_map(truths[0], chosen, recipe, plan)
    average, simulator = copy.deepcopy(policy), Simulator(truths, recipe)
    optimiser = torch.optim.AdamW(
        policy.parameters(), recipe.learning_rate, betas=(0.9, recipe.beta_2), weight_decay=recipe.weight_decay
    )
    result, n_steps, done = TrainingRecord(), -(-chosen.n_timesteps // batch_size), 0
    parts, seen = {"weights": policy, "average": average, "optimiser": optimiser}, []
    if resume and checkpoint is not None and checkpoint.is_file():
        result, state = load_checkpoint(checkpoint, told)
        done = _restore(parts, simulator, result, state, checkpoint, n_steps)
        seen = take(checkpoint, state.arrays, "seen", (None, len(LOSSES))).tolist()
    table = None if logs is None else ProgressTable(logs / "progress.csv", done * batch_size)

    def save() -> None:
        if checkpoint is not None:
            arrays = {"seen": np.array(seen, np.float64).reshape(-1, len(LOSSES)), "own": simulator.own}
            values = {name: pack(part.state_dict(), name, arrays) for name, part in parts.items()}
            save_checkpoint(checkpoint, told, result, ResumeState({"step": done, **values}, arrays))

    def evaluate() -> None:
        weights = {name: tensor.numpy().copy() for name, tensor in average.state_dict().items()}
        result.evaluated(done * batch_size, judge(average, judged, plan.judged_seeds), weights)

    def due(interval: int) -> bool:
        return done * batch_size // interval > (done - 1) * batch_size // interval

    if not result.evaluations:
        evaluate()
    while done < n_steps:
        if stop is not None and stop.is_set():
            save()
            raise KeyboardInterrupt
        rng = np.random.default_rng([plan.seed, done])
        torch.manual_seed(int(rng.integers(2**62)))  # of dropout
        if recipe.own_interval and done and done % recipe.own_interval == 0:
            policy.set_training_mode(False)
            simulator.play(policy, rng)
        policy.set_training_mode(True)
        known, (queries, *truth) = simulator.batch(rng)
        terms = losses(policy(*known, queries), *truth)
        loss = terms[0] + terms[1] + recipe.basic_weight * terms[2]
        for group in optimiser.param_groups:
            group["lr"] = learning_rate(recipe, done, n_steps)
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(policy.parameters(), recipe.max_grad_norm)
        optimiser.step()
        seen.append([loss.item(), *(term.item() for term in terms)])
        done += 1
        kept = min(recipe.averaging, done / (done + 50.0))
        with torch.no_grad():
            for one, new in zip(average.parameters(), policy.parameters(), strict=True):
                one.mul_(kept).add_(new, alpha=1.0 - kept)
        if due(plan.evaluation_interval) or done == n_steps:
            evaluate()
            if table is not None:
                means = np.mean(seen, axis=0).tolist()
                table.write(dict(zip(LOSSES, means, strict=True)), {}, done * batch_size)
            seen = []
        if due(plan.checkpoint_interval) or done == n_steps:
            save()
        if progress is not None:
            progress(result, done * batch_size)
    if logs is not None:
        write_record(logs, result)
    policy.load_state_dict({name: torch.from_numpy(one.copy()) for name, one in result.best_weights.items()})
    policy.set_training_mode(False)
    return policy, result


def untrained_map(
    truth: MemoryTruth, chosen: Hyperparameters, recipe: SupervisedMap, plan: TrainingPlan
) -> AttentiveMap:
    """Return a map with first weights, for memories of the form of this one."""
    n_pb, n_basic = truth.n_units, truth.form[1]
    columns = try_columns(n_basic, n_pb)
    observed: Any = observation_space(layout(n_basic, n_pb, n_rows=N_ACTIONS), columns)
    if (n_segments := chosen.policy_kwargs.get("n_segments", 1)) != truth.n_segments:
        raise SettingsError(f"`n_segments` of the policy is {n_segments}, but {truth.n_segments} of `{truth.name}`")
    if n_segments > 1:
        with contextlib.closing(gym.make(plan.env, memory=plan.memory)) as env:
            observed = env.observation_space
    if sorted(swapped := recipe.swapped_actions) not in ([], [*range(n_basic)]):
        raise SettingsError(f"`swapped_actions` should be an order of {n_basic} actions, but is {swapped}")
    kind, actions = SupervisedMap.policy_aliases[chosen.policy], Box(-1.0, 1.0, (n_pb,), np.float32)
    policy = kind(observed, actions, **chosen.sb3_policy_kwargs())
    policy.basic_gaps.copy_(torch.from_numpy(truth.basic_gaps))
    return policy


def _check(truths: Sequence[MemoryTruth], judged: Sequence[MemoryTruth]) -> None:
    if not truths or not judged:
        raise SettingsError("a learned map needs memories to learn from and others to be judged on")
    refuse_test_memories((*truths, *judged), "the memories of a training")
    forms = {(*one.form, one.n_segments) for one in (*truths, *judged)}
    if len(forms) > 1:
        raise SettingsError(f"memories should have the same PB units, actions and segments, but have {sorted(forms)}")
    learned = {one.learned_pb.tobytes() for one in truths}
    for one in judged:
        if one.learned_pb.tobytes() in learned:
            raise SettingsError(f"validation memory `{one.name}` is among those that are trained on")


def _restore(
    parts: dict[str, Any], simulator: Simulator, result: TrainingRecord, state: ResumeState, path: Path, n_steps: int
) -> int:
    """Put a training into the state of a checkpoint and return the steps done."""
    check_weights(result.best_weights, parts["average"])
    own = take(path, state.arrays, "own", (None, 1 + N_ACTIONS), np.int64, kinds="i", least=0)
    try:
        for name, part in parts.items():
            part.load_state_dict(unpack(state.values[name], state.arrays))
        n_points = min(len(truth.pb) for truth in simulator.truths)
        if len(own) and (own[:, 0].max() >= len(simulator.truths) or own[:, 1:].max() >= n_points):
            raise ValueError("`own` names memories or points that are not there")
        simulator.own, done = own, state.values["step"]
        if type(done) is not int or not 0 <= done <= n_steps:
            raise ValueError(f"`step` should be from 0 to {n_steps}, but is {done!r:.40}")
    except (KeyError, ValueError, TypeError, RuntimeError, IndexError, AttributeError) as error:
        raise FileFormatError(f"{path}: the state does not fit this training: {error}") from error
    return done
