"""Charts of a run: rewards per agent, over the budget and in training, outcomes, and comparisons over all memories."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from creative_nao.agents.registry import split_name
from creative_nao.evaluation.pages import env_label
from creative_nao.evaluation.protocol import Episode
from creative_nao.evaluation.results import CURVE, Entry, Measured, entries_of
from creative_nao.evaluation.suites import Suite
from creative_nao.maps.figure_style import FAINT, GREEN, INK, ORANGE, OUTCOME_COLOURS, figure

AGENTS = {
    "supervised": ("#64005D", "v"), "random": (ORANGE, "s"), "ppo": (GREEN, "D"), "oracle": (INK, "p"),
    "sobol": ("#016B8E", "<"), "replay": ("#07D7FA", ">"), "cma_es": ("#9A88C4", "h"), "cma_me": ("#C5CB18", "o"),
    "map_elites": ("#D832FF", "^"), "novelty_search": ("#321FAD", "*"), "bayesian": ("#FFA0BA", "X"),
    "sac": ("#8500DD", "P"), "td3": ("#0D4503", "p"), "tqc": ("#DB8FDA", "^"), "crossq": ("#86D788", "X"),
    "recurrent_ppo": ("#B7007D", "<"), "lattice": ("#4A2BFF", "P"), "spread": ("#C677FF", "<"),
    "spread_points": ("#76749D", ">"), "surrogate": ("#A800BE", "o"), "plan": ("#000098", "^"),
    "imagine": ("#565900", "X"), "imagine_with_body": ("#AD56D6", "s"), "plan_with_sense": ("#86B2FF", "h"),
    "plan_with_body": ("#4452A2", "o"), "plan_modulated": ("#93BC8F", "h"), "learned_map": ("#C2003A", "*"),
}  # fmt: skip
"""Colour and shape of an agent: those of one published run differ in both, with every kind of colour vision."""
OTHERS = ("#CC6677", "#44AA99", "#332288", "#999933", "#AA4499", "#661100")
SHAPES = ("o", "s", "D", "^", "v", "P", "X", "<", ">", "p", "h", "*")


def agent_label(agent: str) -> str:
    """Return how figures call an agent: a shipped bundle by its algorithm, a file by its stem."""
    base, number = split_name(agent)
    label = Path(base).stem if base.endswith(".safetensors") else base.split("/")[0]
    return label if number is None else f"{label}@{number}"


def agent_look(agent: str) -> tuple[str, str]:
    """Return the colour and the shape of an agent; the same for the same name."""
    label = agent_label(split_name(agent)[0])
    number = sum(label.encode())
    return AGENTS.get(label) or (OTHERS[number % len(OTHERS)], SHAPES[number % len(SHAPES)])


def agent_colour(agent: str) -> str:
    """Return the colour of an agent."""
    return agent_look(agent)[0]


WIDTH = 8.6
"""Of a figure [inch]."""
MAX_BINS = 40
"""Most points of a training curve; each is a mean over the episodes that ended in its stretch."""
FEW = 4
"""Most agents whose curves have bands, and room for a legend between them."""
ORACLE = {"color": INK, "linestyle": (0, (1, 1.5)), "linewidth": 1.6}
BESIDE = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5)}
PROFILE = ("threshold", "share_above", "low", "high")
REFERENCE = {"color": FAINT, "linestyle": (0, (4, 2)), "linewidth": 1.2, "zorder": 0}


def rewards(suite: Suite, results: Mapping[str, Any], measured: Measured, memory: str) -> Figure:
    """Draw each agent's reward: a dot per seed, the mean with its interval, the oracle as a dotted line."""
    drawn, axes = figure(WIDTH, 1.5 + 0.55 * len(suite.agents), 1, len(suite.envs), sharey=True, sharex=True)
    for ax, env in zip(axes, suite.envs, strict=True):
        for place, agent in enumerate(reversed(suite.agents)):
            row = next(r for r in results["rows"] if (r["agent"], r["env"], r["memory"]) == (agent, env, memory))
            earned = [episode.reward for episode in measured.of(memory, env, agent)]
            spread = np.linspace(0.12, 0.3, len(earned))
            ax.scatter(earned, place - spread, s=14, color=agent_colour(agent), alpha=0.45, linewidths=0)
            _interval(ax, row["reward"], place, agent, size=9.0, edge=2.2, alpha=1.0)
            mean = row["reward"]["mean"]
            ax.annotate(f"{mean:.1f}", (mean, place), (0, 9), textcoords="offset points", ha="center")
        if env in suite.oracle_envs:
            total = sum(measured.oracles[memory].rewards)
            ax.axvline(total, **ORACLE)
            ax.annotate(
                f"oracle {total:.1f}", (total, 1.0), (-4, -2), xycoords=("data", "axes fraction"),
                textcoords="offset points", ha="right", va="top",
            )  # fmt: skip
        ax.set(title=f"{env_label(env)} environment", xlabel=f"reward of {suite.n_actions} actions")
        _agents_below(ax, suite.agents, margin=0.55)
    _from_zero(axes, "x")
    return drawn


def cumulative(suite: Suite, measured: Measured, memory: str) -> Figure:
    """Draw the reward gathered so far against the actions generated: mean over seeds, band from lowest to highest."""
    drawn, axes = figure(WIDTH, 3.6, 1, len(suite.envs), sharey=True, sharex=True)
    for ax, env in zip(axes, suite.envs, strict=True):
        for agent in suite.agents:
            gathered = np.array([_gathered(episode) for episode in measured.of(memory, env, agent)])
            if len(suite.agents) <= FEW:  # bands of many would hide one another
                band = gathered.min(axis=0), gathered.max(axis=0)
                ax.fill_between(np.arange(len(band[0])), *band, color=agent_colour(agent), alpha=0.14, linewidth=0)
            _line(ax, np.arange(gathered.shape[1]), gathered.mean(axis=0), agent, width=2.0, markevery=5)
        if env in suite.oracle_envs:
            best = np.cumsum([0.0, *measured.oracles[memory].rewards])
            ax.plot(np.arange(len(best)), best, label="oracle", **ORACLE)
        ax.set(title=f"{env_label(env)} environment", xlabel="actions generated", xlim=(0, suite.n_actions))
    _from_zero(axes, "y")
    axes[0].set_ylabel("reward so far")
    axes[-1].legend(**BESIDE if len(suite.agents) > FEW else {"loc": "upper left"})
    return drawn


def training(suite: Suite, measured: Measured, memory: str) -> Figure:
    """Draw the training episodes' rewards: a line per seed and their mean, beside what the untrained agents reach."""
    drawn, (ax,) = figure(WIDTH, 3.6)
    for agent in dict.fromkeys(t.agent for t in measured.trainings if t.memory == memory):
        curves = [t for t in measured.trainings if (t.memory, t.agent) == (memory, agent)]
        n_bins = min(MAX_BINS, len(set(curves[0].n_actions)))  # sub-environments end their episodes together
        edges = np.linspace(0.0, curves[0].n_actions[-1], n_bins + 1)
        centres = 0.5 * (edges[1:] + edges[:-1])
        binned = np.array([_binned(t.n_actions, t.reward, edges) for t in curves])
        colour, label = agent_colour(agent), f"{agent}, mean of {len(curves)} seeds"
        ax.plot(centres, binned.T, color=colour, linewidth=0.8, alpha=0.35)
        ax.plot(centres, binned.mean(axis=0), color=colour, linewidth=2.4, label=label)
    dashes = itertools.cycle(["--", "-.", (0, (8, 3))])
    for agent in suite.agents:
        level = [episode.reward for episode in measured.of(memory, suite.training_env, agent)]
        if level and not any(t.agent == agent for t in measured.trainings):
            look = {"color": agent_colour(agent), "linewidth": 1.8, "linestyle": next(dashes)}
            ax.axhline(float(np.mean(level)), label=agent, **look)
    if suite.training_env in suite.oracle_envs:
        ax.axhline(sum(measured.oracles[memory].rewards), label="oracle", **ORACLE)
    ax.set(xlabel="actions generated in training", ylabel=f"reward of an episode ({suite.n_actions} actions)")
    _from_zero([ax], "x")
    _from_zero([ax], "y")
    ax.legend(**BESIDE)
    return drawn


def outcomes(suite: Suite, measured: Measured, memory: str) -> Figure:
    """Draw what became of all generated actions, as shares, per agent and environment."""
    pairs = [(env, agent) for env in suite.envs for agent in suite.agents]
    drawn, (ax,) = figure(WIDTH, 1.3 + 0.34 * len(pairs))
    counts = [Counter(a.outcome for e in measured.of(memory, *pair) for a in e.actions) for pair in pairs]
    left = np.zeros(len(pairs))
    for name in (*OUTCOME_COLOURS, *sorted({name for count in counts for name in count} - set(OUTCOME_COLOURS))):
        share = np.array([100.0 * count[name] / max(1, count.total()) for count in counts])
        if not share.any():
            continue
        colour = OUTCOME_COLOURS.get(name, FAINT)
        dark = np.dot(to_rgb(colour), (0.299, 0.587, 0.114)) < 140.0 / 255.0
        bars = ax.barh(range(len(pairs)), share, left=left, color=colour, label=name.replace("_", " "), height=0.72)
        texts = [f"{value:.0f}" if value >= 4.0 else "" for value in share]
        ax.bar_label(bars, texts, label_type="center", color="white" if dark else INK, fontsize=8.5)
        left += share
    ax.set_yticks(range(len(pairs)), [f"{agent_label(agent)}, {env_label(env)}" for env, agent in pairs])
    ax.invert_yaxis()
    ax.set(xlabel="share of the generated actions [%]", xlim=(0.0, 100.0))
    ax.grid(axis="y", visible=False)
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=5, fontsize=9)
    return drawn


def standing(results: Mapping[str, Any]) -> Figure:
    """Draw each agent's mean reward (marker) and interquartile mean (line) with intervals, best above."""
    drawn, axes = _one_per_env(results["summary"])
    for ax, entries in axes:
        for place, entry in enumerate(reversed(entries)):
            _interval(ax, entry["reward"], place, entry["agent"])
            ax.plot([entry["reward_iqm"]["mean"]] * 2, [place - 0.28, place + 0.28], color=INK, linewidth=1.4)
            if entry["agent"] == results["baseline"]:
                ax.axvline(entry["reward"]["mean"], **REFERENCE)
        ax.set_xlabel("reward of an episode")
    return drawn


def improvement(results: Mapping[str, Any]) -> Figure:
    """Draw how probable it is that an episode of each agent earns more than one of the baseline."""
    drawn, axes = _one_per_env([entry for entry in results["summary"] if entry["versus"] is not None])
    for ax, entries in axes:
        for place, entry in enumerate(reversed(entries)):
            _interval(ax, entry["versus"]["probability_of_improvement"], place, entry["agent"], scale=100.0)
        ax.axvline(50.0, **REFERENCE)
        baseline = agent_label(results["baseline"])
        ax.set(xlabel=f"better than an episode of {baseline} [%]", xlim=(0.0, 104.0))
    return drawn


def profiles(results: Mapping[str, Any]) -> Figure:
    """Draw the share of episodes that reach at least a share of the oracle's reward."""
    entries = [entry for entry in results["summary"] if entry["profile"] is not None and entry["agent"] != "oracle"]
    drawn, (ax,) = figure(WIDTH, 4.2)
    largest = 0.0
    for entry in sorted(entries, key=lambda entry: -entry["oracle_share"]["mean"]):
        share, above, low, high = 100.0 * np.array([entry["profile"][name] for name in PROFILE])
        ax.fill_between(share, low, high, color=agent_colour(entry["agent"]), alpha=0.12, linewidth=0)
        _line(ax, share, above, entry["agent"])
        largest = max(largest, float(share[(high > 0.0).nonzero()[0][-1]]))
    limits = {"xlim": (0.0, min(100.0, largest + 10.0)), "ylim": (0.0, 102.0)}
    ax.set(xlabel="share of the oracle's reward [%]", ylabel="episodes above it [%]", **limits)
    ax.legend(**BESIDE)
    return drawn


def frontier(results: Mapping[str, Any]) -> Figure:
    """Draw the reward over the movements looked at for each one performed: a line an agent, the oracle dotted."""
    envs = list(dict.fromkeys(entry["env"] for entry in results["summary"]))
    drawn, axes = figure(WIDTH, 5.2, 1, len(envs), sharey=True)
    for ax, env in zip(axes, envs, strict=True):
        entries = entries_of(results, env)
        lines: dict[str, list[Entry]] = {}
        for entry in sorted(entries, key=lambda entry: entry["n_candidates"]):
            lines.setdefault(split_name(entry["agent"])[0], []).append(entry)
        for agent, line in sorted(lines.items(), key=lambda item: -item[1][-1]["reward"]["mean"]):
            x, y = [entry["n_candidates"] for entry in line], [entry["reward"]["mean"] for entry in line]
            low, high = ([entry["reward"][end] for entry in line] for end in ("low", "high"))
            if None not in (*low, *high):
                ax.vlines(x, low, high, color=agent_colour(agent), linewidth=3.5, alpha=0.5)
            _line(ax, np.array(x), np.array(y), agent, width=3.0 if agent == CURVE else 1.5)
        if best := [entry["regret"] + entry["reward"]["mean"] for entry in entries if entry["regret"] is not None]:
            ax.axhline(best[0], label="oracle (knows the map)", **ORACLE)
        ticks = sorted({entry["n_candidates"] for entry in entries})
        ax.set_xscale("log", base=2)
        ax.set_xticks(ticks, [str(tick) for tick in ticks])
        ax.minorticks_off()
        title = f"What imagining buys: {env_label(env)} environment, {entries[0]['n_memories']} memories"
        ax.set(title=title, xlabel="movements looked at for each one performed (1: nothing imagined)")
    axes[0].set_ylabel(f"reward of {results['rows'][0]['n_actions']} performed movements")
    axes[-1].legend(**BESIDE)
    return drawn


def regret(suite: Suite, measured: Measured) -> Figure:
    """Draw how far each agent's gathered reward stays behind the oracle's, action by action, over all memories."""
    drawn, (ax,) = figure(WIDTH, 4.2)
    best = {
        memory: np.pad(np.cumsum([0.0, *oracle.rewards]), (0, suite.n_actions - len(oracle.rewards)), mode="edge")
        for memory, oracle in measured.oracles.items()
    }
    curves = {}
    for agent in suite.agents:
        episodes = [e for e in measured.episodes if (e.env, e.agent) == (suite.oracle_envs[0], agent)]
        if episodes:
            curves[agent] = np.mean([best[episode.memory] - _gathered(episode) for episode in episodes], axis=0)
    for agent, curve in sorted(curves.items(), key=lambda item: -item[1][-1]):
        _line(ax, np.arange(len(curve)), curve, agent, markevery=5)
    ax.set(xlabel="actions generated", ylabel="reward behind the oracle", xlim=(0, suite.n_actions), ylim=(0.0, None))
    ax.legend(**BESIDE)
    return drawn


def _gathered(episode: Episode) -> np.ndarray:
    """Return the reward gathered after each action, from 0."""
    return np.cumsum([0.0, *(action.reward for action in episode.actions)])


def _binned(n_actions: Sequence[int], values: Sequence[float], edges: np.ndarray) -> np.ndarray:
    n_bins = len(edges) - 1
    place = np.clip(np.digitize(n_actions, edges, right=True) - 1, 0, n_bins - 1)
    total, count = np.bincount(place, values, n_bins), np.bincount(place, minlength=n_bins)
    return np.divide(total, count, out=np.full(n_bins, np.nan), where=count > 0)


def _one_per_env(summary: Sequence[Entry]) -> tuple[Figure, list[tuple[Axes, list[Entry]]]]:
    """Return a figure and, per environment, axes with the agents below one another and its entries, best first."""
    envs = list(dict.fromkeys(entry["env"] for entry in summary))
    ranked = [entries_of({"summary": summary}, env) for env in envs]
    drawn, axes = figure(WIDTH, 1.2 + 0.36 * max(map(len, ranked)), 1, len(envs))
    for ax, env, entries in zip(axes, envs, ranked, strict=True):
        _agents_below(ax, [entry["agent"] for entry in entries], margin=0.6)
        ax.set_title(f"{env_label(env)} environment")
    return drawn, list(zip(axes, ranked, strict=True))


def _agents_below(ax: Axes, agents: Sequence[str], margin: float) -> None:
    ax.set_yticks(range(len(agents)), [agent_label(agent) for agent in reversed(agents)])
    ax.set_ylim(-margin, len(agents) - 0.4)
    ax.grid(axis="y", visible=False)


def _interval(
    ax: Axes, found: Mapping[str, Any], place: int, agent: str, *, scale: float = 1.0, size: float = 7.5,
    edge: float = 2.0, alpha: float = 0.75,
) -> None:  # fmt: skip
    """Draw a mean as a marker and its interval as a bar."""
    colour = agent_colour(agent)
    if found["low"] is not None:
        ends = [scale * found["low"], scale * found["high"]]
        ax.plot(ends, [place, place], color=colour, linewidth=4, solid_capstyle="round", alpha=alpha)
    ax.plot(scale * found["mean"], place, agent_look(agent)[1], color="white", mec=colour, mew=edge, ms=size)


def _line(ax: Axes, x: np.ndarray, y: np.ndarray, agent: str, width: float = 1.8, markevery: int | None = None) -> None:
    look = {"color": agent_colour(agent), "marker": agent_look(agent)[1], "markersize": 5, "linewidth": width}
    ax.plot(x, y, label=agent_label(agent), markevery=markevery, **look)


def _from_zero(axes: Sequence[Axes], which: str) -> None:
    """Let the axes begin at zero and end a little beyond everything drawn on any of them."""
    largest = max(getattr(ax.dataLim, f"{which}max") for ax in axes)
    for ax in axes:
        ax.set(**{f"{which}lim": (0.0, 1.06 * largest)})
