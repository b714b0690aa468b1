"""Figures of the rewards: per agent, over the budget, in training, and what became of the actions."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from creative_nao.evaluation.drawing import figure
from creative_nao.evaluation.palette import FAINT, INK, OUTCOMES, agent_colour, agent_label, agent_marker
from creative_nao.evaluation.protocol import Episode
from creative_nao.evaluation.results import Measured, Oracle
from creative_nao.evaluation.suites import Suite
from creative_nao.evaluation.tables import env_label

MAX_BINS = 40
"""Most points of a training curve; each is a mean over the episodes that ended in its stretch."""

FEW = 4
"""Most agents whose curves have bands, and room for a legend between them."""

ORACLE = {"color": INK, "linestyle": (0, (1, 1.5)), "linewidth": 1.6}


def rewards(suite: Suite, results: Mapping[str, Any], measured: Measured, memory: str) -> Figure:
    """Draw each agent's reward: a dot per seed, the mean with its interval, the oracle as a dotted line."""
    drawn, axes = figure(8.6, 1.5 + 0.55 * len(suite.agents), 1, len(suite.envs), sharey=True, sharex=True)
    for ax, env in zip(axes, suite.envs, strict=True):
        for place, agent in enumerate(reversed(suite.agents)):
            row = next(r for r in results["rows"] if (r["agent"], r["env"], r["memory"]) == (agent, env, memory))
            episodes = _episodes(measured, memory, env, agent)
            colour = agent_colour(agent)
            spread = np.linspace(0.12, 0.3, len(episodes))
            ax.scatter([e.reward for e in episodes], place - spread, s=14, color=colour, alpha=0.45, linewidths=0)
            reward = row["reward"]
            if reward["low"] is not None:
                ax.plot(
                    [reward["low"], reward["high"]], [place, place], color=colour, linewidth=4, solid_capstyle="round"
                )
            ax.plot(reward["mean"], place, agent_marker(agent), color="white", mec=colour, mew=2.2, ms=9)
            ax.annotate(
                f"{reward['mean']:.1f}", (reward["mean"], place), (0, 9), textcoords="offset points", ha="center"
            )
        if env in suite.oracle_envs:
            _oracle_line(ax, measured.oracles[memory])
        ax.set(title=f"{env_label(env)} environment", xlabel=f"reward of {suite.n_actions} actions")
        ax.set_yticks(range(len(suite.agents)), [agent_label(agent) for agent in reversed(suite.agents)])
        ax.set_ylim(-0.55, len(suite.agents) - 0.4)
        ax.grid(axis="y", visible=False)
    _from_zero(axes, "x")
    return drawn


def cumulative(suite: Suite, measured: Measured, memory: str) -> Figure:
    """Draw the reward gathered so far against the actions generated: mean over seeds, band from lowest to highest."""
    drawn, axes = figure(8.6, 3.6, 1, len(suite.envs), sharey=True, sharex=True)
    budget = np.arange(suite.n_actions + 1)
    for ax, env in zip(axes, suite.envs, strict=True):
        for agent in suite.agents:
            gathered = np.array([[a.reward for a in e.actions] for e in _episodes(measured, memory, env, agent)])
            gathered = np.pad(np.cumsum(gathered, axis=1), ((0, 0), (1, 0)))
            colour = agent_colour(agent)
            if len(suite.agents) <= FEW:  # bands of many would hide one another
                ax.fill_between(
                    budget, gathered.min(axis=0), gathered.max(axis=0), color=colour, alpha=0.14, linewidth=0
                )
            marks = {"marker": agent_marker(agent), "markevery": 5, "markersize": 5}
            ax.plot(budget, gathered.mean(axis=0), color=colour, linewidth=2, label=agent_label(agent), **marks)
        if env in suite.oracle_envs:
            best = np.cumsum([0.0, *measured.oracles[memory].rewards])
            ax.plot(np.arange(len(best)), best, label="oracle", **ORACLE)
        ax.set(title=f"{env_label(env)} environment", xlabel="actions generated", xlim=(0, suite.n_actions))
    _from_zero(axes, "y")
    axes[0].set_ylabel("reward so far")
    if len(suite.agents) > FEW:
        axes[-1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    else:
        axes[-1].legend(loc="upper left")
    return drawn


def training(suite: Suite, measured: Measured, memory: str) -> Figure:
    """Draw the training episodes' rewards: a line per seed and their mean, beside what the untrained agents reach."""
    drawn, (ax,) = figure(8.6, 3.6)
    for agent in dict.fromkeys(t.agent for t in measured.trainings if t.memory == memory):
        curves = [t for t in measured.trainings if (t.memory, t.agent) == (memory, agent)]
        n_bins = min(MAX_BINS, len(set(curves[0].n_actions)))  # copies of an environment end their episodes together
        edges = np.linspace(0.0, curves[0].n_actions[-1], n_bins + 1)
        centres = 0.5 * (edges[1:] + edges[:-1])
        binned = np.array([_binned(t.n_actions, t.reward, edges) for t in curves])
        colour = agent_colour(agent)
        ax.plot(centres, binned.T, color=colour, linewidth=0.8, alpha=0.35)
        ax.plot(
            centres, binned.mean(axis=0), color=colour, linewidth=2.4, label=f"{agent}, mean of {len(curves)} seeds"
        )
    dashes = itertools.cycle(["--", "-.", (0, (8, 3))])
    for agent in suite.agents:
        level = [e.reward for e in _episodes(measured, memory, suite.training_env, agent)]
        if level and not any(t.agent == agent for t in measured.trainings):
            ax.axhline(
                float(np.mean(level)), color=agent_colour(agent), linewidth=1.8, linestyle=next(dashes), label=agent
            )
    if suite.training_env in suite.oracle_envs:
        ax.axhline(sum(measured.oracles[memory].rewards), label="oracle", **ORACLE)
    ax.set(xlabel="actions generated in training", ylabel=f"reward of an episode ({suite.n_actions} actions)")
    _from_zero([ax], "x")
    _from_zero([ax], "y")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return drawn


def outcomes(suite: Suite, measured: Measured, memory: str) -> Figure:
    """Draw what became of all generated actions, as shares, per agent and environment."""
    pairs = [(env, agent) for env in suite.envs for agent in suite.agents]
    drawn, (ax,) = figure(8.6, 1.3 + 0.34 * len(pairs))
    left = np.zeros(len(pairs))
    counts = [Counter(a.outcome for e in _episodes(measured, memory, *pair) for a in e.actions) for pair in pairs]
    known = [*OUTCOMES, *sorted({name for count in counts for name in count} - set(OUTCOMES))]
    for name in known:
        share = np.array([100.0 * count[name] / max(1, count.total()) for count in counts])
        if not share.any():
            continue
        colour = OUTCOMES.get(name, FAINT)
        bars = ax.barh(range(len(pairs)), share, left=left, color=colour, label=name.replace("_", " "), height=0.72)
        ax.bar_label(
            bars,
            [f"{value:.0f}" if value >= 4.0 else "" for value in share],
            label_type="center",
            color="white" if _dark(colour) else INK,
            fontsize=8.5,
        )
        left += share
    ax.set_yticks(range(len(pairs)), [f"{agent_label(agent)}, {env_label(env)}" for env, agent in pairs])
    ax.invert_yaxis()
    ax.set(xlabel="share of the generated actions [%]", xlim=(0.0, 100.0))
    ax.grid(axis="y", visible=False)
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=5, fontsize=9)
    return drawn


def _episodes(measured: Measured, memory: str, env: str, agent: str) -> list[Episode]:
    return [e for e in measured.episodes if (e.memory, e.env, e.agent) == (memory, env, agent)]


def _from_zero(axes: Sequence[Axes], which: str) -> None:
    """Let the axes begin at zero and end a little beyond everything drawn on any of them."""
    largest = max(getattr(ax.dataLim, f"{which}max") for ax in axes)
    for ax in axes:
        ax.set(**{f"{which}lim": (0.0, 1.06 * largest)})


def _oracle_line(ax: Axes, oracle: Oracle) -> None:
    total = sum(oracle.rewards)
    ax.axvline(total, **ORACLE)
    ax.annotate(
        f"oracle {total:.1f}", (total, 1.0), (-4, -2), xycoords=("data", "axes fraction"), textcoords="offset points",
        ha="right", va="top",
    )  # fmt: skip


def _binned(n_actions: Sequence[int], values: Sequence[float], edges: np.ndarray) -> np.ndarray:
    place = np.clip(np.digitize(n_actions, edges, right=True) - 1, 0, len(edges) - 2)
    total = np.bincount(place, weights=values, minlength=len(edges) - 1)
    count = np.bincount(place, minlength=len(edges) - 1)
    return np.divide(total, count, out=np.full(len(edges) - 1, np.nan), where=count > 0)


def _dark(colour: str) -> bool:
    red, green, blue = (int(colour[place : place + 2], 16) for place in (1, 3, 5))
    return 0.299 * red + 0.587 * green + 0.114 * blue < 140
