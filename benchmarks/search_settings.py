"""How the settings of the searching agents were chosen: mean reward on the validation memories, in the mind.

    python benchmarks/search_settings.py                     # every agent with its default settings
    python benchmarks/search_settings.py --vary              # every agent with every combination tried, best first
    python benchmarks/search_settings.py --vary --agents cma_es,cma_me

Every line is the mean over the validation memories (seeds 10 and 11 of each condition) and `--n-seeds` repetitions of
an episode of 30 actions in `CreativeNao/BoxingMental-v0`, with the standard error over the repetitions. The test
memories play no part. The default of an agent is the best combination tried. Replay is not tuned: the wider it strays,
the less it replays.
"""

import argparse
import functools
import itertools
import time

import gymnasium as gym
import numpy as np

import creative_nao  # noqa: F401 - registers the environments
from creative_nao.agents import UNTRAINED, black_box, quality_diversity
from creative_nao.evaluation.protocol import play
from creative_nao.model import split_memories

ENV = "CreativeNao/BoxingMental-v0"

TRIED = {
    "cma_es": (
        black_box.CmaEsAgent,
        black_box.CmaEsSettings,
        {"population_size": (4, 5, 6, 10), "sigma": (0.3, 0.5, 0.8, 1.2)},
    ),
    "cma_me": (
        quality_diversity.CmaMeAgent,
        quality_diversity.CmaMeSettings,
        {"batch_size": (3, 5, 6, 10), "sigma": (0.3, 0.5, 0.8, 1.2), "n_cells": (6, 12)},
    ),
    "map_elites": (
        quality_diversity.MapElitesAgent,
        quality_diversity.MapElitesSettings,
        {"n_initial": (5, 10, 15), "batch_size": (1, 5), "sigma": (0.15, 0.3, 0.5, 0.8), "n_cells": (6, 12)},
    ),
    "novelty_search": (
        quality_diversity.NoveltySearchAgent,
        quality_diversity.NoveltySearchSettings,
        {"n_initial": (5, 10), "batch_size": (3, 5), "sigma": (0.3, 0.5, 0.8, 1.2), "n_neighbours": (1, 3)},
    ),
    "bayesian": (black_box.BayesianAgent, black_box.BayesianSettings, {"n_startup": (5, 10, 15)}),
}
"""Agent, settings and the values tried of each setting."""


def measure(make, memories, n_seeds, n_actions):
    """Return the rewards of an agent, shape (n_memories, n_seeds), and the seconds of an episode."""
    start = time.perf_counter()
    rewards = np.zeros((len(memories), n_seeds))
    for row, memory in enumerate(memories):
        env = gym.make(ENV, memory=memory, n_actions=n_actions)
        agent = make()
        for seed in range(n_seeds):
            episode = play(agent, env, env_id=ENV, memory=memory, seed=seed, n_actions=n_actions)
            rewards[row, seed] = episode.reward
        env.close()
    return rewards, (time.perf_counter() - start) / rewards.size


def standard_error(rewards):
    """Return the standard error of the mean over repetitions, the memories being fixed."""
    if rewards.shape[1] < 2:
        return float("nan")
    return float(np.sqrt((rewards.var(axis=1, ddof=1) / rewards.shape[1]).mean() / len(rewards)))


def line(name, rewards, seconds):
    """Return a line of the table."""
    by_memory = " ".join(f"{mean:6.2f}" for mean in rewards.mean(axis=1))
    return f"{rewards.mean():6.2f} +- {standard_error(rewards):4.2f}  {by_memory}  {seconds:6.3f} s  {name}"


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--agents", default=",".join(UNTRAINED), help="which, with commas between")
    parser.add_argument("--n-seeds", type=int, default=10, help="repetitions on each memory")
    parser.add_argument("--n-actions", type=int, default=30, help="actions in an episode")
    parser.add_argument("--vary", action="store_true", help="try all combinations instead of the defaults")
    chosen = parser.parse_args()
    memories = split_memories("validation")
    print(f"validation memories: {' '.join(memories)}; {chosen.n_seeds} repetitions, {chosen.n_actions} actions, {ENV}")
    print("  mean +- s.e.  by memory" + " " * (7 * len(memories) - 9) + "  episode   agent")
    for name in chosen.agents.split(","):
        if not chosen.vary:
            print(line(name, *measure(UNTRAINED[name], memories, chosen.n_seeds, chosen.n_actions)), flush=True)
            continue
        if name not in TRIED:
            continue
        agent, settings, values = TRIED[name]
        lines = []
        for combination in itertools.product(*values.values()):
            given = dict(zip(values, combination, strict=True))
            make = functools.partial(agent, settings(**given))
            found = measure(make, memories, chosen.n_seeds, chosen.n_actions)
            lines.append((-found[0].mean(), line(f"{name} {given}", *found)))
        for _, text in sorted(lines):
            print(text, flush=True)


if __name__ == "__main__":
    main()
