"""Figures over all memories: who earns most, how surely, how evenly, and what is left to find."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from creative_nao.evaluation.drawing import figure
from creative_nao.evaluation.palette import FAINT, INK, agent_colour, agent_label, agent_marker
from creative_nao.evaluation.results import Measured
from creative_nao.evaluation.suites import Suite
from creative_nao.evaluation.tables import env_label

Entry = Mapping[str, Any]
WIDTH = 8.6


def standing(results: Mapping[str, Any]) -> Figure:
    """Draw each agent's mean reward (marker) and interquartile mean (line) with intervals, best above."""
    envs = list(dict.fromkeys(entry["env"] for entry in results["summary"]))
    most = max(len(_ranked(results, env)) for env in envs)
    drawn, axes = figure(WIDTH, 1.2 + 0.36 * most, 1, len(envs))
    for ax, env in zip(axes, envs, strict=True):
        entries = _ranked(results, env)
        for place, entry in enumerate(reversed(entries)):
            _interval(ax, entry["reward"], place, entry["agent"])
            ax.plot([entry["reward_iqm"]["mean"]] * 2, [place - 0.28, place + 0.28], color=INK, linewidth=1.4)
        if results["baseline"] is not None:
            base = next(entry for entry in entries if entry["agent"] == results["baseline"])
            ax.axvline(base["reward"]["mean"], color=FAINT, linestyle=(0, (4, 2)), linewidth=1.2, zorder=0)
        _names(ax, entries)
        ax.set(title=f"{env_label(env)} environment", xlabel="reward of an episode")
    return drawn


def improvement(results: Mapping[str, Any]) -> Figure:
    """Draw how probable it is that an episode of each agent earns more than one of the baseline."""
    envs = list(dict.fromkeys(entry["env"] for entry in results["summary"] if entry["versus"] is not None))
    most = max(len(_ranked(results, env)) for env in envs)
    drawn, axes = figure(WIDTH, 1.2 + 0.36 * most, 1, len(envs))
    for ax, env in zip(axes, envs, strict=True):
        entries = [entry for entry in _ranked(results, env) if entry["versus"] is not None]
        for place, entry in enumerate(reversed(entries)):
            _interval(ax, entry["versus"]["probability_of_improvement"], place, entry["agent"], scale=100.0)
        ax.axvline(50.0, color=FAINT, linestyle=(0, (4, 2)), linewidth=1.2, zorder=0)
        _names(ax, entries)
        ax.set(
            title=f"{env_label(env)} environment",
            xlabel=f"better than an episode of {agent_label(results['baseline'])} [%]",
            xlim=(0.0, 104.0),
        )
    return drawn


def profiles(results: Mapping[str, Any]) -> Figure:
    """Draw the share of episodes that reach at least a share of the oracle's reward."""
    entries = sorted(
        (entry for entry in results["summary"] if entry["profile"] is not None and entry["agent"] != "oracle"),
        key=lambda entry: -entry["oracle_share"]["mean"],
    )
    drawn, (ax,) = figure(WIDTH, 4.2)
    largest = 0.0
    for entry in entries:
        profile, colour = entry["profile"], agent_colour(entry["agent"])
        share = 100.0 * np.array(profile["threshold"])
        low, high = (100.0 * np.array(profile[edge]) for edge in ("low", "high"))
        above = 100.0 * np.array(profile["share_above"])
        ax.fill_between(share, low, high, color=colour, alpha=0.12, linewidth=0)
        ax.plot(
            share, above, color=colour, marker=agent_marker(entry["agent"]), markersize=5, linewidth=1.8,
            label=agent_label(entry["agent"]),
        )  # fmt: skip
        largest = max(largest, float(share[(high > 0.0).nonzero()[0][-1]]))
    ax.set(xlabel="share of the oracle's reward [%]", ylabel="episodes above it [%]", ylim=(0.0, 102.0))
    ax.set_xlim(0.0, min(100.0, largest + 10.0))
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return drawn


def regret(suite: Suite, measured: Measured) -> Figure:
    """Draw how far each agent's gathered reward stays behind the oracle's, action by action, over all memories."""
    drawn, (ax,) = figure(WIDTH, 4.2)
    budget = np.arange(suite.n_actions + 1)
    env = suite.oracle_envs[0]
    best = {
        memory: np.pad(np.cumsum(_padded(oracle.rewards, suite.n_actions)), (1, 0))
        for memory, oracle in measured.oracles.items()
    }
    curves = {}
    for agent in suite.agents:
        episodes = [e for e in measured.episodes if (e.env, e.agent) == (env, agent)]
        gathered = [np.pad(np.cumsum([a.reward for a in e.actions]), (1, 0)) for e in episodes]
        if episodes:
            curves[agent] = np.mean([best[e.memory] - g for e, g in zip(episodes, gathered, strict=True)], axis=0)
    for agent, curve in sorted(curves.items(), key=lambda item: -item[1][-1]):
        ax.plot(
            budget, curve, color=agent_colour(agent), marker=agent_marker(agent), markevery=5, markersize=5,
            linewidth=1.8, label=agent_label(agent),
        )  # fmt: skip
    ax.set(xlabel="actions generated", ylabel="reward behind the oracle", xlim=(0, suite.n_actions))
    ax.set_ylim(bottom=0.0)
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return drawn


def _padded(rewards: Sequence[float], n_actions: int) -> np.ndarray:
    return np.pad(np.array(rewards, dtype=np.float64), (0, n_actions - len(rewards)))


def _ranked(results: Mapping[str, Any], env: str) -> list[Entry]:
    return sorted((e for e in results["summary"] if e["env"] == env), key=lambda entry: -entry["reward"]["mean"])


def _interval(ax: Axes, found: Mapping[str, Any], place: int, agent: str, scale: float = 1.0) -> None:
    colour = agent_colour(agent)
    if found["low"] is not None:
        ends = [scale * found["low"], scale * found["high"]]
        ax.plot(ends, [place, place], color=colour, linewidth=4, solid_capstyle="round", alpha=0.75)
    ax.plot(scale * found["mean"], place, agent_marker(agent), color="white", mec=colour, mew=2.0, ms=7.5)


def _names(ax: Axes, entries: Sequence[Entry]) -> None:
    ax.set_yticks(range(len(entries)), [agent_label(entry["agent"]) for entry in reversed(entries)])
    ax.set_ylim(-0.6, len(entries) - 0.4)
    ax.grid(axis="y", visible=False)
