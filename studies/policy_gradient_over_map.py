"""A learned map trained on by policy gradients over whole simulated episodes, of which every reward is known.

    python studies/policy_gradient_over_map.py MAP --memories runs/memories --validation-memories runs/held-out

A policy draws its points with probability exp(p m / `--temperature`), of the probability p and the distance m that the
map expects of each point asked. At each step the reward of all points asked is known, so the gradient of what the next
movement earns is exact; that of the movements after it, up to `--horizon` of them, is weighed by what the episode
earned beyond the mean of the other episodes in the same memory (REINFORCE with a leave-one-out baseline). The
supervised loss is kept beside it. It prints what is earned in training, and by greedy play on the memories of
`--validation-memories` before and after.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from learned_map_bound import rewards, standard_error

from creative_nao.agents import load_agent
from creative_nao.agents.learned_map.episodes import N_ACTIONS, SimulatedEpisode, network_inputs
from creative_nao.agents.learned_map.network import AttentiveMap, expected
from creative_nao.agents.learned_map.training import Simulator, SupervisedMap, learning_rate, losses
from creative_nao.agents.learned_map.truth import read_truths
from creative_nao.errors import SettingsError

GROUP = 8
"""Memories of an update, and episodes in each."""
N_QUERIES, N_STEPS = 128, 8
"""Points asked before each movement; movements of an episode that the gradient is taken of."""
AVERAGING = 0.98
"""Decay of the moving average of the weights, which is what is judged."""


@dataclass(frozen=True)
class GradientSettings:
    """A learned map trained on by policy gradients."""

    start: tyro.conf.Positional[str]
    """Bundle of `agent train learned_map`, or the name of a shipped one."""
    memories: Path
    """Folder of the memories that it learns on."""
    validation_memories: Path
    """Folder of those that it is judged on."""
    updates: int = 160
    """Updates, of 64 episodes each."""
    temperature: float = 0.05
    """Divisor of what a point is expected to earn."""
    horizon: int = 30
    """How many later movements a movement is credited with; 0: none."""
    learning_rate: float = 2e-4
    """Highest step size of AdamW, which rises and falls as in `SupervisedMap`."""
    copies: int = 4
    """Symmetric copies of each validation memory that are played."""
    seed: int = 0
    """Of the episodes."""


def later(earned: np.ndarray, horizon: int) -> np.ndarray:
    """Return what up to `horizon` movements after each one earn, (n, movements) of (n, movements)."""
    total = np.concatenate([np.zeros((len(earned), 1)), earned.cumsum(axis=1)], axis=1)
    place = np.arange(earned.shape[1])
    return total[:, np.minimum(place + 1 + horizon, earned.shape[1])] - total[:, place + 1]


def beyond_others(returns: np.ndarray) -> np.ndarray:
    """Return returns (GROUP x GROUP, movements) less the mean of the other episodes in the same memory."""
    group = returns.reshape(GROUP, GROUP, -1)
    return (group - (group.sum(axis=1, keepdims=True) - group) / (GROUP - 1)).reshape(returns.shape)


def policy_loss(
    policy: AttentiveMap, simulator: Simulator, settings: GradientSettings, rng: np.random.Generator
) -> tuple[torch.Tensor, float]:
    """Play an update's episodes; return their loss, a scalar, and the mean reward of an episode."""
    begun = [simulator.begin(int(place), rng) for place in rng.integers(len(simulator.truths), size=GROUP)]
    episodes = [SimulatedEpisode(one.truth, one.warp, one.order) for one in begun for _ in range(GROUP)]
    points, kept = np.stack([one.warp(one.truth.pb) for one in episodes]), []
    used, earned = rng.choice(N_ACTIONS, N_STEPS, replace=False), np.zeros((len(episodes), N_ACTIONS))
    for step in range(N_ACTIONS):
        known = network_inputs(episodes)
        places = rng.integers(points.shape[1], size=(len(episodes), N_QUERIES))
        queries = torch.from_numpy(np.take_along_axis(points, places[..., None], 1))
        done = np.stack([np.isin(some, one.performed) for some, one in zip(places, episodes, strict=True)])
        worth = np.stack([one.worth(some) for some, one in zip(places, episodes, strict=True)])
        with torch.inference_mode():
            probability, distance, _ = expected(policy.decode(policy.encode(*known), queries))
        value = (probability * distance).numpy() / settings.temperature
        chosen = np.where(done, -np.inf, value + rng.gumbel(size=value.shape)).argmax(axis=1)
        for row, one in enumerate(episodes):
            one.perform(int(places[row, chosen[row]]))
            earned[row, step] = one.earned[-1]
        if step in used:
            kept.append((step, known, queries, done, chosen, worth))
    credit, loss = torch.from_numpy(beyond_others(later(earned, settings.horizon))).float(), torch.zeros(())
    for step, known, queries, done, chosen, worth in kept:
        probability, distance, _ = expected(policy.decode(policy.encode(*known), queries))
        logits = (probability * distance / settings.temperature).masked_fill(torch.from_numpy(done), -1e9)
        log_policy = logits.log_softmax(-1)
        now = (log_policy.exp() * torch.from_numpy(worth).float()).sum(-1)
        then = log_policy.gather(1, torch.from_numpy(chosen)[:, None])[:, 0] * credit[:, step]
        loss = loss - (now + then).mean() / (2.0 * N_STEPS)
    return loss, float(earned.sum(axis=1).mean())


def run(settings: GradientSettings) -> list[float]:
    """Print what is earned; return the mean on validation memories before and after."""
    if settings.updates < 1 or settings.horizon < 0 or not settings.temperature > 0.0:
        raise SettingsError("`updates` should be at least 1, `horizon` at least 0, and `temperature` above 0")
    policy: Any = load_agent(settings.start).policy  # pyright: ignore[reportAttributeAccessIssue]
    recipe = SupervisedMap(learning_rate=settings.learning_rate, swapped_actions=(1, 0, 3, 2, 5, 4), imagined_share=0.0)
    simulator, judged = Simulator(read_truths(settings.memories), recipe), read_truths(settings.validation_memories)
    average = copy.deepcopy(policy)
    optimiser = torch.optim.AdamW(policy.parameters(), settings.learning_rate, betas=(0.9, 0.98), weight_decay=0.0)
    torch.set_num_threads(1)  # so that sums are made in the same order everywhere
    before, earned = rewards(average, judged, settings.copies), []
    print(f"before: {before.mean():.2f}", flush=True)
    for update in range(settings.updates):
        rng = np.random.default_rng([settings.seed, update])
        loss, reward = policy_loss(policy, simulator, settings, rng)
        known, (queries, *truth) = simulator.batch(rng)
        terms = losses(policy(*known, queries), *truth)
        for group in optimiser.param_groups:
            group["lr"] = learning_rate(recipe, update, settings.updates)
        optimiser.zero_grad()
        (loss + terms[0] + terms[1] + recipe.basic_weight * terms[2]).backward()
        torch.nn.utils.clip_grad_norm_(policy.parameters(), recipe.max_grad_norm)
        optimiser.step()
        with torch.no_grad():
            for one, new in zip(average.parameters(), policy.parameters(), strict=True):
                one.lerp_(new, 1.0 - min(AVERAGING, (update + 1) / (update + 11)))
        earned.append(reward)
        if (update + 1) % 20 == 0:
            print(f"{update + 1} updates, drawn actions on what it learns on: {np.mean(earned[-20:]):.2f}", flush=True)
    after = rewards(average, judged, settings.copies)
    gain = after - before
    print(f"after: {after.mean():.2f}, {gain.mean():+.2f} +- {standard_error(gain):.2f} over {len(gain)} memories")
    return [float(before.mean()), float(after.mean())]


if __name__ == "__main__":
    run(tyro.cli(GradientSettings, description=__doc__))
